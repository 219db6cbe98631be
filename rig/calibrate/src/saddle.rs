//! Corners of a chessboard in a picture, one by one: saddle points of the grey levels, distinguished from others by what a small circle
//! around them shows, and refined to a fraction of a pixel.

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Vector2};

use super::field::Field;
use camera::calibration::Px;

/// A place where four squares may meet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Saddle {
    /// Place in the picture \[px\].
    pub(super) at: Px,
    /// The bright squares lie in the directions `phase / 2` and opposite \[rad\], from the rows' direction towards the columns'.
    pub(super) phase: f64,
}

/// Points of the circle around a candidate (chosen).
const RING_POINTS: usize = 16;
/// Radius of that circle \[px\] (chosen): squares of twice that are the smallest that are detected.
const RING_RADIUS_PX: f64 = 4.0;
/// Along a circle around a corner the picture is bright, dark, bright, dark: smallest share of the variation that has this form (chosen).
const FOURFOLD_SHARE_MIN: f64 = 0.65;
/// Smallest difference between bright and dark \[grey levels\] (chosen).
const CONTRAST_MIN_GREY: f64 = 4.0;
/// Smallest distance between candidates \[px\] (chosen).
const CANDIDATE_SPACING_MIN_PX: usize = 3;
/// Smallest strength of a candidate, as a share of the reference strength (chosen).
const STRENGTH_SHARE_MIN: f32 = 0.01;
/// The reference strength leaves this many of the strongest out (chosen): they may be no corners.
const STRONGEST_IGNORED: usize = 8;
/// Most candidates that are examined (chosen).
const CANDIDATES_MAX: usize = 20_000;

/// All places of `field` that look like a corner, the strongest first.
pub(super) fn saddles(field: &Field) -> Vec<Saddle> {
    let margin = CANDIDATE_SPACING_MIN_PX + 1;
    if field.width <= 2 * margin || field.height <= 2 * margin {
        return Vec::new();
    }
    let mut rows: Vec<Vec<f32>> = Vec::new();
    let strengths = |y: usize| -> Vec<f32> {
        let inner = 1..field.width - 1;
        let mut row = vec![0.0; field.width];
        inner.for_each(|x| row[x] = field.saddle(x, y));
        row
    };
    let mut peaks: Vec<(f32, usize, usize)> = Vec::new();
    for y in 1..field.height - 1 {
        rows.push(strengths(y));
        if rows.len() < 2 * CANDIDATE_SPACING_MIN_PX + 1 {
            continue;
        }
        let middle = &rows[CANDIDATE_SPACING_MIN_PX];
        for x in margin..field.width - margin {
            let strength = middle[x];
            let around = x - CANDIDATE_SPACING_MIN_PX..=x + CANDIDATE_SPACING_MIN_PX;
            // Of equal ones the first counts.
            let later = rows[CANDIDATE_SPACING_MIN_PX + 1..]
                .iter()
                .chain([middle])
                .flat_map(|row| &row[around.clone()]);
            let earlier = rows[..CANDIDATE_SPACING_MIN_PX].iter().flat_map(|row| &row[around.clone()]);
            if strength > 0.0
                && later.clone().all(|&s| s <= strength)
                && earlier.clone().all(|&s| s < strength)
            {
                peaks.push((strength, x, y - CANDIDATE_SPACING_MIN_PX));
            }
        }
        rows.remove(0);
    }
    peaks.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then((a.2, a.1).cmp(&(b.2, b.1))));
    peaks.truncate(CANDIDATES_MAX);
    let Some(&(strongest, ..)) = peaks.get(STRONGEST_IGNORED).or(peaks.first()) else { return Vec::new() };
    let corner = |&(_, x, y): &(f32, usize, usize)| Saddle::sought(field, [x as f64, y as f64]);
    peaks.iter().take_while(|peak| peak.0 > STRENGTH_SHARE_MIN * strongest).filter_map(corner).collect()
}

impl Saddle {
    /// The corner that lies at `at`, if one does.
    pub(super) fn sought(field: &Field, at: Px) -> Option<Self> {
        Some(Self { at, phase: fourfold(field, at)? })
    }

    /// Bright where the other is dark, as neighbours on a board are: -1; as second neighbours: 1.
    pub(super) fn likeness(&self, other: &Self) -> f64 {
        (self.phase - other.phase).cos()
    }
}

