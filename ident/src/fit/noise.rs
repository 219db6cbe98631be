//! Noise that a fit assumes, and what the residuals at the optimum say about it: its size and how long it lasts.
//!
//! Residuals that a wrong model leaves are correlated, too, and widen the error bars just so.

use super::objective::Objective;
use super::problem::{Linear, Point};
use crate::config::Method;
use crate::experiment::{Experiment, Run};
use crate::initial;
use crate::noise::{correlation, noise_m};

/// Noise of one run as its residuals show it, relative to what was assumed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ResidualNoise {
    /// True over assumed standard deviation.
    pub(super) scale: f64,
    /// Correlation from one image to the next, 0 to 1.
    pub(super) correlation: f64,
    /// Squares of the residuals in assumed standard deviations, per degree of freedom, each image counted once.
    pub(super) chi2_per_degree: f64,
    /// Root mean square of the residuals per degree of freedom \[m\].
    pub(super) rms_m: f64,
}

/// A stated noise is believed unless the mean square of the residuals exceeds it by this many of its standard deviations (chosen).
const STATED_NOISE_REFUTED_Z: f64 = 4.0;
/// Parameters and correlation are taken to use up at most this share of a run's degrees of freedom (chosen).
const USED_DEGREES_SHARE_MAX: f64 = 0.5;

/// Each run's noise, from its residuals in `linear`. A `stated` noise is only ever enlarged.
pub(super) fn residual_noise(
    objective: &Objective<'_>,
    point: &Point,
    linear: &[Linear],
    stated: bool,
) -> Vec<ResidualNoise> {
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
        let used = (unknowns * (1.0 + correlation) / (1.0 - correlation)).min(USED_DEGREES_SHARE_MAX * count);
        let left = (count - used).max(1.0);
        let squares: f64 = believed.iter().map(|r| r * r).sum();
        let squares_per_degree = squares / left / slope.max(0.1).powi(2);
        let metres = term.observations.iter().zip(&believed).map(|(o, r)| (r / o.per_m).powi(2)).sum::<f64>();
        let weight = term.rehearsal.run.weight;
        let scatter = (2.0 * (1.0 + correlation.powi(2)) / (1.0 - correlation.powi(2)) / left).sqrt();
        let scale = match stated {
            true if squares_per_degree <= weight * (1.0 + STATED_NOISE_REFUTED_Z * scatter) => weight.sqrt(),
            _ => squares_per_degree.sqrt(),
        };
        let chi2_per_degree = squares_per_degree / weight;
        ResidualNoise { scale, correlation, chi2_per_degree, rms_m: (metres / left).sqrt() / slope.max(0.1) }
    };
    linear.iter().enumerate().map(one).collect()
}

/// Keypoint noise before the fit, one standard deviation per coordinate \[m\].
pub(super) struct AssumedNoise {
    /// Whether the experiment states it.
    pub(super) stated: bool,
    /// Of all runs together.
    pub(super) common_m: f64,
    /// Of each run, in the order of the experiment.
    runs_m: Vec<(String, f64)>,
}

impl AssumedNoise {
    /// As stated; else as the images of each run tell. `paper` weighs all runs alike.
    pub(super) fn of(experiment: &Experiment) -> Self {
        let common_m =
            experiment.noise_m.unwrap_or_else(|| noise_m(experiment.runs.iter().map(|run| &run.trajectory)));
        let per_run = experiment.noise_m.is_none() && experiment.fit.method != Method::Paper;
        let of_run = |run: &Run| if per_run { initial::run_noise(run).std_m } else { common_m };
        let runs_m = experiment.runs.iter().map(|run| (run.id.clone(), of_run(run))).collect();
        Self { stated: experiment.noise_m.is_some(), common_m, runs_m }
    }

    pub(super) fn of_run(&self, run: &Run) -> f64 {
        self.runs_m.iter().find(|(id, _)| *id == run.id).map_or(self.common_m, |(_, noise_m)| *noise_m)
    }
}
