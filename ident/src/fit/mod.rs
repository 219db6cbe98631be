//! From an experiment to a calibrated model.
//!
//! A fit estimates where and when each run starts ([`crate::initial`]), seeks the parameters at which the
//! simulated keypoints are nearest to the measured ones, and says how sure it is. What it minimises is the
//! sum of squared residuals in standard deviations plus the priors; with one noise for all and no priors that is
//! the paper's mean squared error times a constant.
//!
//! # Methods
//! * `paper`: CMA-ES as published. Standard deviations stated by a trajectory are ignored: every image and
//!   keypoint counts alike. What the paper leaves open is chosen thus:
//!   * *search space*: the bounds mapped to the unit box ([`crate::parameters::Scale`]);
//!   * *start*: the model's own values; *first step*: 0.2 of the box; *population*: 4 + 3 ln D;
//!   * *bounds*: candidates are folded back into the box, which needs no penalty weight;
//!   * *bounds' size*: fluid coefficients 0 to 10, joints by what would stop the mechanism (see there);
//!   * *convergence*: the stop criteria of [`crate::cmaes`] at a loss share of 1e-8, or `max_evaluations`;
//!   * *initial poses and release times*: fitted by least squares at anchor points and eliminated in between
//!     by linearisation, so that D stays the number of parameters and a candidate costs one simulation per run;
//!   * *evaluation cache*: holds between two anchors, since a new anchor changes every loss;
//!   * *several runs*: their images are pooled; *diverging candidates* rank last.
//! * `cma-es`: the same search, with stated standard deviations.
//! * `least-squares`: Levenberg-Marquardt from the model's values, starts and parameters together.
//! * `hybrid`: least squares from the model's values; where that leaves more than the keypoints' noise, a short
//!   search from there and least squares from its best point. Never worse than `least-squares`.
//!
//! Every method gives the same bytes for any number of threads, and goes on from a [`Checkpoint`] to the
//! result it would have reached uninterrupted.

mod checkpoint;
mod counts;
mod error;
mod finish;
mod information;
mod least_squares;
mod problem;
mod report;
mod search;

use std::time::{Duration, Instant};

use sim::{Model, State, Trajectory};

pub use checkpoint::{Checkpoint, CheckpointError, Flow, Observer, Progress};
pub use error::FitError;
pub use report::{Fit, FittedParameter, RunErrors};

use crate::experiment::{Experiment, Method, Run, Use};
use crate::initial;
use crate::loss::{Weighting, observations};
use crate::parameters::Parameters;
use crate::simulate::Rehearsal;
use checkpoint::{Stage, fingerprint};
use counts::Counts;
use least_squares::Descent;
use problem::{Problem, Term};
use search::{Search, settle};

/// A calibrated model, and how well it repeats the runs.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// `fit.json`.
    pub fit: Fit,
    /// The calibrated model.
    pub model: Model,
    /// Each run of the experiment, in its order.
    pub runs: Vec<FittedRun>,
    /// How long it took; kept apart, because [`Fit`] must not depend on it.
    pub timing: Timing,
}

/// One run beside its simulation.
#[derive(Debug, Clone)]
pub struct FittedRun {
    /// The run.
    pub id: String,
    /// Fitted or held out.
    pub usage: Use,
    /// Estimated state, held until the motion starts.
    pub initial: State,
    /// When the motion starts \[s\].
    pub start_s: f64,
    /// Errors are over the images from here on \[s\].
    pub scored_from_s: f64,
    /// The same keypoints at the same instants, from the calibrated model.
    pub simulated: Trajectory,
    /// What was measured.
    pub measured: Trajectory,
}

/// How long a fit took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// From the first estimate to the last error bar.
    pub wall: Duration,
    /// Threads that simulated.
    pub threads: usize,
}

/// Candidates of the global phase of `hybrid`, per parameter: enough to leave a bad optimum, no more.
const SEARCH_PER_PARAMETER: u64 = 20;
/// Mean squared residual, in that of the noise, up to which no other optimum is worth looking for.
const AT_THE_NOISE: f64 = 1.1;

