//! How well the model repeats an experiment: as it stands, and after a quick fit.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use sim::{Model, Trajectory};

use crate::experiment::{Experiment, Method, Run, Use};
use crate::fit::counts::Counts;
use crate::fit::repeat::hold_out;
use crate::fit::{self, FittedRun, Flow};
use crate::initial::{self, run_noise};
use crate::simulate::Rehearsal;

/// Parameter vectors that a quick fit tries at most (chosen): a right description takes a tenth of them, a wrong one would wander.
const EVALUATIONS_MAX: u64 = 200;
/// A quick fit ends where two iterations gain less than this share of the loss (chosen): errors are compared by factors.
const LOSS_SHARE_MIN: f64 = 0.04;
/// Residuals of up to this many times the noise count as explained (chosen): images by themselves tell noise to some 10 %.
const EXPLAINED_RATIO_MAX: f64 = 1.7;

/// How far a run is off.
#[derive(Debug, Clone, Copy)]
pub(super) struct RunError {
    /// Root mean square of a coordinate's residual over its noise, 1 at the least.
    pub(super) over_noise: f64,
    /// Independent numbers in its residuals, at the least: what a model gets wrong lasts, so that each coordinate of each keypoint counts
    /// once a run.
    pub(super) count: f64,
}

impl RunError {
    fn new(measured: &Trajectory, simulated_m: &[[f64; 3]], from_s: f64, noise_m: f64) -> Option<Self> {
        let width = measured.keypoints.len();
        let (mut squares, mut cells) = (0.0, 0.0);
        for (instant, _) in measured.time_s.iter().enumerate().filter(|(_, time_s)| **time_s >= from_s) {
            for keypoint in 0..width {
                let (there, here) = (measured.at(instant, keypoint), simulated_m[instant * width + keypoint]);
                for off_m in (0..3).map(|axis| there[axis] - here[axis]).filter(|off_m| off_m.is_finite()) {
                    squares += off_m * off_m;
                    cells += 1.0;
                }
            }
        }
        let seen = |keypoint: usize, axis: usize| {
            (0..measured.time_s.len()).any(|instant| measured.at(instant, keypoint)[axis].is_finite())
        };
        let count =
            (0..width).flat_map(|k| (0..3).map(move |axis| (k, axis))).filter(|&(k, a)| seen(k, a)).count();
        let over_noise = (squares / cells).sqrt() / noise_m;
        (cells > 0.0).then(|| Self { over_noise: over_noise.max(1.0), count: count as f64 })
    }
}

/// How well all runs are repeated, in the order of the experiment.
#[derive(Debug, Clone)]
pub(super) struct Trial {
    pub(super) errors: Vec<RunError>,
    /// The runs beside their simulation; empty where nothing was fitted.
    pub(super) runs: Vec<FittedRun>,
    /// The model with what was fitted.
    pub(super) model: Model,
}

impl Trial {
    /// Logarithm of its likelihood where nobody knows how far a model is off: each independent number's error is its scale.
    pub(super) fn ln_likelihood(&self) -> f64 {
        -self.errors.iter().map(|error| error.count * error.over_noise.ln()).sum::<f64>()
    }

    /// Independent numbers in all.
    pub(super) fn count(&self) -> f64 {
        self.errors.iter().map(|error| error.count).sum()
    }

    /// Whether all that is left is noise.
    pub(super) fn is_explained(&self) -> bool {
        self.errors.iter().all(|error| error.over_noise < EXPLAINED_RATIO_MAX)
    }
}

/// The runs of `experiment` with the model's own numbers; `None` where one cannot be simulated.
pub(super) fn unfitted(experiment: &Experiment, counts: &mut Counts) -> Option<Trial> {
    let error = |run: &Run, counts: &mut Counts| {
        if counts.is_stopped() {
            return None;
        }
        counts.rollouts += 1;
        unfitted_run(&experiment.model, run)
    };
    let errors = counts.of_each(experiment.runs.iter().collect(), |run, counts| error(run, counts));
    Some(Trial {
        errors: errors.into_iter().collect::<Option<_>>()?,
        runs: Vec::new(),
        model: experiment.model.clone(),
    })
}

fn unfitted_run(model: &Model, run: &Run) -> Option<RunError> {
    let noise_m = run_noise(run).std_m;
    let estimate = initial::estimate(model, run, noise_m).ok()?;
    let rehearsal = Rehearsal::as_modelled(model, run, estimate).in_one_try();
    let offsets = vec![0.0; rehearsal.nuisances.len()];
    let simulated_m = rehearsal.simulate(model, &offsets, run.trajectory.time_s.len()).ok()?;
    RunError::new(&run.trajectory, &simulated_m, f64::NEG_INFINITY, noise_m)
}

/// The runs of `experiment` after a quick fit of those that are to be fitted; of the others only the start follows. `None` where there is
/// no optimum.
pub(super) fn fitted(experiment: &Experiment, counts: &mut Counts) -> Option<Trial> {
    let mut quick = experiment.clone();
    quick.fit.method = Method::LeastSquares;
    quick.fit.profile = false;
    quick.runs.retain(|run| run.usage == Use::Fit);
    let fitted = fit::fit(&quick, &mut Quick { counts, losses_m2: Vec::new() }).ok()?;
    counts.rollouts += fitted.fit.rollouts;
    let mut repeated = fitted.runs.into_iter();
    let runs: Option<Vec<FittedRun>> = experiment
        .runs
        .iter()
        .map(|run| match run.usage {
            Use::Fit => repeated.next(),
            Use::Holdout => {
                hold_out(&fitted.model, run, run_noise(run).std_m, (&[], WHOLE_RUN_START_SHARE), counts).ok()
            }
        })
        .collect();
    let error = |(run, given): (&FittedRun, &Run)| {
        RunError::new(&run.measured, &run.simulated.position_m, run.start_s, run_noise(given).std_m)
    };
    let runs = runs?;
    let errors = runs.iter().zip(&experiment.runs).map(error).collect::<Option<_>>()?;
    Some(Trial { errors, runs, model: fitted.model })
}

/// All of a run, from which its start follows.
const WHOLE_RUN_START_SHARE: f64 = 1.0;

/// Ends a fit that wanders, that no longer gets on, or for which nobody waits.
struct Quick<'a> {
    counts: &'a Counts,
    /// Losses after the iterations so far \[m2\].
    losses_m2: Vec<f64>,
}

impl fit::Observer for Quick<'_> {
    fn interrupted(&self) -> Arc<AtomicBool> {
        self.counts.stop()
    }

    fn progress(&mut self, progress: &fit::Progress<'_>) -> Flow {
        self.losses_m2.push(progress.loss_m2);
        let has_stalled = match self.losses_m2[..] {
            [.., before, _, now] => now > (1.0 - LOSS_SHARE_MIN) * before,
            _ => false,
        };
        let is_over = has_stalled || progress.evaluations > EVALUATIONS_MAX || self.counts.is_stopped();
        if is_over { Flow::Stop } else { Flow::Continue }
    }
}
