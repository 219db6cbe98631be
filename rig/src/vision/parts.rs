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

/// An image in which the mechanism's silhouette is known.
pub(super) struct Seen {
    pub(super) contrast: Contrast,
    pub(super) silhouette: Mask,
    /// Size of the largest other part that the picture's border cuts \[px\].
    pub(super) cut_object_px: usize,
}

impl Parts {
    /// With part `chosen` as the mechanism.
    pub(super) fn seen(mut self, chosen: usize) -> Seen {
        let silhouette = self.parts.swap_remove(chosen).mask;
        Seen { silhouette, contrast: self.contrast, cut_object_px: largest_cut(self.parts.iter()) }
    }

    /// With the silhouette given.
    pub(super) fn with(self, mask: &Mask) -> Result<Seen, Rejection> {
        let silhouette = mask.framed(0);
        let wanted = [self.contrast.width, self.contrast.height];
        let got = [silhouette.left + silhouette.width, silhouette.top + silhouette.height];
        if got[0] > wanted[0] || got[1] > wanted[1] {
            return Err(Rejection::MaskSize { wanted, got });
        }
        let apart = |part: &&Component| part.mask.shared(&silhouette) == 0;
        let cut_object_px = largest_cut(self.parts.iter().filter(apart));
        Ok(Seen { silhouette, contrast: self.contrast, cut_object_px })
    }
}

/// Size of the largest part that the picture's border cuts \[px\]; 0 without any.
fn largest_cut<'a>(parts: impl Iterator<Item = &'a Component>) -> usize {
    parts.filter(|part| part.cut).map(|part| part.area).max().unwrap_or(0)
}
