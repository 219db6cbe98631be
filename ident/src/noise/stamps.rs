//! Times of images that scatter.
//!
//! What an image shows is a little earlier or later than its stamp: the camera, the bus or a busy kernel were. All keypoints of the image are
//! then off along their paths, by as much as they move in that time: an error that rests while the mechanism rests, and one that all keypoints
//! have in common. At 0.2 m/s and 0.2 ms it is 0.04 mm, ten times what pictures get wrong otherwise.
//!
//! A model that is late, or early, is off along the same paths, but by times that change slowly. So these are taken out first where they are
//! more likely than none: where a servo turns round, a model without its lag would count as images of scattered times.
//!
//! # Source
//! A. P. Dempster, N. M. Laird, D. B. Rubin, "Maximum likelihood from incomplete data via the EM algorithm", Journal of the Royal Statistical
//! Society B 39 (1977) 1-38: times are what is not seen, one an image; restricted likelihood as in [`super::floor`].

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use sim::Trajectory;

use super::floor::{basis, interval_s};
use crate::loss::Observation;

/// Images so much slower than the fastest say nothing of their times (chosen).
const SLOW_SHARE: f64 = 0.02;
/// Rounds in which the scatter is sought at most, and the share by which it changes where that ends (chosen).
const MOST_ROUNDS: usize = 40;
const SAME_SHARE: f64 = 0.01;
/// Scatter must be so much more likely than none, in nats (chosen): 20 to 1.
const LEAST_GAIN: f64 = 3.0;

/// Distance of the knots of a spline that a model's lateness follows \[s\], and the fewest images between them (chosen: twice what residuals are
/// split with).
const LATE_KNOT_SPACING_S: f64 = 0.1;
const LATE_KNOT_SPACING_IMAGES_MIN: f64 = 8.0;
/// How late models are \[s\] (chosen): a standard deviation.
const LATE_S: f64 = 0.1;

/// Velocity of each observed coordinate as it was measured \[m/s\]: between the images before and after, so that its noise is not that
/// of the image itself; 0 where either is missing.
pub(crate) fn velocities(trajectory: &Trajectory, observations: &[Observation]) -> Vec<f64> {
    let images = trajectory.time_s.len();
    let one = |o: &Observation| {
        if o.instant == 0 || o.instant + 1 >= images {
            return 0.0;
        }
        let at = |instant: usize| trajectory.at(instant, o.keypoint)[o.axis];
        let apart_s = trajectory.time_s[o.instant + 1] - trajectory.time_s[o.instant - 1];
        let velocity = (at(o.instant + 1) - at(o.instant - 1)) / apart_s;
        if velocity.is_finite() { velocity } else { 0.0 }
    };
    observations.iter().map(one).collect()
}

/// Images whose coordinates were all observed, and what of their residuals is slow.
pub(super) struct Images<'a> {
    /// Series that share a noise, of each column.
    pub(super) series: Vec<usize>,
    pub(super) time_s: &'a [f64],
    /// Residuals and velocities, shape (images, columns).
    pub(super) values: &'a DMatrix<f64>,
    pub(super) velocities: &'a DMatrix<f64>,
    /// What is slow, shape (images, functions).
    pub(super) basis: &'a DMatrix<f64>,
}

/// What is found of images.
pub(super) struct Scatter {
    /// Standard deviation of their times \[s\]; 0 where none is seen.
    pub(super) std_s: f64,
    /// Of each stretch, what the residuals have of it, shape (images, columns), and squares that its uncertainty leaves, by column.
    pub(super) parts: Vec<(DMatrix<f64>, Vec<f64>)>,
}

/// A stretch with what is slow taken out.
struct Fast<'a> {
    of: &'a Images<'a>,
    /// Images that move.
    moving: Vec<usize>,
    fast: DMatrix<f64>,
    /// What the slow functions see of each other through the moving images.
    slow: DMatrix<f64>,
    /// Orthonormal functions that a model's lateness is a sum of, shape (moving images, functions).
    late: DMatrix<f64>,
    degrees: f64,
}

/// Times of a stretch, as far as they are known.
struct Times {
    mean_s: DVector<f64>,
    covariance: DMatrix<f64>,
    /// What they make more likely, twice, in nats.
    gain: f64,
}

