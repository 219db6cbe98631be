//! Whether what a film's images show is the mechanism that is meant: the one at its base, or the only one there is.

use super::{BASE_REACH, Extractor, Oriented};
use crate::VisionError;
use crate::background::Contrast;
use crate::parts::Seen;
use crate::rejection::Rejection;
use crate::spline::distance;
use camera::calibration::Px;
use ground::statistics::median;

/// P0 is no further from what is seen of the mechanism than this many sigmas of where it is expected.
pub(crate) const MAX_BASE_SIGMAS: f64 = 4.0;
/// Two things are alike from this ratio of their areas on, chosen: an arm's own shows this much of its poses and its light.
const MIN_LIKE_RATIO: f64 = 0.7;

impl Extractor {
    /// Refuses a film in most of whose images P0 is expected where nothing is, or something else could as well be the mechanism.
    pub(super) fn certain_of_it(
        &self,
        contrasts: &[Option<Contrast>],
        seen: &[Result<Seen, Rejection>],
        oriented: &[Result<Oriented, Rejection>],
    ) -> Result<(), VisionError> {
        let Some(base) = self.base else {
            let areas = seen.iter().flatten().map(|seen| (seen.silhouette.area(), seen.other_px));
            let (alike, alone): (Vec<_>, Vec<_>) =
                areas.partition(|&(own, other)| other as f64 >= MIN_LIKE_RATIO * own as f64);
            return match alike.first() {
                Some(&(own_px, other_px)) if alike.len() > alone.len() => {
                    Err(VisionError::TwoAlike { own_px, other_px })
                }
                _ => Ok(()),
            };
        };
        let apart = contrasts.iter().zip(oriented).filter_map(|(contrast, oriented)| {
            let (contrast, oriented) = (contrast.as_ref()?, oriented.as_ref().ok()?);
            Some((self.apart(base, contrast, oriented), oriented.candidate.line.points[0]))
        });
        let (off_px, begins): (Vec<f64>, Vec<Px>) = apart.unzip();
        let most =
            |of: fn(&Px) -> f64| median(&mut begins.iter().map(of).collect::<Vec<_>>(), f64::total_cmp);
        match (median(&mut off_px.clone(), f64::total_cmp), most(|px| px[0]), most(|px| px[1])) {
            (Some(off_px), Some(x), Some(y)) if off_px > 0.0 => Err(VisionError::BaseElsewhere {
                base,
                begins: [x, y],
                apart_px: distance(base, [x, y]),
                std_px: self.config.base_std_px.get(),
            }),
            _ => Ok(()),
        }
    }

    /// How much further P0 is expected from the mechanism than it may be \[px\]; below 0 where it may be there.
    fn apart(&self, base: Px, contrast: &Contrast, oriented: &Oriented) -> f64 {
        let line = &oriented.candidate.line;
        let nearest = line.points.iter().map(|point| distance(base, *point)).fold(f64::INFINITY, f64::min);
        // What hides the root hides P0 as well.
        let hidden = match oriented.base_covered {
            true => BASE_REACH * (contrast.width as f64).hypot(contrast.height as f64),
            false => 0.0,
        };
        let reach = (MAX_BASE_SIGMAS * self.config.base_std_px.get()).max(hidden);
        nearest - line.mean_half_width() - reach
    }
}
