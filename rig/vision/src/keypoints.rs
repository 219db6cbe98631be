//! P0..Pn on a centreline, in the three modes.

use super::Mask;
use super::background::Contrast;
use super::centreline::Centreline;
use super::config::{Gates, Mode};
use super::contour::contour;
use super::gates::check_overlap;
use super::links::{Chain, FittedChain};
use super::outline::Outline;
use super::rejection::Rejection;
use super::spline::{arc_lengths, distance, moved, point_at, unit};
use camera::calibration::Plane;
use camera::calibration::Px;

/// P0..Pn in one image, before they are put into metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Positions \[px\].
    pub points: Vec<Px>,
    /// Sigma of each.
    pub sigmas: Vec<Sigma>,
}

/// How far off a keypoint may be, 1 sigma per axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sigma {
    /// By all together \[px\].
    pub whole_px: f64,
    /// By what comes back with the pose \[px\]: how the outline lies on the pixels, and what is known of the mechanism's shape only so
    /// far. The rest is each image's own.
    pub pose_px: f64,
}

impl Sigma {
    /// Of `whole_px`, where nothing tells its parts: half of its variance each.
    pub fn untold(whole_px: f64) -> Self {
        Self { whole_px, pose_px: whole_px * std::f64::consts::FRAC_1_SQRT_2 }
    }

    /// What is the image's own \[px\].
    pub fn white_px(self) -> f64 {
        (self.whole_px * self.whole_px - self.pose_px * self.pose_px).max(0.0).sqrt()
    }
}

/// What keypoints are placed on: one image's silhouette, its edge and its middle.
#[derive(Debug)]
pub struct Shape<'a> {
    /// Middle line, base first.
    pub line: &'a Centreline,
    /// Silhouette.
    pub mask: &'a Mask,
    /// Sub-pixel edge points, for [`Mode::Links`].
    pub edge: &'a [Px],
    /// The base end is covered by the static mask or cut by the picture's border.
    pub base_covered: bool,
    /// P0, roughly, and its sigma \[px\], where somebody says.
    pub base: Option<(Px, f64)>,
}

/// An edge this close to the static mask is the mask's own \[px\].
pub const CLEAR_PX: isize = 2;
/// How well an end of the silhouette is found along it, 1 sigma \[px\]: half a pixel's blur; measured on renders.
const END_STD_PX: f64 = 0.3;
/// Least sigma of a point of the centreline \[px\]: pixel sampling; measured on renders.
const LINE_STD_PX: f64 = 0.1;

/// Edge points of a silhouette, where the mode needs them.
pub fn edge_points(mode: Mode, contrast: &Contrast, part: &Mask, blocked: Option<&Mask>) -> Vec<Px> {
    match mode {
        Mode::Links => contour(contrast, part, blocked, CLEAR_PX),
        Mode::Arc | Mode::Paper | Mode::Centroid | Mode::Arms => Vec::new(),
    }
}

/// Places P0..Pn.
///
/// # Errors
/// [`Rejection::NoFit`] and [`Rejection::Overlap`] in mode `links`.
pub fn place(outline: &Outline, gates: &Gates, plane: &Plane, shape: &Shape) -> Result<Found, Rejection> {
    match outline.mode {
        Mode::Paper | Mode::Centroid | Mode::Arms => Ok(on_medial_path(outline.links, shape.line)),
        Mode::Arc => Ok(on_arc(outline, shape)),
        Mode::Links => {
            let chain = chain(outline, plane, shape);
            let fitted = on_links(&chain, shape)?;
            let overlap = chain.drawn(&fitted, shape.mask).overlap(shape.mask);
            check_overlap(overlap, gates)?;
            Ok(Found { points: fitted.points, sigmas: untold(&fitted.std_px) })
        }
    }
}

/// Equal shares of the raw medial path. It stops short by up to a half width at either end, by how much differs
/// from image to image: that is its sigma, shared out along the line.
fn on_medial_path(links: usize, line: &Centreline) -> Found {
    let lengths = arc_lengths(&line.medial);
    let total = lengths[lengths.len() - 1];
    let share = |i: usize| i as f64 / links as f64;
    let half = line.mean_half_width();
    Found {
        points: (0..=links).map(|i| point_at(&line.medial, &lengths, total * share(i))).collect(),
        sigmas: (0..=links).map(|i| Sigma::untold(half * share(i).hypot(1.0 - share(i)))).collect(),
    }
}