/// The scatter of the times of `stretches`, whose columns are of `series` series.
pub(super) fn scatter(stretches: &[Images<'_>], series: usize) -> Scatter {
    let none = || Scatter {
        std_s: 0.0,
        parts: stretches
            .iter()
            .map(|one| {
                (DMatrix::zeros(one.values.nrows(), one.values.ncols()), vec![0.0; one.values.ncols()])
            })
            .collect(),
    };
    let best = [false, true].into_iter().filter_map(|is_late| {
        let all: Vec<Fast<'_>> = stretches.par_iter().map(|one| Fast::new(one, is_late)).collect();
        sought(&all, series)
    });
    let best = best.max_by(|(_, one), (_, other)| one.total_cmp(other));
    best.filter(|(_, gain)| *gain > LEAST_GAIN).map_or_else(none, |(found, _)| found)
}

/// The scatter of the times of `all`, and by how much it is more likely than none \[nats\]. `None` where nothing moves or digits are lost.
fn sought(all: &[Fast<'_>], series: usize) -> Option<(Scatter, f64)> {
    let free = all.iter().map(|one| one.moving.len() - one.late.ncols()).sum::<usize>();
    if free == 0 {
        return None;
    }
    let variances = |squares: &[Vec<f64>]| -> Vec<f64> {
        let mut sums = vec![[0.0, 0.0]; series];
        for (one, squares) in all.iter().zip(squares) {
            for (&series, square) in one.of.series.iter().zip(squares) {
                sums[series][0] += square;
                sums[series][1] += one.degrees;
            }
        }
        sums.iter().map(|sum| (sum[0] / sum[1].max(1.0)).max(super::LEAST_NOISE_M.powi(2))).collect()
    };
    let misfit = |variances: &[f64], squares: &[Vec<f64>]| -> f64 {
        let one = |(one, squares): (&Fast<'_>, &Vec<f64>)| -> f64 {
            let each = one.of.series.iter().zip(squares);
            each.map(|(&series, square)| one.degrees * variances[series].ln() + square / variances[series])
                .sum()
        };
        all.iter().zip(squares).map(one).sum()
    };
    let bare: Vec<Vec<f64>> = all.iter().map(Fast::squares).collect();
    let still = variances(&bare);
    let (mut noise, mut std_s) = (still.clone(), f64::INFINITY);
    for round in 0..MOST_ROUNDS {
        let found: Vec<Times> = all.par_iter().map(|one| one.times(&noise, std_s)).collect::<Option<_>>()?;
        let squares: f64 = all.iter().zip(&found).map(|(one, times)| one.scattered(times)).sum();
        let next_s = (squares / free as f64).sqrt();
        let left: Vec<Vec<f64>> = all.iter().zip(&found).map(|(one, times)| one.left(times)).collect();
        let is_same = round > 1 && (next_s / std_s - 1.0).abs() < SAME_SHARE;
        (noise, std_s) = (variances(&left), next_s);
        if is_same {
            break;
        }
    }
    let times: Vec<Times> = all.par_iter().map(|one| one.times(&noise, std_s)).collect::<Option<_>>()?;
    let gained = times.iter().map(|times| times.gain).sum::<f64>();
    let gain = 0.5 * (misfit(&still, &bare) - misfit(&noise, &bare) + gained);
    Some((
        Scatter { std_s, parts: all.iter().zip(&times).map(|(one, times)| one.part(times)).collect() },
        gain,
    ))
}

impl Images<'_> {
    /// Orthonormal splines over the images `moving`, shape (moving images, functions).
    fn late(&self, moving: &[usize]) -> DMatrix<f64> {
        let time_s: Vec<f64> = moving.iter().map(|&row| self.time_s[row]).collect();
        let knot_s = (LATE_KNOT_SPACING_IMAGES_MIN * interval_s(&time_s)).max(LATE_KNOT_SPACING_S);
        basis(&time_s, 0, knot_s).qr().q()
    }
}

impl<'a> Fast<'a> {
    fn new(of: &'a Images<'a>, is_late: bool) -> Self {
        let speed = |row: usize| of.velocities.row(row).norm();
        let most = (0..of.values.nrows()).map(speed).fold(0.0, f64::max);
        let moving: Vec<usize> =
            (0..of.values.nrows()).filter(|&row| most > 0.0 && speed(row) > SLOW_SHARE * most).collect();
        let slow = of.basis.clone().qr().q();
        let fast = of.values - &slow * slow.tr_mul(of.values);
        let seen = slow.select_rows(&moving);
        let degrees = (of.values.nrows() - of.basis.ncols()) as f64;
        let late = if is_late { of.late(&moving) } else { DMatrix::zeros(moving.len(), 0) };
        Self { of, fast, slow: &seen * seen.transpose(), late, moving, degrees }
    }

    fn squares(&self) -> Vec<f64> {
        self.fast.column_iter().map(|column| column.norm_squared()).collect()
    }

    fn velocity(&self, place: usize, column: usize) -> f64 {
        self.of.velocities[(self.moving[place], column)]
    }

    /// The times, where series have these `variances` and times scatter by `std_s`. `None` where digits are lost.
    fn times(&self, variances: &[f64], std_s: f64) -> Option<Times> {
        let count = self.moving.len();
        let weights: Vec<f64> = self.of.series.iter().map(|&series| 1.0 / variances[series]).collect();
        let shared = |i: usize, j: usize| -> f64 {
            weights.iter().enumerate().map(|(c, w)| w * self.velocity(i, c) * self.velocity(j, c)).sum()
        };
        let mut precision = DMatrix::zeros(count, count);
        for i in 0..count {
            for j in 0..=i {
                let own = if i == j { 1.0 } else { 0.0 };
                precision[(i, j)] = (own - self.slow[(i, j)]) * shared(i, j);
                precision[(j, i)] = precision[(i, j)];
            }
        }
        for i in 0..count {
            // unknown as yet: a little keeps it regular
            let known = if std_s.is_finite() { std_s.powi(-2) } else { 1e-3 * shared(i, i) };
            precision[(i, i)] += known;
        }
        if std_s.is_finite() {
            precision += &self.late * self.late.transpose() * (LATE_S.powi(-2) - std_s.powi(-2));
        }
        let with = DVector::from_fn(count, |i, _| {
            let fast = |c: usize| self.fast[(self.moving[i], c)];
            weights.iter().enumerate().map(|(c, w)| w * self.velocity(i, c) * fast(c)).sum::<f64>()
        });
        let factor = precision.cholesky()?;
        let ln: f64 = factor.l_dirty().diagonal().iter().map(|x: &f64| 2.0 * x.ln()).sum();
        let mean_s = factor.solve(&with);
        let late = self.late.ncols();
        let gain =
            with.dot(&mean_s) - ln - 2.0 * ((count - late) as f64 * std_s.ln() + late as f64 * LATE_S.ln());
        Some(Times { covariance: factor.inverse(), mean_s, gain })
    }

    /// Squares of what scatters of `times`, as they are to be expected.
    fn scattered(&self, times: &Times) -> f64 {
        let late = self.late.tr_mul(&times.mean_s).norm_squared();
        let unsure = (self.late.transpose() * &times.covariance * &self.late).trace();
        times.mean_s.norm_squared() - late + times.covariance.trace() - unsure
    }

    /// Squares of the noise of each column, as they are to be expected where `times` are so.
    fn left(&self, times: &Times) -> Vec<f64> {
        let (part, unsure) = self.part(times);
        // what is slow of it was taken out before
        let slow = self.of.basis.clone().qr().q();
        let fast = &part - &slow * slow.tr_mul(&part);
        let left = &self.fast - fast;
        left.column_iter().zip(unsure).map(|(column, unsure)| column.norm_squared() + unsure).collect()
    }

    fn part(&self, times: &Times) -> (DMatrix<f64>, Vec<f64>) {
        let (rows, columns) = self.of.values.shape();
        let mut part = DMatrix::zeros(rows, columns);
        let mut unsure = vec![0.0; columns];
        for column in 0..columns {
            for (i, &row) in self.moving.iter().enumerate() {
                let own = self.velocity(i, column);
                part[(row, column)] = own * times.mean_s[i];
                unsure[column] += own * own * times.covariance[(i, i)];
                for j in 0..self.moving.len() {
                    unsure[column] -=
                        own * self.velocity(j, column) * self.slow[(i, j)] * times.covariance[(i, j)];
                }
            }
        }
        (part, unsure)
    }
}