/// Fits what `experiment` asks for.
///
/// # Errors
/// [`FitError`].
pub fn fit(experiment: &Experiment, observer: &mut dyn Observer) -> Result<Fitted, FitError> {
    run(experiment, None, observer)
}

/// Goes on from `checkpoint`, which a fit of the same experiment left, to the result that one would have reached.
///
/// # Errors
/// [`FitError`]; among them a checkpoint of another experiment.
pub fn resume(
    experiment: &Experiment,
    checkpoint: Checkpoint,
    observer: &mut dyn Observer,
) -> Result<Fitted, FitError> {
    run(experiment, Some(checkpoint), observer)
}

fn run(
    experiment: &Experiment,
    from: Option<Checkpoint>,
    observer: &mut dyn Observer,
) -> Result<Fitted, FitError> {
    let began = Instant::now();
    experiment.check()?;
    let expected = fingerprint(experiment);
    if let Some(got) = from.as_ref().map(|from| &from.experiment).filter(|got| **got != expected) {
        return Err(CheckpointError::OtherExperiment { expected, got: got.clone() }.into());
    }
    let parameters = Parameters::select(&experiment.model, &experiment.fit)?;
    let fitted_runs = || experiment.runs.iter().filter(|run| run.usage == Use::Fit);
    if fitted_runs().next().is_none() && !parameters.is_empty() {
        return Err(FitError::NothingToFit);
    }
    let noise_m = experiment
        .noise_m
        .unwrap_or_else(|| initial::noise_m(experiment.runs.iter().map(|run| &run.trajectory)));
    let use_stated = experiment.fit.method != Method::Paper;
    let mut terms = Vec::new();
    for run in fitted_runs() {
        terms.push(whole(&experiment.model, run, noise_m, use_stated)?);
    }
    let problem = Problem { model: &experiment.model, parameters: &parameters, terms };

    let mut counts = Counts::default();
    let mut driver = Driver {
        experiment,
        problem: &problem,
        fingerprint: expected,
        images: problem.terms.iter().map(|term| term.rehearsal.run.weight * term.instants as f64).sum(),
        squares: problem
            .terms
            .iter()
            .map(|term| term.rehearsal.run.weight * term.observations.len() as f64)
            .sum(),
        noise_m,
    };
    let stage = match from {
        Some(from) => {
            counts = from.counts;
            from.stage
        }
        None => driver.first_stage(&mut counts)?,
    };
    let (point, stop_reason) = driver.finish_stages(stage, &mut counts, observer)?;
    let (fit, model, runs) = finish::finish(experiment, &problem, &point, noise_m, stop_reason, counts)?;
    let timing = Timing { wall: began.elapsed(), threads: rayon::current_num_threads() };
    Ok(Fitted { fit, model, runs, timing })
}

/// A run with every image looked at.
fn whole<'a>(model: &Model, run: &'a Run, noise_m: f64, use_stated: bool) -> Result<Term<'a>, FitError> {
    let estimate = initial::estimate(model, run, noise_m)?;
    let weighting = Weighting { noise_m, use_stated, run_weight: run.weight };
    Ok(Term::new(Rehearsal::new(model, run, estimate), observations(&run.trajectory, weighting, |_| true)))
}

/// Takes a fit through its stages.
struct Driver<'a> {
    experiment: &'a Experiment,
    problem: &'a Problem<'a>,
    fingerprint: String,
    /// Weighted number of images.
    images: f64,
    /// The cost that noise alone would leave.
    squares: f64,
    noise_m: f64,
}

