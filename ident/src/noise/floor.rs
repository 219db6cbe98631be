//! The noise floor: how large the keypoints' noise is and how long it lasts, whatever the model gets wrong.
//!
//! A hidden cause makes residuals large and slow; noise that was taken from them whole would hide the cause. So all that
//! is slow is taken out first: each coordinate's residual is split into a cubic spline with a knot every
//! [`KNOT_SPACING_S`] (a constant while the mechanism rests) and the rest, of which the noise is the restricted maximum
//! likelihood: standard deviations by run and keypoint, one correlation for all. The still images count whole, of the
//! motion only what is faster than the spline.
//!
//! # Source
//! H. D. Patterson, R. Thompson, "Recovery of inter-block information when block sizes are unequal", Biometrika 58
//! (1971) 545-554.

use nalgebra::{DMatrix, DVector, RowDVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::stamps::{Images, scatter};
use super::{LEAST_NOISE_M, Whitening};
use crate::loss::Observation;
use ground::statistics::median;

/// Distance of the spline's knots \[s\] (chosen): it follows what is slower than some 8 Hz.
const KNOT_SPACING_S: f64 = 0.05;
/// Fewest images between knots (chosen): fewer would leave no noise to estimate.
const KNOT_SPACING_IMAGES_MIN: f64 = 4.0;
/// Most images that one spline spans (chosen).
const SPLINE_IMAGES_MAX: usize = 250;
/// Fewest images for a separate spline (chosen).
const SPLINE_IMAGES_MIN: usize = 12;
/// A spline function counts as independent when its part orthogonal to the others exceeds this, of 1 at its peak (chosen): less is not
/// distinguished from rounding.
const INDEPENDENT_COMPONENT_MIN: f64 = 1e-3;
/// Correlations tried first (chosen).
const TRIED_CORRELATIONS: [f64; 8] = [0.0, 0.15, 0.3, 0.45, 0.6, 0.7, 0.8, 0.9];
/// Largest correlation that is sought (chosen).
const CORRELATION_MAX: f64 = 0.95;
/// Tolerance to which the correlation is sought (chosen).
const CORRELATION_TOLERANCE: f64 = 4e-3;

/// The noise of an experiment's keypoints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Floor {
    /// Standard deviation of one coordinate, over all runs and keypoints \[m\].
    pub noise_m: f64,
    /// Its standard deviation \[m\].
    pub noise_std_m: f64,
    /// Correlation from one image to the next.
    pub correlation: f64,
    /// Its standard deviation.
    pub correlation_std: f64,
    /// Degrees of freedom from which the noise was estimated.
    pub degrees: f64,
    /// Of these, the share of images that show the mechanism at rest.
    pub still_share: f64,
    /// Standard deviation of what pictures get wrong with the pose, where every run states it \[m\].
    pub pose_std_m: Option<f64>,
    /// Standard deviation of the times of images about their stamps \[s\]; 0 where none is seen.
    pub stamp_std_s: f64,
    /// What that makes of keypoints as they move, root mean square over all \[m\].
    pub stamp_m: f64,
    /// By run, then keypoint.
    pub runs: Vec<RunFloor>,
}

impl Floor {
    /// What measuring leaves of a coordinate, root mean square \[m\]: noise, and times that scatter.
    pub(crate) fn measured_m(&self) -> f64 {
        self.noise_m.hypot(self.stamp_m)
    }
}

/// The noise of one run's keypoints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunFloor {
    /// Id of the run.
    pub id: String,
    /// Standard deviation of a coordinate of each keypoint \[m\].
    pub std_m: Vec<f64>,
    /// Usual time between images \[s\].
    pub interval_s: f64,
}

/// One run's residuals, unwhitened.
pub(crate) struct Seen<'a> {
    pub(crate) id: &'a str,
    pub(crate) observations: &'a [Observation],
    /// Measured - simulated \[m\], over how much less certain than usual the cell says it is.
    pub(crate) residuals: &'a [f64],
    /// Velocity of each \[m/s\], over the same.
    pub(crate) velocities: &'a [f64],
    pub(crate) time_s: &'a [f64],
    /// Until then the mechanism rests \[s\].
    pub(crate) start_s: f64,
    /// Standard deviation of what follows the pose, where it is stated \[m\].
    pub(crate) pose_std_m: Option<f64>,
}

