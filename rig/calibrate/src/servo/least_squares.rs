//! Least squares over a few numbers, with differences for derivatives.

use ground::levenberg_marquardt::{LevenbergMarquardt, NormalEquations, Scaling};
use nalgebra::{DMatrix, DVector};

/// Settings of the search (chosen).
const SEARCH: LevenbergMarquardt =
    LevenbergMarquardt { iterations_max: 40, relative_tolerance: 1e-6, scaling: Scaling::Marquardt };

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
    let residuals = |at: &DVector<f64>| DVector::from_vec(residuals(at.as_slice()));
    let linearise = |at: &DVector<f64>, here: &DVector<f64>| {
        NormalEquations::by_differences(here, step, |by| residuals(&(at + by)))
    };
    let found = SEARCH.minimise(DVector::from_column_slice(start), residuals, linearise, |at, by| at + by);
    let std = errors(linearise(&found.point, &found.residuals).hessian, &found.residuals);
    Solution { at: found.point.as_slice().to_vec(), squares: found.residuals.norm_squared(), std }
}

fn errors(mut normal: DMatrix<f64>, residuals: &DVector<f64>) -> Vec<f64> {
    let (count, numbers) = (residuals.len(), normal.ncols());
    let variance = residuals.norm_squared() / (count.saturating_sub(numbers).max(1)) as f64;
    let along: f64 = residuals.as_slice().windows(2).map(|pair| pair[0] * pair[1]).sum();
    let correlation = (along / (variance * count as f64)).clamp(0.0, 0.95);
    let inflated = variance * (1.0 + correlation) / (1.0 - correlation);
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
