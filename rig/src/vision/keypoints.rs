//! P0..Pn on a centreline, in the three modes.

use super::Mask;
use super::background::Contrast;
use super::centreline::Centreline;
use super::config::{Mode, VisionConfig};
use super::contour::contour;
use super::gates::check_overlap;
use super::links::Chain;
use super::rejection::Rejection;
use super::spline::{arc_lengths, distance, moved, point_at, unit};
use crate::calibration::Plane;
use crate::calibration::Px;

/// P0..Pn in one image, before they are put into metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Positions \[px\].
    pub points: Vec<Px>,
    /// Sigma of each, per axis \[px\].
    pub std_px: Vec<f64>,
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
}

/// An edge this close to the static mask is the mask's own \[px\].
pub const CLEAR_PX: isize = 2;
/// How well an end of the silhouette is found along it, 1 sigma \[px\]: half a pixel's blur; measured on renders.
const END_STD_PX: f64 = 0.3;
/// Least sigma of a point of the centreline \[px\]: pixel sampling; measured on renders.
const LINE_STD_PX: f64 = 0.1;

/// Edge points of a silhouette, where the mode needs them.
pub fn edge_points(
    config: &VisionConfig,
    contrast: &Contrast,
    part: &Mask,
    blocked: Option<&Mask>,
) -> Vec<Px> {
    match config.mode {
        Mode::Links => contour(contrast, part, blocked, CLEAR_PX),
        Mode::Arc | Mode::Paper => Vec::new(),
    }
}

/// Places P0..Pn.
///
/// # Errors
/// [`Rejection::NoFit`] and [`Rejection::Overlap`] in mode `links`.
pub fn place(config: &VisionConfig, plane: &Plane, shape: &Shape) -> Result<Found, Rejection> {
    match config.mode {
        Mode::Paper => Ok(on_medial_path(config.links, shape.line)),
        Mode::Arc => Ok(on_arc(config, shape)),
        Mode::Links => on_links(config, plane, shape),
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
        std_px: (0..=links).map(|i| half * share(i).hypot(1.0 - share(i))).collect(),
    }
}

/// Shares of the arc length, from the base (where it is covered: from `base_px`, straight) to the tip.
fn on_arc(config: &VisionConfig, shape: &Shape) -> Found {
    let covered = hidden_base(config, 0.0, shape);
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
    let shares = config.arc_shares();
    Found {
        points: shares.iter().map(|share| point_at(&points, &lengths, share * total)).collect(),
        std_px: shares.iter().map(|&share| std(share)).collect(),
    }
}

fn on_links(config: &VisionConfig, plane: &Plane, shape: &Shape) -> Result<Found, Rejection> {
    let middle = shape.line.points[shape.line.points.len() / 2];
    let scale = plane.metres_per_pixel(middle);
    let lengths: Option<Vec<f64>> =
        config.link_lengths_m.as_ref().map(|all| all.iter().map(|l| l.get() / scale).collect());
    let overhang = config.overhang_m.get() / scale;
    let chain = Chain {
        known: lengths.is_some(),
        lengths: lengths.unwrap_or_else(|| vec![1.0; config.links]),
        overhang,
        rounding: config.end_rounding.get(),
        base: hidden_base(config, overhang, shape),
    };
    let start = first_guess(&chain, shape.line);
    let no_fit = Rejection::NoFit { links: config.links, points: shape.edge.len() };
    let fitted = chain.fit(shape.edge, &start, shape.line.mean_half_width()).ok_or(no_fit)?;
    let overlap = chain.drawn(&fitted, shape.mask).overlap(shape.mask);
    check_overlap(overlap, &config.gates)?;
    Ok(Found { points: fitted.points, std_px: fitted.std_px })
}

/// P0 and its sigma where the picture does not show the base end, `overhang` before which P0 would lie.
fn hidden_base(config: &VisionConfig, overhang: f64, shape: &Shape) -> Option<(Px, f64)> {
    /// Farther than this from the visible end, `base_px` says that the end is not the base.
    const OTHER_END_SIGMAS: f64 = 4.0;
    let start = shape.line.points[0];
    let width = 2.0 * shape.line.mean_half_width();
    let sigma = config.base_std_px.get();
    match config.base() {
        Some(base) if shape.base_covered || distance(base, start) > overhang + OTHER_END_SIGMAS * sigma => {
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
