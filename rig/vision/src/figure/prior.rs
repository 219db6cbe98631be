//! What is known of a figure's numbers before a picture is looked at.

use nalgebra::DMatrix;

/// A normal distribution of a figure's numbers.
#[derive(Debug, Clone)]
pub(crate) struct Prior {
    pub(crate) mean: Vec<f64>,
    /// Inverse covariance, shape (size, size).
    pub(crate) precision: DMatrix<f64>,
}

/// What is taken as it is has this sigma: far below any picture's.
const FIXED_STD: f64 = 1e-5;

impl Prior {
    /// Of `mean`, held by `stiffness`, with sigma `std` for the first numbers: infinite for what is free, 0 for what is fixed.
    pub(crate) fn new(mean: Vec<f64>, std: &[f64], stiffness: DMatrix<f64>) -> Self {
        let mut precision = stiffness;
        for (i, std) in std.iter().enumerate() {
            precision[(i, i)] += std.max(FIXED_STD).powi(-2);
        }
        Self { mean, precision }
    }

    /// `-gradient` of half its cost at `pose`.
    pub(super) fn pull(&self, pose: &[f64]) -> nalgebra::DVector<f64> {
        let off = nalgebra::DVector::from_fn(pose.len(), |i, _| self.mean[i] - pose[i]);
        &self.precision * off
    }
}
