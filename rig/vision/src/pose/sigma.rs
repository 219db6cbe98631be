//! How far off keypoints may be: from the film's own residuals along the outline, and from what all its images share.

use nalgebra::{DMatrix, DVector};

use super::mechanism::Mechanism;
use super::shared::Shared;
use super::solve::Explained;
use crate::keypoints::Sigma;

/// A line whose edge is farther off belongs to something else \[px\].
const OWN_LINE_PX: f64 = 3.0;
/// Neighbours along the outline whose residuals are compared.
const MOST_LAGS: usize = 64;
/// Less alike is not alike.
const LEAST_ALIKE: f64 = 0.05;
/// What remains of a calibration's and a lens' errors \[px\], chosen.
const FLOOR_PX: f64 = 0.08;
/// Fewer lines tell nothing of a pose's error.
const MIN_LINES: usize = 12;

/// What a film's residuals are like.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Residuals {
    /// \[px2\]
    pub(super) variance: f64,
    /// How alike those of neighbours are, by how far they are apart, from 1 for the same line on.
    pub(super) alike: Vec<f64>,
}

fn residual(explained: &Explained, i: usize) -> Option<f64> {
    let line = &explained.lines[i];
    (line.tells && line.best_px.abs() < OWN_LINE_PX).then_some(line.residual_px)
}

impl Residuals {
    /// Of a film's images.
    pub(super) fn of(mechanism: &Mechanism, images: &[&Explained]) -> Self {
        let (mut sums, mut counts) = ([0.0; MOST_LAGS], [0u32; MOST_LAGS]);
        for explained in images {
            for run in mechanism.runs() {
                for i in run.clone() {
                    let Some(here) = residual(explained, i) else { continue };
                    for lag in 0..MOST_LAGS.min(run.end - i) {
                        if let Some(there) = residual(explained, i + lag) {
                            sums[lag] += here * there;
                            counts[lag] += 1;
                        }
                    }
                }
            }
        }
        let mean = |lag: usize| sums[lag] / f64::from(counts[lag].max(1));
        // where nothing is seen, nothing is known of it
        let variance = if counts[0] > 0 { mean(0).max(1e-4) } else { 1.0 };
        let alike = (0..MOST_LAGS).map(|lag| mean(lag) / variance).take_while(|alike| *alike >= LEAST_ALIKE);
        Self { variance, alike: std::iter::once(1.0).chain(alike.skip(1)).collect() }
    }

    /// Covariance of an image's pose, what is shared being as it is.
    fn covariance(&self, mechanism: &Mechanism, explained: &Explained) -> Option<DMatrix<f64>> {
        let n = explained.pose.len();
        let inverse = explained.information.clone().cholesky()?.inverse();
        let (mut meat, mut squares, mut count) = (DMatrix::zeros(n, n), 0.0, 0);
        let pull = |i: usize| -> Option<DVector<f64>> {
            residual(explained, i)?;
            Some(explained.slopes.row(i).columns(0, n).transpose() * explained.lines[i].information)
        };
        for run in mechanism.runs() {
            let pulls: Vec<Option<DVector<f64>>> = run.clone().map(pull).collect();
            for (at, here) in pulls.iter().enumerate() {
                let Some(here) = here else { continue };
                let own = residual(explained, run.start + at).unwrap_or_default();
                squares += own * own;
                count += 1;
                for (lag, alike) in self.alike.iter().enumerate() {
                    let Some(Some(there)) = pulls.get(at + lag) else { continue };
                    let weight = self.variance * alike;
                    meat.ger(weight, here, there, 1.0);
                    if lag > 0 {
                        meat.ger(weight, there, here, 1.0);
                    }
                }
            }
        }
        if count < MIN_LINES {
            return Some(inverse * 25.0);
        }
        // an image that is worse than the film's usual one is as sure as it is good
        let worse = (squares / count as f64 / self.variance).max(1.0);
        Some(&inverse + &inverse * meat * worse * &inverse)
    }
}

/// Sigma of each keypoint \[m\], and of each angle of the pose \[rad\]; none where the picture tells nothing. `known`: covariance of
/// what is shared.
pub(super) fn sigmas_m(
    mechanism: &Mechanism,
    shared: &Shared,
    residuals: &Residuals,
    explained: &Explained,
    known: &DMatrix<f64>,
    scale_m: f64,
) -> Option<Vec<Sigma>> {
    let n = explained.pose.len();
    let own = residuals.covariance(mechanism, explained)?;
    // how the pose follows what is shared
    let shared_count = known.nrows();
    let mut cross = DMatrix::zeros(n, shared_count);
    for (i, line) in explained.lines.iter().enumerate().filter(|(i, _)| residual(explained, *i).is_some()) {
        let row = explained.slopes.row(i);
        cross += row.columns(0, n).transpose() * row.columns(n, shared_count) * line.information;
    }
    let follows = -explained.information.clone().cholesky()?.solve(&cross);
    let slopes = mechanism.keypoint_slopes(&explained.pose, shared.base);
    let sigma = |slopes: &Vec<[f64; 2]>| {
        let by_pose = DMatrix::from_fn(2, n, |axis, joint| slopes[joint][axis]);
        let mut by_shared = &by_pose * &follows;
        by_shared[(0, 0)] += 1.0;
        by_shared[(1, 1)] += 1.0;
        let axis = |covariance: DMatrix<f64>| covariance.trace() / 2.0;
        let floor = (FLOOR_PX * scale_m).powi(2);
        let of_image = axis(&by_pose * &own * by_pose.transpose());
        let of_film = axis(&by_shared * known * by_shared.transpose()) + floor;
        // in metres here
        Sigma { whole_px: (of_image + of_film).sqrt(), pose_px: of_film.sqrt() }
    };
    Some(slopes.iter().map(sigma).collect())
}