/// Images of coordinates that were observed at the same instants.
struct Stretch {
    run: usize,
    /// Keypoint of each column.
    keypoints: Vec<usize>,
    time_s: Vec<f64>,
    /// Shape (images, columns), as the next one.
    values: DMatrix<f64>,
    velocities: DMatrix<f64>,
    /// Squares of each column that are noise all the same: what was taken off is not known better.
    unsure: Vec<f64>,
    /// Shape (images, splines).
    basis: DMatrix<f64>,
    still: usize,
}

/// Residuals of a stretch after whitening with a correlation and taking the spline out.
struct Left {
    /// Squares of each column.
    squares: Vec<f64>,
    degrees: f64,
    /// Logarithm of the determinants, of one column.
    determinants: f64,
}

pub(crate) fn floor(runs: &[Seen<'_>]) -> Floor {
    let intervals: Vec<f64> = runs.iter().map(|run| interval_s(run.time_s)).collect();
    let mut stretches: Vec<Stretch> =
        runs.iter().enumerate().flat_map(|(run, seen)| stretches(run, seen, intervals[run])).collect();
    let widths: Vec<usize> =
        runs.iter().map(|run| run.observations.iter().map(|o| o.keypoint + 1).max().unwrap_or(0)).collect();
    let stamp_std_s = without_scatter(&mut stretches, &widths);
    let judge = |correlation: f64| {
        let left: Vec<Left> =
            stretches.par_iter().map(|stretch| stretch.left(correlation, intervals[stretch.run])).collect();
        let mut sums: Vec<Vec<[f64; 2]>> = widths.iter().map(|&width| vec![[0.0; 2]; width]).collect();
        let mut determinants = 0.0;
        for (stretch, left) in stretches.iter().zip(&left) {
            let squares = left.squares.iter().zip(&stretch.unsure).map(|(left, unsure)| left + unsure);
            for (&keypoint, squares) in stretch.keypoints.iter().zip(squares) {
                let sum = &mut sums[stretch.run][keypoint];
                *sum = [sum[0] + squares, sum[1] + left.degrees];
                determinants += left.determinants;
            }
        }
        let spread = |sum: &[f64; 2]| {
            if sum[1] > 0.0 { sum[1] * (sum[0] / sum[1]).max(f64::MIN_POSITIVE).ln() } else { 0.0 }
        };
        let misfit = determinants + sums.iter().flatten().map(spread).sum::<f64>();
        (misfit, sums)
    };
    let (correlation, curvature) = least(|correlation| judge(correlation).0);
    let (_, sums) = judge(correlation);
    let common = |sums: &[Vec<[f64; 2]>]| {
        let all = sums.iter().flatten().fold([0.0; 2], |all, sum| [all[0] + sum[0], all[1] + sum[1]]);
        ((all[0] / all[1].max(1.0)).sqrt().max(LEAST_NOISE_M), all[1])
    };
    let (noise_m, degrees) = common(&sums);
    let correlation_std = (2.0 / curvature.max(2.0)).sqrt();
    // of fast residuals more are noise, the more lasting it is
    let (lasting_m, _) = common(&judge((correlation + correlation_std).min(CORRELATION_MAX)).1);
    let noise_std_m = (lasting_m - noise_m).hypot(noise_m / (2.0 * degrees.max(1.0)).sqrt());
    let std = |sum: &[f64; 2]| {
        if sum[1] >= 2.0 * SPLINE_IMAGES_MIN as f64 {
            (sum[0] / sum[1]).sqrt().max(LEAST_NOISE_M)
        } else {
            noise_m
        }
    };
    let images = |of: &dyn Fn(&Stretch) -> usize| stretches.iter().map(of).sum::<usize>() as f64;
    Floor {
        noise_m,
        noise_std_m,
        correlation,
        correlation_std,
        degrees,
        pose_std_m: runs.iter().map(|run| run.pose_std_m).collect::<Option<Vec<f64>>>().map(|all| {
            let squares = all.iter().map(|std| std * std).sum::<f64>();
            (squares / all.len().max(1) as f64).sqrt()
        }),
        stamp_std_s,
        stamp_m: stamp_std_s * rms(runs.iter().flat_map(|run| run.velocities)),
        still_share: images(&|s| s.still) / images(&|s| s.time_s.len()).max(1.0),
        runs: runs
            .iter()
            .zip(&sums)
            .zip(&intervals)
            .map(|((run, sums), &interval_s)| RunFloor {
                id: run.id.to_owned(),
                std_m: sums.iter().map(std).collect(),
                interval_s,
            })
            .collect(),
    }
}

/// Takes off `stretches`, whose runs have so many keypoints, what is there since times of images scatter; by how much they do \[s\].
fn without_scatter(stretches: &mut [Stretch], widths: &[usize]) -> f64 {
    let first = |run: usize| widths[..run].iter().sum::<usize>();
    let images: Vec<Images<'_>> = stretches
        .iter()
        .map(|stretch| Images {
            series: stretch.keypoints.iter().map(|keypoint| first(stretch.run) + keypoint).collect(),
            time_s: &stretch.time_s,
            values: &stretch.values,
            velocities: &stretch.velocities,
            basis: &stretch.basis,
        })
        .collect();
    let found = scatter(&images, first(widths.len()));
    for (stretch, (part, unsure)) in stretches.iter_mut().zip(found.parts) {
        stretch.values -= part;
        stretch.unsure = unsure;
    }
    found.std_s
}

fn rms<'a>(list: impl Iterator<Item = &'a f64>) -> f64 {
    let (sum, count) = list.fold((0.0, 0_usize), |(sum, count), x| (sum + x * x, count + 1));
    (sum / count.max(1) as f64).sqrt()
}

