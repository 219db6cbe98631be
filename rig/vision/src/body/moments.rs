//! Moments of a silhouette by grey levels: what a pixel of its rim counts is how much of it is covered.

use nalgebra::{Matrix3, Vector3};

use crate::Mask;
use crate::background::Contrast;
use camera::calibration::Px;

/// Place, direction and size of a silhouette.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moments {
    /// Area \[px²\].
    pub(crate) area_px: f64,
    /// Centroid \[px\], and its sigma per axis.
    pub(crate) centroid: Px,
    pub(crate) centroid_std_px: f64,
    /// Variances along the long axis and across it \[px²\].
    pub(crate) variances: [f64; 2],
    /// Direction of the long axis in the picture, one of its two \[rad\], and its sigma.
    pub(crate) axis_rad: f64,
    pub(crate) axis_std_rad: f64,
    /// Third moment along that direction over the variance's power 3/2, and its sigma: below 0 where the blunt end is ahead.
    pub(crate) skew: f64,
    pub(crate) skew_std: f64,
    /// Pixels of something else within the rim.
    pub(crate) foreign_px: usize,
}

/// So far either way of the outline a lens blurs it \[px\].
const RIM_PX: usize = 3;
/// A plane through the contrast of fewer pixels than this says nothing.
const LEAST_INNER_PX: usize = 30;

impl Moments {
    /// Of the silhouette `mask` in `contrast`; none of an empty one.
    pub(crate) fn of(contrast: &Contrast, mask: &Mask) -> Option<Self> {
        let covered = Covered::of(contrast, mask);
        let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            covered.pixels.iter().map(|&([x, y], weight, _)| weight * of(x, y)).sum()
        };
        let area = sum(&|_, _| 1.0);
        let [x0, y0] = [sum(&|x, _| x) / area, sum(&|_, y| y) / area];
        let xx = sum(&|x, _| (x - x0).powi(2)) / area;
        let yy = sum(&|_, y| (y - y0).powi(2)) / area;
        let xy = sum(&|x, y| (x - x0) * (y - y0)) / area;
        let (half, apart) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
        let variances = [half + apart, half - apart];
        // Not so where it is no number either.
        if !(area > 0.0 && variances[1] > 0.0) {
            return None;
        }
        let axis_rad = f64::atan2(2.0 * xy, xx - yy) / 2.0;
        let (sin, cos) = axis_rad.sin_cos();
        let along = |x: f64, y: f64| cos * (x - x0) + sin * (y - y0);
        let across = |x: f64, y: f64| cos * (y - y0) - sin * (x - x0);
        let third = variances[0].powf(1.5);
        let skew = sum(&|x, y| along(x, y).powi(3)) / area / third;
        // What the noise of the rim's pixels makes of each.
        let noise = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            let rim = covered.pixels.iter().filter(|(_, _, noisy)| *noisy);
            covered.noise * rim.map(|&([x, y], ..)| of(x, y).powi(2)).sum::<f64>().sqrt() / area
        };
        let moved = [noise(&|x, _| x - x0), noise(&|_, y| y - y0)];
        let turned = noise(&|x, y| along(x, y) * across(x, y)) / (variances[0] - variances[1]);
        let skewed = noise(&|x, y| along(x, y).powi(3) - 3.0 * variances[0] * along(x, y)) / third;
        Some(Self {
            area_px: area,
            centroid: [x0 + covered.origin[0], y0 + covered.origin[1]],
            centroid_std_px: moved[0].max(moved[1]),
            variances,
            axis_rad,
            axis_std_rad: turned,
            skew,
            skew_std: skewed,
            foreign_px: covered.foreign_px,
        })
    }

    /// How far from round it is: 0 round, 1 a line.
    pub(crate) fn elongation(&self) -> f64 {
        let [long, short] = self.variances;
        (long - short) / (long + short)
    }
}

/// The pixels that a silhouette covers, wholly or in part.
struct Covered {
    origin: Px,
    /// Place from the origin, share that is covered, whether that share is read off the picture.
    pixels: Vec<(Px, f64, bool)>,
    /// Noise of such a share, 1 sigma.
    noise: f64,
    foreign_px: usize,
}

impl Covered {
    fn of(contrast: &Contrast, mask: &Mask) -> Self {
        let outer = mask.grown(RIM_PX);
        let origin = [outer.left as f64, outer.top as f64];
        let (width, height) = (outer.width, outer.height);
        let within: Vec<bool> = (0..width * height)
            .map(|i| mask.at((outer.left + i % width) as isize, (outer.top + i / width) as isize))
            .collect();
        let deep = eroded(&eroded(&within, width, 1), width, width);
        let value = |i: usize| {
            let (column, row) = (outer.left + i % width, outer.top + i / width);
            let seen = column < contrast.width && row < contrast.height;
            seen.then(|| f64::from(contrast.values[row * contrast.width + column]))
        };
        let at = |i: usize| [(i % width) as f64, (i / width) as f64];
        let level = Level::through((0..deep.len()).filter(|&i| deep[i]).map(|i| (at(i), value(i))), contrast);
        let half = f64::from(contrast.level) / 2.0;
        let (mut pixels, mut foreign_px, mut total) = (Vec::new(), 0, 0.0);
        for i in 0..width * height {
            let Some(value) = value(i).filter(|_| outer.bits[i]) else { continue };
            if deep[i] {
                pixels.push((at(i), 1.0, false));
            } else if !within[i] && value > half {
                foreign_px += 1;
            } else {
                let level = level.at(at(i));
                total += level;
                pixels.push((at(i), value / level, true));
            }
        }
        let rim = pixels.iter().filter(|(_, _, rim)| *rim).count().max(1);
        Self { origin, pixels, noise: f64::from(contrast.noise) * rim as f64 / total, foreign_px }
    }
}

/// What is farther than [`RIM_PX`] inside along rows (`step` 1) or columns (`step` the `width`).
fn eroded(within: &[bool], width: usize, step: usize) -> Vec<bool> {
    let reach = RIM_PX * step;
    let inside = |i: usize| {
        let room = if step == 1 { (RIM_PX..width - RIM_PX).contains(&(i % width)) } else { true };
        room && i >= reach
            && i + reach < within.len()
            && (0..=2 * RIM_PX).all(|k| within[i - reach + k * step])
    };
    (0..within.len()).map(inside).collect()
}

/// What the body differs from the empty tank by, where it is whole: a plane, as light falls.
struct Level([f64; 3]);

impl Level {
    fn through(inner: impl Iterator<Item = (Px, Option<f64>)>, contrast: &Contrast) -> Self {
        let (mut normal, mut right, mut count) = (Matrix3::zeros(), Vector3::zeros(), 0);
        for ([x, y], value) in inner.filter_map(|(at, value)| Some((at, value?))) {
            let terms = Vector3::new(1.0, x, y);
            normal += terms * terms.transpose();
            right += value * terms;
            count += 1;
        }
        let fitted = normal.cholesky().filter(|_| count >= LEAST_INNER_PX).map(|factor| factor.solve(&right));
        fitted
            .map_or(Self([f64::from(contrast.level), 0.0, 0.0]), |plane| Self([plane[0], plane[1], plane[2]]))
    }

    /// At `at`; a plane of a few pixels may fall below nothing beside them.
    fn at(&self, [x, y]: Px) -> f64 {
        let Self([level, by_x, by_y]) = self;
        (level + by_x * x + by_y * y).max(1.0)
    }
}
