//! What the residuals at the optimum say about the noise: its size and how long it lasts.
//!
//! The noise of a coordinate is taken as a first-order autoregression over the images: correlation to the power of
//! the number of images between. Residuals that a wrong model leaves are correlated, too, and widen the error bars
//! just so.

use nalgebra::{DMatrix, DVector};

use super::objective::Objective;
use super::problem::{Linear, Point};
use crate::loss::Observation;

/// Noise of one run against what was assumed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seen {
    /// True over assumed standard deviation.
    pub(super) scale: f64,
    /// Correlation from one image to the next, 0 to 1.
    pub(super) correlation: f64,
    /// Squares of the residuals in assumed standard deviations, per degree of freedom, each image counted once.
    pub(super) chi2_per_degree: f64,
    /// Root mean square of the residuals per degree of freedom \[m\].
    pub(super) rms_m: f64,
}

/// Correlations are believed up to here: beyond, a run would count as a handful of images.
const MOST_CORRELATED: f64 = 0.99;
/// A stated noise is believed unless the residuals exceed it by so many standard deviations of their mean square.
const BEYOND_DOUBT: f64 = 4.0;
/// Of the degrees of freedom of a run, parameters and correlation use up no more than this share.
const MOST_USED: f64 = 0.5;

/// Each run's noise, from its residuals in `linear`. A `stated` noise is only ever enlarged.
pub(super) fn seen(objective: &Objective<'_>, point: &Point, linear: &[Linear], stated: bool) -> Vec<Seen> {
    let terms = &objective.problem.terms;
    let total: usize = linear.iter().map(|linear| linear.residuals.len()).sum();
    let one = |(run, linear): (usize, &Linear)| {
        let (term, count) = (&terms[run], linear.residuals.len() as f64);
        let believed: Vec<f64> = linear.residuals.iter().map(|&r| objective.loss.influence(r)).collect();
        let slope = linear.residuals.iter().map(|&r| objective.loss.slope(r)).sum::<f64>() / count.max(1.0);
        let correlation = correlation(&term.observations, &believed);
        let unknowns =
            point.offsets[run].len() as f64 + point.values.len() as f64 * count / (total as f64).max(1.0);
        // A slow residual is followed by the fit more easily than a quick one.
        let used = (unknowns * (1.0 + correlation) / (1.0 - correlation)).min(MOST_USED * count);
        let left = (count - used).max(1.0);
        let squares: f64 = believed.iter().map(|r| r * r).sum();
        let squares_per_degree = squares / left / slope.max(0.1).powi(2);
        let metres = term.observations.iter().zip(&believed).map(|(o, r)| (r / o.per_m).powi(2)).sum::<f64>();
        let weight = term.rehearsal.run.weight;
        let scatter = (2.0 * (1.0 + correlation.powi(2)) / (1.0 - correlation.powi(2)) / left).sqrt();
        let scale = match stated {
            true if squares_per_degree <= weight * (1.0 + BEYOND_DOUBT * scatter) => weight.sqrt(),
            _ => squares_per_degree.sqrt(),
        };
        let chi2_per_degree = squares_per_degree / weight;
        Seen { scale, correlation, chi2_per_degree, rms_m: (metres / left).sqrt() / slope.max(0.1) }
    };
    linear.iter().enumerate().map(one).collect()
}

/// The observations of each coordinate, in the order of the images.
fn series(observations: &[Observation]) -> Vec<Vec<usize>> {
    let width = observations.iter().map(|o| o.keypoint + 1).max().unwrap_or(0);
    let mut series = vec![Vec::new(); 3 * width];
    for (index, observation) in observations.iter().enumerate() {
        series[3 * observation.keypoint + observation.axis].push(index);
    }
    series
}

/// By how much `residuals` that last count for less than as many independent ones: (1 + correlation) / (1 - correlation).
pub(super) fn lasting(observations: &[Observation], residuals: &DVector<f64>) -> f64 {
    let correlation = correlation(observations, residuals.as_slice());
    (1.0 + correlation) / (1.0 - correlation)
}

fn correlation(observations: &[Observation], residuals: &[f64]) -> f64 {
    let (mut products, mut before, mut after) = (0.0, 0.0, 0.0);
    for series in series(observations) {
        for pair in series.windows(2).map(|pair| [pair[0], pair[1]]) {
            let [a, b] = pair;
            if observations[b].instant == observations[a].instant + 1 {
                products += residuals[a] * residuals[b];
                before += residuals[a] * residuals[a];
                after += residuals[b] * residuals[b];
            }
        }
    }
    let product: f64 = before * after;
    if product > 0.0 { (products / product.sqrt()).clamp(0.0, MOST_CORRELATED) } else { 0.0 }
}

/// Correlation matrix of the observations times `columns`, shape (observations, columns), in one pass forward and
/// one backward.
pub(super) fn correlated(
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