/// Where `of` is least among the correlations, and its second derivative there.
fn least(of: impl Fn(f64) -> f64) -> (f64, f64) {
    let tried: Vec<f64> = TRIED_CORRELATIONS.iter().map(|&c| of(c)).collect();
    let best = (0..tried.len()).min_by(|&a, &b| tried[a].total_cmp(&tried[b])).unwrap_or(0);
    let mut low = TRIED_CORRELATIONS[best.saturating_sub(1)];
    let mut high = TRIED_CORRELATIONS.get(best + 1).copied().unwrap_or(CORRELATION_MAX);
    // golden section
    let share = (5f64.sqrt() - 1.0) / 2.0;
    let (mut a, mut b) = (high - share * (high - low), low + share * (high - low));
    let (mut at_a, mut at_b) = (of(a), of(b));
    while high - low > CORRELATION_TOLERANCE {
        if at_a < at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - share * (high - low);
            at_a = of(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + share * (high - low);
            at_b = of(b);
        }
    }
    let found = (low + high) / 2.0;
    let step = 0.03;
    let middle = found.max(step);
    let curvature = (of(middle - step) - 2.0 * of(middle) + of(middle + step)) / (step * step);
    (if found < 2.0 * CORRELATION_TOLERANCE { 0.0 } else { found }, curvature)
}

/// The usual time between images: the median.
pub(crate) fn interval_s(time_s: &[f64]) -> f64 {
    let mut steps: Vec<f64> = time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    median(&mut steps, f64::total_cmp).unwrap_or(1.0)
}

/// Coordinates observed at the same instants.
struct SameInstants {
    instants: Vec<usize>,
    /// Keypoint and axis of each.
    coordinates: Vec<(usize, usize)>,
    /// Residuals and velocities of each.
    columns: Vec<Vec<[f64; 2]>>,
}

