//! How long noise lasts: its correlation from one image to the next.
//!
//! The noise of a coordinate is taken as a first-order autoregression over the images: correlation to the power of
//! the number of images between.

use nalgebra::{DMatrix, DVector};

use crate::loss::Observation;

/// Correlations are limited to this (chosen): beyond, a run would count as a handful of images.
pub(crate) const MOST_CORRELATED: f64 = 0.99;

/// Places of the observations of each coordinate, in the order of the images.
pub(crate) fn series(observations: &[Observation]) -> Vec<Vec<usize>> {
    let width = observations.iter().map(|o| o.keypoint + 1).max().unwrap_or(0);
    let mut series = vec![Vec::new(); 3 * width];
    for (index, observation) in observations.iter().enumerate() {
        series[3 * observation.keypoint + observation.axis].push(index);
    }
    series
}

/// Variance inflation of correlated `residuals` over as many independent ones: (1 + correlation) / (1 - correlation).
pub(crate) fn lasting(observations: &[Observation], residuals: &DVector<f64>) -> f64 {
    let correlation = correlation(observations, residuals.as_slice());
    (1.0 + correlation) / (1.0 - correlation)
}

/// Residuals of neighbouring images, added up to their correlation.
#[derive(Default)]
pub(crate) struct Neighbours {
    products: f64,
    squares_before: f64,
    squares_after: f64,
}

impl Neighbours {
    /// Adds the residual of one image and that of the next.
    pub(crate) fn add(&mut self, before: f64, after: f64) {
        self.products += before * after;
        self.squares_before += before * before;
        self.squares_after += after * after;
    }

    /// Correlation, -1 to 1; 0 where all residuals are 0.
    pub(crate) fn correlation(&self) -> f64 {
        self.products / (self.squares_before * self.squares_after).sqrt().max(f64::MIN_POSITIVE)
    }
}

/// First-order correlation of `residuals` from one image to the next, 0 to [`MOST_CORRELATED`].
pub(crate) fn correlation(observations: &[Observation], residuals: &[f64]) -> f64 {
    let mut neighbours = Neighbours::default();
    for series in series(observations) {
        for pair in series.windows(2) {
            if observations[pair[1]].instant == observations[pair[0]].instant + 1 {
                neighbours.add(residuals[pair[0]], residuals[pair[1]]);
            }
        }
    }
    neighbours.correlation().clamp(0.0, MOST_CORRELATED)
}

/// Correlation matrix of the observations times `columns`, shape (observations, columns), in one pass forward and
/// one backward.
pub(crate) fn correlated(
    observations: &[Observation],
    correlation: f64,
    columns: &DMatrix<f64>,
) -> DMatrix<f64> {
    let mut product = columns.clone();
    if correlation == 0.0 {
        return product;
    }
    let fade = |a: usize, b: usize| {
        let images = observations[a].instant.abs_diff(observations[b].instant);
        correlation.powi(i32::try_from(images).unwrap_or(i32::MAX))
    };
    for series in series(observations) {
        for column in 0..columns.ncols() {
            for reverse in [false, true] {
                let mut carried = 0.0;
                let mut last: Option<usize> = None;
                let mut visit = |&row: &usize| {
                    carried *= last.map_or(0.0, |last| fade(last, row));
                    product[(row, column)] += carried;
                    carried += columns[(row, column)];
                    last = Some(row);
                };
                if reverse {
                    series.iter().rev().for_each(&mut visit);
                } else {
                    series.iter().for_each(&mut visit);
                }
            }
        }
    }
    product
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_passes_multiply_by_the_correlation_matrix_across_gaps() {
        let at = |instant: usize, axis: usize| Observation {
            instant,
            keypoint: 0,
            axis,
            measured_m: 0.0,
            per_m: 1.0,
        };
        let observations = [at(0, 0), at(0, 2), at(1, 0), at(4, 0), at(4, 2)];
        let columns = DMatrix::from_fn(5, 2, |i, j| (1.3 * i as f64 + 0.7 * j as f64).sin());
        let rho: f64 = 0.6;
        let matrix = DMatrix::from_fn(5, 5, |i, j| {
            let (a, b) = (observations[i], observations[j]);
            if a.axis == b.axis { rho.powi(a.instant.abs_diff(b.instant) as i32) } else { 0.0 }
        });
        let difference = correlated(&observations, rho, &columns) - matrix * &columns;
        assert!(difference.amax() < 1e-14, "{difference}");
    }
}