impl Driver<'_> {
    fn first_stage(&self, counts: &mut Counts) -> Result<Stage, FitError> {
        let config = &self.experiment.fit;
        let searches = matches!(config.method, Method::Paper | Method::CmaEs);
        if searches && config.max_evaluations > 0 && !self.problem.parameters.is_empty() {
            let start = self.problem.start();
            let search = Search::new(self.problem, start, config.seed, config.max_evaluations, counts);
            return Ok(Stage::Search(Box::new(search)));
        }
        let (point, cost) = settle(self.problem, self.problem.start(), counts);
        if cost.is_none() && config.method != Method::Hybrid {
            return Err(self.start_failed(&point));
        }
        let descent = Descent::new(point, cost);
        Ok(if config.method == Method::Hybrid { Stage::Approach(descent) } else { Stage::Descent(descent) })
    }

    /// What follows a stage that has ended, if anything does.
    fn next_stage(&self, stage: &Stage, counts: &mut Counts) -> Option<Stage> {
        match stage {
            Stage::Approach(descent) => {
                let parameters = self.problem.parameters.len() as u64;
                let left = self.experiment.fit.max_evaluations.saturating_sub(counts.evaluations);
                let most = (SEARCH_PER_PARAMETER * parameters).min(left / 2);
                if most == 0 || descent.cost.is_some_and(|cost| cost <= AT_THE_NOISE * self.squares) {
                    return None;
                }
                let (point, seed) = (descent.point.clone(), self.experiment.fit.seed);
                Some(Stage::Search(Box::new(Search::new(self.problem, point, seed, most, counts))))
            }
            Stage::Search(search) if self.experiment.fit.method == Method::Hybrid => {
                Some(Stage::Descent(Descent::new(search.anchor.clone(), search.cost)))
            }
            Stage::Search(_) | Stage::Descent(_) => None,
        }
    }

    fn finish_stages(
        &mut self,
        mut stage: Stage,
        counts: &mut Counts,
        observer: &mut dyn Observer,
    ) -> Result<(problem::Point, String), FitError> {
        let max_evaluations = self.experiment.fit.max_evaluations;
        loop {
            let (phase, cost, end) = match &mut stage {
                Stage::Search(search) => {
                    if search.stop().is_none() {
                        search.step(self.problem, counts);
                    }
                    ("search", search.cost, search.stop().map(|stop| stop.name()))
                }
                Stage::Approach(descent) | Stage::Descent(descent) => {
                    // A state may be that of a stage that had just ended.
                    if descent.end.is_none() {
                        descent.step(
                            self.problem,
                            least_squares::Freedom::Everything,
                            max_evaluations,
                            counts,
                        );
                    }
                    ("descent", descent.cost, descent.end.map(|end| end.name()))
                }
            };
            if let Some(next) = end.and_then(|_| self.next_stage(&stage, counts)) {
                stage = next;
                continue;
            }
            let checkpoint =
                Checkpoint { experiment: self.fingerprint.clone(), counts: *counts, stage: stage.clone() };
            let flow = observer.progress(&Progress {
                phase,
                evaluations: counts.evaluations,
                max_evaluations,
                rollouts: counts.rollouts,
                loss_m2: cost.map_or(f64::INFINITY, |cost| cost * self.noise_m.powi(2) / self.images),
                checkpoint: &checkpoint,
            });
            let reason = match (end, flow) {
                (Some(end), _) => end,
                (None, Flow::Stop) => "interrupted",
                (None, Flow::Continue) => continue,
            };
            let point = match stage {
                Stage::Search(mut search) => {
                    search.drop_anchor(self.problem, counts);
                    search
                        .cost
                        .map(|_| search.anchor.clone())
                        .ok_or_else(|| self.start_failed(&search.anchor))?
                }
                Stage::Approach(descent) | Stage::Descent(descent) => match descent.cost {
                    Some(_) => descent.point,
                    None => return Err(self.start_failed(&descent.point)),
                },
            };
            return Ok((point, reason.to_owned()));
        }
    }

    /// Which run cannot be simulated at `point`, and why.
    fn start_failed(&self, point: &problem::Point) -> FitError {
        let model = self.problem.parameters.applied(&point.values, self.problem.model);
        for (term, offsets) in self.problem.terms.iter().zip(&point.offsets) {
            if let Err(source) = term.rehearsal.simulate(&model, offsets, term.instants) {
                return FitError::Simulation { run: term.rehearsal.run.id.clone(), source };
            }
        }
        FitError::NoOptimum
    }
}