/// A run's coordinates, grouped by the instants at which they were observed.
fn by_instants(seen: &Seen<'_>) -> Vec<SameInstants> {
    let mut single: Vec<SameInstants> = Vec::new();
    for (row, (observation, &residual)) in seen.observations.iter().zip(seen.residuals).enumerate() {
        let key = (observation.keypoint, observation.axis);
        let place = single.iter().position(|one| one.coordinates[0] == key).unwrap_or_else(|| {
            single.push(SameInstants {
                instants: Vec::new(),
                coordinates: vec![key],
                columns: vec![Vec::new()],
            });
            single.len() - 1
        });
        single[place].instants.push(observation.instant);
        single[place].columns[0].push([residual, seen.velocities.get(row).copied().unwrap_or(0.0)]);
    }
    let mut groups: Vec<SameInstants> = Vec::new();
    for mut one in single {
        match groups.iter_mut().find(|group| group.instants == one.instants) {
            Some(group) => {
                group.coordinates.append(&mut one.coordinates);
                group.columns.append(&mut one.columns);
            }
            None => groups.push(one),
        }
    }
    groups
}

/// The same in pieces that a spline can span.
fn stretches(run: usize, seen: &Seen<'_>, interval_s: f64) -> Vec<Stretch> {
    let mut list = Vec::new();
    for SameInstants { instants, coordinates, columns } in by_instants(seen) {
        let keypoints: Vec<usize> = coordinates.iter().map(|(keypoint, _)| *keypoint).collect();
        let pieces = instants.len().div_ceil(SPLINE_IMAGES_MAX).max(1);
        let size = instants.len().div_ceil(pieces).max(1);
        for (piece, part) in instants.chunks(size).enumerate() {
            let time_s: Vec<f64> = part.iter().map(|&instant| seen.time_s[instant]).collect();
            let still = time_s.partition_point(|&t| t <= seen.start_s);
            let basis = basis(&time_s, still, (KNOT_SPACING_IMAGES_MIN * interval_s).max(KNOT_SPACING_S));
            if time_s.len() < SPLINE_IMAGES_MIN || basis.ncols() + 4 > time_s.len() {
                continue;
            }
            let [values, velocities] = [0, 1].map(|which| {
                DMatrix::from_fn(part.len(), columns.len(), |row, column| {
                    columns[column][piece * size + row][which]
                })
            });
            let (keypoints, unsure) = (keypoints.clone(), vec![0.0; columns.len()]);
            list.push(Stretch { run, keypoints, time_s, values, velocities, unsure, basis, still });
        }
    }
    list
}

/// A constant over the first `still` images, cubic B-splines over the others; shape (images, functions).
pub(crate) fn basis(time_s: &[f64], still: usize, knot_s: f64) -> DMatrix<f64> {
    let rest = usize::from(still > 0);
    let moving = &time_s[still..];
    let (Some(&from), Some(&to)) = (moving.first(), moving.last()) else {
        return DMatrix::from_element(time_s.len(), rest, 1.0);
    };
    let parts = ((to - from) / knot_s).round().max(1.0);
    let knot_s = ((to - from) / parts).max(f64::MIN_POSITIVE);
    let parts = parts as usize;
    let mut basis = DMatrix::zeros(time_s.len(), rest + parts + 3);
    for (row, &t) in time_s.iter().enumerate() {
        if row < still {
            basis[(row, 0)] = 1.0;
            continue;
        }
        let place = ((t - from) / knot_s).clamp(0.0, parts as f64);
        let first = (place.floor() as usize).min(parts - 1);
        let u = place - first as f64;
        let cubic = [
            (1.0 - u).powi(3) / 6.0,
            (3.0 * u.powi(3) - 6.0 * u * u + 4.0) / 6.0,
            (-3.0 * u.powi(3) + 3.0 * u * u + 3.0 * u + 1.0) / 6.0,
            u.powi(3) / 6.0,
        ];
        for (k, value) in cubic.into_iter().enumerate() {
            basis[(row, rest + first + k)] = value;
        }
    }
    basis.select_columns(&independent(&basis))
}