/// Shares of the arc length, from the base (where it is covered: from where P0 is said to be, straight) to the tip.
fn on_arc(outline: &Outline, shape: &Shape) -> Found {
    let covered = hidden_base(0.0, shape);
    let mut points = shape.line.points.clone();
    if let Some((base, _)) = covered {
        points.insert(0, base);
    }
    let lengths = arc_lengths(&points);
    let total = lengths[lengths.len() - 1];
    let base_std = covered.map_or(END_STD_PX, |(_, std)| std);
    let inner = shape.line.scatter_px.max(LINE_STD_PX);
    // A share of an uncertain length moves with both ends.
    let std = |share: f64| inner.hypot((1.0 - share) * base_std).hypot(share * END_STD_PX);
    let shares = &outline.shares;
    Found {
        points: shares.iter().map(|share| point_at(&points, &lengths, share * total)).collect(),
        sigmas: shares.iter().map(|&share| Sigma::untold(std(share))).collect(),
    }
}

fn untold(std_px: &[f64]) -> Vec<Sigma> {
    std_px.iter().map(|std_px| Sigma::untold(*std_px)).collect()
}

/// The chain that `outline` describes, in pixels where `shape` is.
pub(super) fn chain(outline: &Outline, plane: &Plane, shape: &Shape) -> Chain {
    let scale = plane.metres_per_pixel(shape.line.points[shape.line.points.len() / 2]);
    let lengths: Option<Vec<f64>> =
        outline.lengths_m.as_ref().map(|all| all.iter().map(|length| length / scale).collect());
    let (overhang, overhang_std) = outline.overhang_m.unwrap_or((0.0, f64::INFINITY));
    let overhang = overhang / scale;
    Chain {
        known: lengths.is_some(),
        lengths: lengths.unwrap_or_else(|| vec![1.0; outline.links]),
        overhang,
        overhang_std: overhang_std / scale,
        tip_overhang: outline.tip_overhang_m / scale,
        rounding: outline.end_rounding.unwrap_or(0.0),
        base: hidden_base(overhang, shape),
    }
}

/// `chain` where its edge points say.
pub(super) fn on_links(chain: &Chain, shape: &Shape) -> Result<FittedChain, Rejection> {
    let start = first_guess(chain, shape.line);
    let no_fit = Rejection::NoFit { links: chain.lengths.len(), points: shape.edge.len() };
    chain.fit(shape.edge, &start, shape.line.mean_half_width()).ok_or(no_fit)
}

/// P0 and its sigma where the picture does not show the base end, `overhang` before which P0 would lie.
pub(super) fn hidden_base(overhang: f64, shape: &Shape) -> Option<(Px, f64)> {
    /// Farther than this from the visible end, what is said of P0 says that the end is not the base.
    const OTHER_END_SIGMAS: f64 = 4.0;
    let start = shape.line.points[0];
    let width = 2.0 * shape.line.mean_half_width();
    match shape.base {
        Some((base, sigma))
            if shape.base_covered || distance(base, start) > overhang + OTHER_END_SIGMAS * sigma =>
        {
            Some((base, sigma))
        }
        None if shape.base_covered => Some((start, width)),
        _ => None,
    }
}

/// P0..Pn by arc length from the tip; beyond the line's visible start straight on.
fn first_guess(chain: &Chain, line: &Centreline) -> Vec<Px> {
    let lengths = arc_lengths(&line.points);
    let seen = lengths[lengths.len() - 1];
    let start = line.points[0];
    let ahead = line.points[(line.mean_half_width().round() as usize).clamp(1, line.points.len() - 1)];
    let backwards = unit(ahead, start);
    let hidden = chain.base.map_or(-chain.overhang, |(base, _)| distance(base, start));
    let total: f64 = chain.lengths.iter().sum();
    let unit_px = if chain.known { 1.0 } else { (seen + hidden) / total };
    let mut to_tip = total;
    let mut points = Vec::with_capacity(chain.lengths.len() + 1);
    for i in 0..=chain.lengths.len() {
        let s = seen - to_tip * unit_px;
        points.push(if s < 0.0 { moved(start, backwards, -s) } else { point_at(&line.points, &lengths, s) });
        to_tip -= chain.lengths.get(i).copied().unwrap_or(0.0);
    }
    points
}
