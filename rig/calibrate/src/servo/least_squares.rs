//! Levenberg-Marquardt over a few numbers, with differences for derivatives.

use nalgebra::{DMatrix, DVector};

/// Most iterations of the search, the relative decrease of the squares below which it ends, and the largest damping tried (all chosen).
const ITERATIONS_MAX: usize = 40;
const RELATIVE_TOLERANCE: f64 = 1e-6;
const DAMPING_MAX: f64 = 1e8;

/// Where a search ended.
pub(super) struct Solution {
    pub(super) at: Vec<f64>,
    /// Sum of squares.
    pub(super) squares: f64,
    /// Standard errors, for residuals that are correlated from image to image.
    pub(super) std: Vec<f64>,
}

/// The least sum of squares of `residuals` from `start` on; `step` is how far each number is moved for a derivative. NaN where the
/// residuals do not depend on a number.
pub(super) fn solve(residuals: impl Fn(&[f64]) -> Vec<f64>, start: &[f64], step: &[f64]) -> Solution {
    let squares = |r: &[f64]| r.iter().map(|x| x * x).sum::<f64>();
    let (mut at, mut now) = (start.to_vec(), residuals(start));
    let jacobian = |at: &[f64]| {
        let columns: Vec<DVector<f64>> = (0..at.len())
            .map(|k| {
                let moved = |by: f64| {
                    let mut at = at.to_vec();
                    at[k] += by;
                    DVector::from_vec(residuals(&at))
                };
                (moved(step[k]) - moved(-step[k])) / (2.0 * step[k])
            })
            .collect();
        DMatrix::from_columns(&columns)
    };
    let mut damping = 1e-3;
    for _ in 0..ITERATIONS_MAX {
        let slopes = jacobian(&at);
        let normal = slopes.transpose() * &slopes;
        let down = slopes.transpose() * DVector::from_column_slice(&now);
        let before = squares(&now);
        let mut decrease = 0.0;
        while damping < DAMPING_MAX {
            let mut damped = normal.clone();
            for k in 0..at.len() {
                damped[(k, k)] += damping * normal[(k, k)] + f64::MIN_POSITIVE;
            }
            let Some(by) = damped.cholesky().map(|c| c.solve(&down)) else {
                damping *= 10.0;
                continue;
            };
            let next: Vec<f64> = at.iter().zip(by.iter()).map(|(x, by)| x - by).collect();
            let found = residuals(&next);
            if squares(&found) < before {
                decrease = before - squares(&found);
                (at, now) = (next, found);
                damping = (damping * 0.2).max(1e-9);
                break;
            }
            damping *= 5.0;
        }
        if decrease <= RELATIVE_TOLERANCE * before {
            break;
        }
    }
    let std = errors(&jacobian(&at), &now);
    Solution { squares: squares(&now), at, std }
}

fn errors(slopes: &DMatrix<f64>, residuals: &[f64]) -> Vec<f64> {
    let (count, numbers) = (residuals.len(), slopes.ncols());
    let variance =
        residuals.iter().map(|r| r * r).sum::<f64>() / (count.saturating_sub(numbers).max(1)) as f64;
    let along: f64 = residuals.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let correlation = (along / (variance * count as f64)).clamp(0.0, 0.95);
    let inflated = variance * (1.0 + correlation) / (1.0 - correlation);
    let mut normal = slopes.transpose() * slopes;
    // a number that nothing depends on says nothing of the others
    for k in 0..numbers {
        if normal[(k, k)] == 0.0 {
            normal[(k, k)] = 1.0;
        }
    }
    let inverse = normal.try_inverse();
    (0..numbers)
        .map(|k| inverse.as_ref().map_or(f64::NAN, |inverse| (inflated * inverse[(k, k)]).max(0.0).sqrt()))
        .collect()
}