/// The functions that the images, of which some are missing, distinguish from the others.
fn independent(basis: &DMatrix<f64>) -> Vec<usize> {
    let factors = basis.clone().col_piv_qr();
    let mut order = RowDVector::from_iterator(basis.ncols(), 0..basis.ncols());
    factors.p().permute_columns(&mut order);
    // with fewer images than functions, no more functions than images can be kept
    let factor = factors.r();
    let sizes = (0..factor.nrows().min(factor.ncols())).map(|k| factor[(k, k)].abs());
    let mut kept_functions: Vec<usize> = order
        .iter()
        .zip(sizes)
        .filter(|(_, size)| *size > INDEPENDENT_COMPONENT_MIN)
        .map(|(&k, _)| k)
        .collect();
    kept_functions.sort_unstable();
    kept_functions
}

impl Stretch {
    fn left(&self, correlation: f64, interval_s: f64) -> Left {
        let observations: Vec<Observation> = (0..self.time_s.len())
            .map(|instant| Observation { instant, keypoint: 0, axis: 0, measured_m: 0.0, per_m: 1.0 })
            .collect();
        let whitening = Whitening::new(&observations, &self.time_s, correlation, interval_s, None, &[]);
        let white = |mut matrix: DMatrix<f64>| {
            matrix.column_iter_mut().for_each(|mut column| whitening.apply(column.as_mut_slice()));
            matrix
        };
        let (values, basis) = (white(self.values.clone()), white(self.basis.clone()));
        let Some((within, determinant)) = within(&basis, &values) else {
            return Left { squares: vec![0.0; values.ncols()], degrees: 0.0, determinants: 0.0 };
        };
        let squares =
            values.column_iter().zip(within).map(|(all, within)| (all.norm_squared() - within).max(0.0));
        Left {
            squares: squares.collect(),
            degrees: (self.time_s.len() - self.basis.ncols()) as f64,
            determinants: determinant + whitening.ln_determinant(),
        }
    }
}

/// Squares of what of each column of `values` lies in the span of `basis`, whose functions reach over few rows each; and
/// the logarithm of the determinant of the basis' products. `None` where functions are not independent.
fn within(basis: &DMatrix<f64>, values: &DMatrix<f64>) -> Option<(Vec<f64>, f64)> {
    let count = basis.ncols();
    let mut gram = DMatrix::zeros(count, count);
    let mut products = DMatrix::zeros(count, values.ncols());
    for row in 0..basis.nrows() {
        let shown: Vec<(usize, f64)> =
            (0..count).map(|k| (k, basis[(row, k)])).filter(|(_, x)| *x != 0.0).collect();
        for &(i, x) in &shown {
            for &(j, y) in &shown {
                gram[(i, j)] += x * y;
            }
            for column in 0..values.ncols() {
                products[(i, column)] += x * values[(row, column)];
            }
        }
    }
    let factor = gram.cholesky()?;
    let half = factor.l().solve_lower_triangular(&products)?;
    let determinant: f64 = factor.l_dirty().diagonal().iter().map(|x: &f64| 2.0 * x.ln()).sum();
    Some((half.column_iter().map(|column| column.norm_squared()).collect(), determinant))
}

/// The slow part of whitened residuals, and how many functions it consists of: what a wrong model leaves is there.
pub(crate) fn slow_part(
    observations: &[Observation],
    residuals: &DVector<f64>,
    time_s: &[f64],
    start_s: f64,
    interval_s: f64,
) -> Slow {
    let list = residuals.as_slice();
    let seen =
        Seen { id: "", observations, residuals: list, velocities: &[], time_s, start_s, pose_std_m: None };
    let mut slow =
        Slow { squares: 0.0, functions: 0.0, all: residuals.norm_squared(), count: residuals.len() as f64 };
    for stretch in stretches(0, &seen, interval_s) {
        let Some((squares, _)) = within(&stretch.basis, &stretch.values) else { continue };
        slow.squares += squares.iter().sum::<f64>();
        slow.functions += (stretch.basis.ncols() * stretch.keypoints.len()) as f64;
    }
    slow
}

/// Squares of residuals by how slow they are.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Slow {
    pub(crate) squares: f64,
    pub(crate) functions: f64,
    pub(crate) all: f64,
    pub(crate) count: f64,
}

#[cfg(test)]
mod tests;
