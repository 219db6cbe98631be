//! A rigid body that nothing holds: its centroid and which way it heads.
//!
//! P0 is the centroid of its silhouette, P1 a point ahead of it. [`moments`] are taken by grey levels, not by whole pixels;
//! [`heading`] says which of the long axis's directions is ahead. A round body has no P1. What does not have its usual size is cut,
//! covered or merged with something.

mod heading;
mod moments;

use heading::{Headings, Known};
pub(super) use moments::Moments;

use super::Mask;
use super::background::Contrast;
use super::component::Component;
use super::config::{Ahead, Gates};
use super::gates::Sizes;
use super::keypoints::{Found, Sigma};
use super::record::{ImageRecord, Keypoint, Status};
use super::rejection::Rejection;
use super::spline::distance;
use camera::calibration::{Plane, Px};
use ground::statistics::{MEDIAN_TO_SIGMA, median};

/// What is usual in a film, and how its headings were decided so far.
#[derive(Debug, Default)]
pub(super) struct Bodies {
    usual: Option<Usual>,
    headings: Headings,
}

/// What a sample of a film tells.
#[derive(Debug, Clone, Copy)]
pub(super) struct Usual {
    sizes: Sizes,
    /// Sigma of each size from image to image.
    scatter: Sizes,
    /// See [`Moments::elongation`].
    pub(super) elongation: f64,
    /// Half of its length \[px\].
    pub(super) half_length_px: f64,
}

/// What is nearer to round than this has no heading: an axis ratio of 1.04.
const LEAST_ELONGATION: f64 = 0.04;
/// Off by more than so many sigmas, or than this share where nothing ever changes, a size says that the body is not seen alone.
const DOUBTFUL_SIGMAS: f64 = 6.0;
const DOUBTFUL_SHARE: f64 = 0.02;
/// More pixels of something else on its rim bend its outline.
const MOST_FOREIGN_PX: usize = 4;
/// No sigma is smaller: what light, lens and sampling do to each image alike \[px\].
const LEAST_STD_PX: f64 = 0.03;

/// A body in one image, before it is known where it heads.
pub(super) struct Body {
    pub(super) mask: Mask,
    pub(super) moments: Moments,
    pub(super) doubt: Option<String>,
}

/// A body in one image.
pub(super) struct Headed {
    pub(super) found: Found,
    /// From its one end to the one ahead \[px\].
    pub(super) line: Vec<Px>,
    pub(super) doubt: Option<String>,
}

fn sizes(moments: &Moments) -> Sizes {
    // An ellipse's axes are four times the roots of its variances.
    let [length_px, width_px] = moments.variances.map(|variance| 4.0 * variance.sqrt());
    Sizes { length_px, width_px, area_px: moments.area_px }
}

impl Usual {
    /// What is usual among `bodies`; none without any.
    pub(super) fn of(bodies: &[&Body]) -> Option<Self> {
        let all: Vec<Sizes> = bodies.iter().map(|body| sizes(&body.moments)).collect();
        let usual = Sizes::usual(&all)?;
        let scatter = |measure: fn(&Sizes) -> f64| {
            let mut off: Vec<f64> = all.iter().map(|one| (measure(one) - measure(&usual)).abs()).collect();
            MEDIAN_TO_SIGMA * median(&mut off, f64::total_cmp).unwrap_or(0.0)
        };
        let scatter = Sizes {
            length_px: scatter(|sizes| sizes.length_px),
            width_px: scatter(|sizes| sizes.width_px),
            area_px: scatter(|sizes| sizes.area_px),
        };
        let mut elongations: Vec<f64> = bodies.iter().map(|body| body.moments.elongation()).collect();
        let elongation = median(&mut elongations, f64::total_cmp)?;
        Some(Self { sizes: usual, scatter, elongation, half_length_px: usual.length_px / 2.0 })
    }

    /// Why `sizes` are not those of the body alone, although no gate refuses them.
    fn doubt(&self, sizes: &Sizes) -> Option<String> {
        let measures = [
            ("length", sizes.length_px, self.sizes.length_px, self.scatter.length_px),
            ("width", sizes.width_px, self.sizes.width_px, self.scatter.width_px),
            ("area", sizes.area_px, self.sizes.area_px, self.scatter.area_px),
        ];
        let off = measures.into_iter().find(|(_, got, usual, scatter)| {
            (got - usual).abs() > (DOUBTFUL_SIGMAS * scatter).max(DOUBTFUL_SHARE * usual)
        });
        off.map(|(what, got, usual, _)| {
            format!("its {what} is {got:.1} px, usually {usual:.1} px: something may cover it or touch it")
        })
    }
}

impl Bodies {
    /// Keeps what is usual.
    pub(super) fn learn(&mut self, usual: Usual) {
        *self = Self { usual: Some(usual), headings: Headings::default() };
    }

