//! What pictures tell of the links' ends where nobody has said it: how far they reach past their pivots, and how round they are.

use ground::statistics::{MEDIAN_TO_SIGMA, median};
use rayon::prelude::*;

use super::keypoints::{Shape, chain, on_links};
use super::links::{Chain, FittedChain};
use super::outline::Outline;
use camera::calibration::Plane;

/// What was told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ends {
    /// The overhang and its sigma \[m\].
    pub(super) overhang_m: (f64, f64),
    /// Corner radius of the free ends as a share of the half width.
    pub(super) rounding: f64,
}

/// Roundings that are told apart: square, rounded and round ends.
const ROUNDINGS: [f64; 3] = [0.0, 0.5, 1.0];
/// Where the search for the overhang begins, in half widths of the links: what a pivot's screw wants of material.
const FIRST_OVERHANG_HALF_WIDTHS: f64 = 0.5;
/// What many images cannot better \[px\], 1 sigma: how blurred an edge is, is not known.
const LEAST_STD_PX: f64 = 0.03;

/// What `shapes` tell of what `outline` leaves open; none where no chain fits any of them.
pub(super) fn learn(outline: &Outline, plane: &Plane, shapes: &[Shape<'_>]) -> Option<Ends> {
    let roundings = outline.end_rounding.map_or(ROUNDINGS.to_vec(), |known| vec![known]);
    let tried = roundings.into_iter().map(|rounding| {
        let fit = |shape: &Shape<'_>| -> Option<(FittedChain, f64)> {
            let chain = chain(outline, plane, shape);
            let begin = FIRST_OVERHANG_HALF_WIDTHS * shape.line.mean_half_width();
            let overhang = if chain.overhang_std.is_finite() { chain.overhang } else { begin };
            let middle = shape.line.points[shape.line.points.len() / 2];
            let fitted = on_links(&Chain { rounding, overhang, ..chain }, shape).ok()?;
            Some((fitted, plane.metres_per_pixel(middle)))
        };
        let fits: Vec<Option<(FittedChain, f64)>> = shapes.par_iter().map(fit).collect();
        // An image that an outline does not fit at all explains nothing.
        let misfit: f64 = fits.iter().map(|fit| fit.as_ref().map_or(1.0, |(fit, _)| fit.misfit)).sum();
        (misfit, rounding, fits)
    });
    let (_, rounding, fits) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let fits: Vec<(FittedChain, f64)> = fits.into_iter().flatten().collect();
    let scale = fits.iter().map(|(_, scale)| scale).sum::<f64>() / fits.len().max(1) as f64;
    let overhangs: Vec<(f64, f64)> =
        fits.iter().map(|(fit, scale)| (fit.overhang.0 * scale, fit.overhang.1 * scale)).collect();
    // Straight poses hardly tell it, bent ones do.
    let weight = |std: f64| std.max(LEAST_STD_PX * scale).powi(-2);
    let total: f64 = overhangs.iter().map(|(_, std)| weight(*std)).sum();
    let overhang = overhangs.iter().map(|(value, std)| value * weight(*std)).sum::<f64>() / total;
    let mut off: Vec<f64> =
        overhangs.iter().map(|(value, std)| (value - overhang).abs() * weight(*std).sqrt()).collect();
    // What differs more from image to image than each says follows the pose: so much more is left of their mean.
    let scatter = (MEDIAN_TO_SIGMA * median(&mut off, f64::total_cmp)?).max(1.0);
    let std = (scatter / total.sqrt()).hypot(LEAST_STD_PX * scale);
    Some(Ends { overhang_m: (overhang, std), rounding })
}