/// The phase of bright, dark, bright, dark on a circle around `at`, if that is what it shows.
fn fourfold(field: &Field, at: Px) -> Option<f64> {
    let mut ring = [0.0; RING_POINTS];
    for (i, grey) in ring.iter_mut().enumerate() {
        let angle = TAU * i as f64 / RING_POINTS as f64;
        let place = [at[0] + RING_RADIUS_PX * angle.cos(), at[1] + RING_RADIUS_PX * angle.sin()];
        *grey = f64::from(field.between(place)?);
    }
    let mean = ring.iter().sum::<f64>() / RING_POINTS as f64;
    let variance = ring.iter().map(|grey| (grey - mean).powi(2)).sum::<f64>() / RING_POINTS as f64;
    let wave = |trigonometric: fn(f64) -> f64| {
        let product =
            |(i, grey): (usize, &f64)| grey * trigonometric(2.0 * TAU * i as f64 / RING_POINTS as f64);
        2.0 / RING_POINTS as f64 * ring.iter().enumerate().map(product).sum::<f64>()
    };
    let (cosine, sine) = (wave(f64::cos), wave(f64::sin));
    let power = (cosine * cosine + sine * sine) / 2.0;
    let clear = power > FOURFOLD_SHARE_MIN * variance && 2.0 * cosine.hypot(sine) > CONTRAST_MIN_GREY;
    clear.then(|| sine.atan2(cosine))
}

/// Steps of the refinement.
const ITERATIONS_MAX: usize = 30;
/// It has come to rest when it moves less than this \[px\].
const CONVERGENCE_PX: f64 = 1e-4;
/// How far a window reaches, in standard deviations of its weight.
const WINDOW_SIGMAS: f64 = 2.5;

/// The corner near `start`: all slopes around it are square to the lines that lead to it. `sigma` \[px\] is the window's, a weight
/// that falls off as a normal distribution; `None` when it strays more than `most_px` or lies at the border.
///
/// # Source
/// W. Förstner, E. Gülch, "A fast operator for detection and precise location of distinct points", 1987. With a weight that follows
/// the corner smoothly nothing is interpolated, and noise, the same on all sides, draws it nowhere.
pub(super) fn refined(field: &Field, start: Px, sigma: f64, most_px: f64) -> Option<Px> {
    let reach = (WINDOW_SIGMAS * sigma).ceil();
    let mut at = Vector2::from(start);
    for _ in 0..ITERATIONS_MAX {
        let range = |centre: f64, size: usize| {
            let (from, to) = ((centre - reach).ceil(), (centre + reach).floor());
            (from >= 1.0 && to <= size as f64 - 2.0).then_some(from as usize..=to as usize)
        };
        let (columns, rows) = (range(at.x, field.width)?, range(at.y, field.height)?);
        let (mut squares, mut sum) = (Matrix2::zeros(), Vector2::zeros());
        for y in rows {
            for x in columns.clone() {
                let off = Vector2::new(x as f64, y as f64) - at;
                let weight = (-0.5 * off.norm_squared() / (sigma * sigma)).exp();
                let slope = Vector2::from(field.gradient(x, y));
                let square = weight * slope * slope.transpose();
                squares += square;
                sum += square * off;
            }
        }
        let step = squares.cholesky()?.solve(&sum);
        at += step;
        let near = (at - Vector2::from(start)).norm() <= most_px;
        if !near {
            return None;
        }
        if step.norm() < CONVERGENCE_PX {
            return Some(at.into());
        }
    }
    None
}

/// Largest share of what varies around a corner that may differ from one side to the opposite one: noise, and light from one side.
const ASYMMETRY_SHARE_MAX: f64 = 0.02;
/// How far is looked, in standard deviations of a window's weight.
const SYMMETRY_WINDOW_SIGMAS: f64 = 2.0;

/// Whether opposite places around a corner look alike, as they do unless something covers part of it; `sigma` \[px\] is the window's.
pub(super) fn symmetric(field: &Field, at: Px, sigma: f64) -> bool {
    let reach = (SYMMETRY_WINDOW_SIGMAS * sigma).round() as i32;
    let (mut odd, mut even, mut mean, mut count) = (0.0, 0.0, 0.0, 0.0);
    for j in 0..=reach {
        for i in -reach..=reach {
            // Each pair once.
            if i * i + j * j > reach * reach || (j == 0 && i <= 0) {
                continue;
            }
            let off = [f64::from(i), f64::from(j)];
            let there = field.between([at[0] + off[0], at[1] + off[1]]);
            let opposite = field.between([at[0] - off[0], at[1] - off[1]]);
            let (Some(there), Some(opposite)) = (there, opposite) else { return false };
            let (there, opposite) = (f64::from(there), f64::from(opposite));
            let half = (there + opposite) / 2.0;
            odd += ((there - opposite) / 2.0).powi(2);
            even += half * half;
            mean += half;
            count += 1.0;
        }
    }
    odd < ASYMMETRY_SHARE_MAX * (even - mean * mean / count)
}