    /// Which of `parts` is the body: one of its usual size, the nearest to where it was `last`; none where no part has it.
    pub(super) fn choice(&self, parts: &[Component], gates: &Gates, last: Option<Px>) -> Option<usize> {
        let usual = self.usual.as_ref()?.sizes.area_px;
        let off = |part: &Component| (part.area as f64 - usual).abs() / usual;
        let alike = parts.iter().enumerate().filter(|(_, part)| !part.cut && off(part) <= gates.area.get());
        let far = |part: &Component| last.map_or(off(part), |last| distance(part.centroid, last));
        alike.min_by(|(_, a), (_, b)| far(a).total_cmp(&far(b))).map(|(i, _)| i)
    }

    /// The body in one image, by its silhouette; `blocked` is where it cannot be seen.
    ///
    /// # Errors
    /// What says that it is not seen whole and alone.
    pub(super) fn seen(
        &self,
        contrast: &Contrast,
        silhouette: &Mask,
        blocked: &[&Mask],
        (hole_share, gates): (f64, &Gates),
    ) -> Result<Body, Rejection> {
        let mut mask = silhouette.framed(1);
        let limit_px = (hole_share * mask.area() as f64) as usize;
        let hole_px = mask.fill_holes(limit_px);
        if hole_px > 0 {
            return Err(Rejection::Closed { hole_px, limit_px });
        }
        let rim = mask.grown(1);
        let inside = |(column, row): (usize, usize)| column < contrast.width && row < contrast.height;
        // One pixel of growth is cut at the left and the top.
        let at_border =
            mask.pixels().any(|(column, row)| column == 0 || row == 0) || !rim.pixels().all(inside);
        if at_border {
            return Err(Rejection::Cut { by: "the picture's border" });
        }
        if blocked.iter().any(|blocked| blocked.shared(&rim) > 0) {
            return Err(Rejection::Cut { by: "something that never moves, or the static mask" });
        }
        let moments = Moments::of(contrast, &mask)
            .ok_or(Rejection::NothingThere { min_area_px: mask.area() as f64 })?;
        let sizes = sizes(&moments);
        let mut doubt = None;
        if let Some(usual) = &self.usual {
            sizes.check(&usual.sizes, gates)?;
            doubt = usual.doubt(&sizes);
        }
        let foreign_px = moments.foreign_px;
        let touched = (foreign_px > MOST_FOREIGN_PX)
            .then(|| format!("{foreign_px} px of something else lie on its outline"));
        Ok(Body { mask, moments, doubt: doubt.or(touched) })
    }

    /// P0 and, where the body has a heading, P1 `heading_m` ahead, in the next image.
    pub(super) fn headed(
        &mut self,
        time_s: f64,
        body: Option<&Body>,
        ahead: Ahead,
        (heading_m, plane): (f64, &Plane),
    ) -> Option<Headed> {
        let round = self.usual.as_ref().is_some_and(|usual| usual.elongation < LEAST_ELONGATION);
        let heading = self.headings.take(time_s, body.map(|body| &body.moments), ahead);
        let Body { moments, doubt, .. } = body?;
        let centre = moments.centroid;
        let centre_std = moments.centroid_std_px.hypot(LEAST_STD_PX);
        let mut found = Found { points: vec![centre], sigmas: vec![Sigma::untold(centre_std)] };
        let (sin, cos) = heading?.sin_cos();
        let half = 2.0 * moments.variances[0].sqrt();
        let line = [-half, half].map(|by| [centre[0] + by * cos, centre[1] + by * sin]).to_vec();
        if !round {
            let (from, towards) = (plane.metres(centre), plane.metres([centre[0] + cos, centre[1] + sin]));
            let step = [towards[0] - from[0], towards[1] - from[1]];
            let by = heading_m / step[0].hypot(step[1]);
            let point = plane.pixel([from[0] + by * step[0], from[1] + by * step[1]]);
            let angle_std = moments.axis_std_rad.hypot(LEAST_STD_PX / half);
            found.sigmas.push(Sigma::untold(centre_std.hypot(angle_std * distance(centre, point))));
            found.points.push(point);
        }
        Some(Headed { found, line, doubt: doubt.clone() })
    }

    /// Turns round what all images together say heads the other way, in the records of all images taken; whether anything was changed.
    /// Where nothing tells which end is ahead, the images are doubtful.
    pub(super) fn settle(&self, records: &mut [ImageRecord], ahead: Ahead, plane: &Plane) -> bool {
        const ALIKE: &str =
            "its two ends look alike: it may head the other way in all images; `ahead` would tell";
        let mut changed = false;
        for (record, settled) in records.iter_mut().zip(self.headings.settled(ahead)) {
            let ([centre, point], Some((turned, known))) = (&mut record.keypoints[..], settled) else {
                continue;
            };
            if turned {
                let px = [0, 1].map(|axis| 2.0 * centre.px[axis] - point.px[axis]);
                *point = Keypoint::seen(px, point.sigma(), plane);
                record.centreline.reverse();
                changed = true;
            }
            if known == Known::Alike && record.status == Status::Ok {
                record.status = Status::Doubtful;
                ALIKE.clone_into(&mut record.reason);
                changed = true;
            }
        }
        changed
    }
}
