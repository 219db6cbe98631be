//! What stands out in an image, and which of it is the mechanism.

use super::Mask;
use super::background::Contrast;
use super::component::Component;
use super::rejection::Rejection;

/// An image's parts, and the contrast they were found in.
pub(super) struct Parts {
    pub(super) contrast: Contrast,
    pub(super) parts: Vec<Component>,
}

/// What is known of the mechanism's silhouette in an image.
pub(super) struct Seen {
    pub(super) silhouette: Mask,
    /// Size of the largest other part that the picture's border cuts \[px\].
    pub(super) cut_object_px: usize,
    /// Size of the largest other part that is seen whole \[px\].
    pub(super) other_px: usize,
}

impl Parts {
    /// With part `chosen` as the mechanism.
    pub(super) fn seen(mut self, chosen: usize) -> (Contrast, Seen) {
        let silhouette = self.parts.swap_remove(chosen).mask;
        let [cut_object_px, other_px] = largest(self.parts.iter());
        (self.contrast, Seen { silhouette, cut_object_px, other_px })
    }

    /// With the silhouette given.
    pub(super) fn with(self, mask: &Mask) -> (Contrast, Result<Seen, Rejection>) {
        let silhouette = mask.framed(0);
        let wanted = [self.contrast.width, self.contrast.height];
        let got = [silhouette.left + silhouette.width, silhouette.top + silhouette.height];
        if got[0] > wanted[0] || got[1] > wanted[1] {
            return (self.contrast, Err(Rejection::MaskSize { wanted, got }));
        }
        let apart = |part: &&Component| part.mask.shared(&silhouette) == 0;
        let [cut_object_px, other_px] = largest(self.parts.iter().filter(apart));
        (self.contrast, Ok(Seen { silhouette, cut_object_px, other_px }))
    }
}

/// Sizes of the largest part that the picture's border cuts and of the largest one that it does not \[px\]; 0 without any.
fn largest<'a>(parts: impl Iterator<Item = &'a Component>) -> [usize; 2] {
    parts.fold([0, 0], |[cut, whole], part| match part.cut {
        true => [cut.max(part.area), whole],
        false => [cut, whole.max(part.area)],
    })
}
