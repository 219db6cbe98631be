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
//!   * *start*: the model's own values; *first step*: 0.2 of the box; *population*: 4 + 3 ln D, up to the next
//!     multiple of 8, which with AVX takes no longer;
//!   * *bounds*: candidates are folded back into the box, which needs no penalty weight;
//!   * *bounds' size*: fluid coefficients 0 to 10, joints by what would stop the mechanism (see there);
//!   * *convergence*: the stop criteria of [`crate::cmaes`] at a loss share of 1e-8, or `max_evaluations`;
//!   * *initial poses and release times*: fitted by least squares at anchor points and eliminated in between
//!     by linearisation, so that D stays the number of parameters and a candidate costs one simulation per run;
//!   * *evaluation cache*: none, since candidates drawn from a continuum do not come twice;
//!   * *several runs*: their images are pooled; *diverging candidates* rank last.
//! * `cma-es`: the same search, with stated standard deviations.
//! * `least-squares`: Levenberg-Marquardt from the model's values, starts and parameters together.
//! * `hybrid`: least squares from the model's values with loose joints (one that dry friction holds has no slope that would
//!   lead out of there, one that moves too easily has); as long as more than the keypoints' noise is left, least squares
//!   from the model's own values, a short search from the best point so far, and least squares from the best point of
//!   the search and from the best of some points drawn evenly. The search, and each descent as far as that leads, is on a rough
//!   form of the data: fewer images, coarser steps. The best end counts; [`Fit::starts`] says whether the others agree. Who has
//!   fitted the first part of the runs while the rest was filmed begins with what that came to ([`WarmStart`]) instead.
//!
//! # How sure
//! Standard deviations rest on the sensitivities at the optimum, the noise each run's residuals show and its
//! correlation in time; the starts of the runs are projected out. A parameter is called determined when its
//! deviation without priors is at most a third of its value, or of its scale's resolution, and well inside the
//! bounds; `profile = true` adds intervals that need no linearity. Where two or more runs see a parameter, their
//! values are compared.
//!
//! Every method gives the same bytes for any number of threads, and goes on from a [`Checkpoint`] to the
//! result it would have reached uninterrupted.

mod checkpoint;
mod constancy;
pub(crate) mod counts;
pub(crate) mod crossing;
pub(crate) mod driver;
mod error;
pub(crate) mod finish;
mod information;
pub(crate) mod least_squares;
mod noise;
pub(crate) mod objective;
pub(crate) mod problem;
mod profile;
mod recalibrate;
mod report;
mod rough;
mod search;
mod warm;
pub(crate) mod whitening;

use std::time::{Duration, Instant};

use rayon::prelude::*;
use sim::{Model, State, Trajectory};

pub use checkpoint::{Checkpoint, CheckpointError, Flow, Observer, Origin, Progress};
pub use error::FitError;
pub use recalibrate::{Drift, Recalibration, recalibrate};
pub use report::{
    Combination, Constancy, FirstTouch, Fit, FittedParameter, JointInformation, NoiseSeen, RunErrors,
    RunValue, StartLoss,
};
pub use warm::WarmStart;

use crate::config::{Loss, Method};
use crate::experiment::{Experiment, Run, RunKind, Use};
use crate::initial::{self, Estimate, StartError};
use crate::loss::{Weighting, observations};
use crate::parameters::Parameters;
use crate::simulate::Rehearsal;
use checkpoint::fingerprint;
use counts::Counts;
use driver::Driver;
use objective::{Belief, Objective};
use problem::{Point, Problem, Term};
use rough::Thinned;

/// The reason a fit gives that was told to stop.
pub const INTERRUPTED: &str = "interrupted";

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

impl Fitted {
    /// The calibrated model as MJCF text that begins with `comment`. Causes that MJCF holds exactly stand where MuJoCo looks
    /// for them; others stay as our own numbers, and the comment says what MuJoCo lacks.
    pub fn to_mjcf(&self, comment: &str) -> String {
        let folded = self.model.folded();
        if folded.lost.is_empty() && folded.altered.is_empty() {
            return folded.model.to_mjcf(comment);
        }
        let lost: Vec<&str> = folded.lost.iter().map(|cause| cause.name()).collect();
        let lacks = match lost[..] {
            [] => String::new(),
            _ => format!(" MuJoCo itself moves without {}.", lost.join(", ")),
        };
        self.model.to_mjcf(&format!("{comment}{lacks}"))
    }
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
    /// Geoms of the calibrated model that touch: from then on it does not move as MuJoCo would have it.
    pub touch: Option<FirstTouch>,
}

/// How long a fit took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// From the first estimate to the last error bar.
    pub wall: Duration,
    /// Threads that simulated.
    pub threads: usize,
}

/// Fits what `experiment` asks for.
///
/// # Errors
/// [`FitError`].
pub fn fit(experiment: &Experiment, observer: &mut dyn Observer) -> Result<Fitted, FitError> {
    run(experiment, None, Begin::Afresh, observer)
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
    run(experiment, None, Begin::At(Box::new(checkpoint)), observer)
}

/// As [`fit`], as far as the first start leads but for half a standard deviation; and where the fit can be resumed, if
/// more is worth a try. What the first start finds is whole: with its error bars, its held-out runs, its model. That start is
/// `warm`, where that suits the experiment.
///
/// # Errors
/// [`FitError`].
pub fn first_answer(
    experiment: &Experiment,
    warm: Option<&WarmStart>,
    observer: &mut dyn Observer,
) -> Result<(Fitted, Option<Checkpoint>), FitError> {
    let mut first = FirstStart { observer, left: None };
    let fitted = run(experiment, None, warm.map_or(Begin::Afresh, Begin::Warm), &mut first)?;
    let left = first.left.filter(|_| fitted.fit.stop_reason == INTERRUPTED);
    Ok((fitted, left))
}

/// Stops a fit where its first start has an answer.
struct FirstStart<'a> {
    observer: &'a mut dyn Observer,
    left: Option<Checkpoint>,
}

impl Observer for FirstStart<'_> {
    fn progress(&mut self, progress: &Progress<'_>) -> Flow {
        if self.observer.progress(progress) == Flow::Stop {
            return Flow::Stop;
        }
        if progress.is_answer {
            self.left = Some(progress.checkpoint.clone());
            return Flow::Stop;
        }
        Flow::Continue
    }
}

/// Where a fit begins.
enum Begin<'a> {
    /// At the model's values, as its method says.
    Afresh,
    /// With a descent from here, which nothing rough has to precede.
    Warm(&'a WarmStart),
    /// Where it was left.
    At(Box<Checkpoint>),
}

/// What an earlier fit says about the parameters of this one.
type Inherited<'a> = dyn Fn(&Parameters) -> Result<Belief, FitError> + 'a;

fn run(
    experiment: &Experiment,
    belief: Option<&Inherited<'_>>,
    begin: Begin<'_>,
    observer: &mut dyn Observer,
) -> Result<Fitted, FitError> {
    let began = Instant::now();
    experiment.check()?;
    let expected = fingerprint(experiment);
    let mut model = experiment.model.clone();
    experiment.fit.add_named_causes(&mut model);
    let model = &model;
    if let Begin::At(state) = &begin
        && state.experiment != expected
    {
        return Err(CheckpointError::OtherExperiment { expected, got: state.experiment.clone() }.into());
    }
    let parameters = Parameters::select(model, &experiment.fit)?;
    let fitted_runs = || experiment.runs.iter().filter(|run| run.usage == Use::Fit);
    if fitted_runs().next().is_none() && !parameters.is_empty() {
        return Err(FitError::NothingToFit);
    }
    unmoved(model, experiment, &parameters)?;
    let assumed = AssumedNoise::of(experiment);
    let use_stated = experiment.fit.method != Method::Paper;
    let fitted_runs: Vec<&Run> = fitted_runs().collect();
    let estimates = fitted_runs.par_iter().map(|run| initial::estimate(model, run, assumed.of_run(run)));
    // all of them, and the error of the first that has one
    let estimates: Vec<Result<Estimate, StartError>> = estimates.collect();
    let estimates = estimates.into_iter().collect::<Result<Vec<Estimate>, StartError>>()?;
    let hybrid = experiment.fit.method == Method::Hybrid;
    let warm = match &begin {
        Begin::Warm(warm) if hybrid => warm.values(&parameters).map(|values| (warm, values)),
        _ => None,
    };
    let roughly = hybrid && warm.is_none();
    let thinned = |(run, estimate): (&&Run, &Estimate)| Thinned::new(run, estimate.start.start_s);
    let thinned: Vec<Thinned> = match roughly {
        true => fitted_runs.iter().zip(&estimates).map(thinned).collect(),
        false => Vec::new(),
    };
    let terms = fitted_runs.par_iter().zip(&estimates).enumerate().map(|(index, (run, estimate))| {
        let weighting = Weighting { noise_m: assumed.of_run(run), use_stated, run_weight: run.weight };
        let rough = || thinned.get(index).map(|thinned| thinned.term(model, estimate.clone(), weighting));
        rayon::join(|| whole(model, run, estimate.clone(), weighting), rough)
    });
    let (terms, rough): (Vec<Term>, Vec<Option<Term>>) = terms.unzip();
    let loss = if experiment.fit.method == Method::Paper { Loss::Squares } else { experiment.fit.loss };
    let belief = belief.map(|belief| belief(&parameters)).transpose()?;
    let problem = Problem { model, parameters: &parameters, terms };
    let objective = Objective { problem, loss, belief };

    let mut counts = Counts::default();
    let terms = &objective.problem.terms;
    let images: f64 = terms.iter().map(|term| term.rehearsal.run.weight * term.instants as f64).sum();
    // Of weights that may differ from cell to cell, the mean.
    let precisions: f64 = terms
        .iter()
        .flat_map(|term| term.observations.iter().map(|o| o.per_m.powi(2) / term.rehearsal.run.weight))
        .sum();
    let observations: usize = terms.iter().map(|term| term.observations.len()).sum();
    let squares = terms.iter().map(|term| term.rehearsal.run.weight * term.observations.len() as f64).sum();
    let rough = roughly.then(|| rough::rough(&objective, rough.into_iter().flatten().collect()));
    let driver = Driver {
        experiment,
        objective: &objective,
        rough: rough.as_ref(),
        fingerprint: expected,
        loss_m2: observations as f64 / precisions / images,
        squares,
    };
    let state = match begin {
        Begin::At(state) => {
            counts = state.counts;
            *state
        }
        Begin::Warm(_) | Begin::Afresh => {
            let start = warm.map(|(warm, values)| {
                let terms = objective.problem.terms.iter();
                Point { values, offsets: terms.map(|term| warm.offsets(model, &term.rehearsal)).collect() }
            });
            driver.first(start, &mut counts)
        }
    };
    let arrival = driver.finish(state, &mut counts, observer)?;
    let (fit, model, runs) = finish::finish(experiment, &objective, arrival, &assumed, counts)?;
    let timing = Timing { wall: began.elapsed(), threads: rayon::current_num_threads() };
    Ok(Fitted { fit, model, runs, timing })
}

/// Refuses a drive's gain that no fitted run drives, and a joint's resistance that every one overrides: their
/// sensitivities are nothing but zeros.
fn unmoved(model: &Model, experiment: &Experiment, parameters: &Parameters) -> Result<(), FitError> {
    use sim::model::Parameter::{Damping, FrictionLoss, Gain, Stiffness};
    let drives = |run: &Run, joint: usize| {
        let commanded = run.command.iter().flat_map(|command| &command.actuators);
        run.kind == RunKind::Driven
            && commanded.into_iter().any(|name| {
                model.actuators.iter().any(|actuator| actuator.joint == joint && actuator.name == *name)
            })
    };
    let moved = |place: &sim::model::Parameter| {
        let mut runs = experiment.runs.iter().filter(|run| run.usage == Use::Fit);
        match *place {
            Gain(actuator) => runs.any(|run| !run.prescribed && drives(run, model.actuators[actuator].joint)),
            Damping(joint) | FrictionLoss(joint) | Stiffness(joint, _) => {
                runs.any(|run| !(run.prescribed && drives(run, joint)))
            }
            _ => true,
        }
    };
    let names: Vec<String> = parameters
        .free
        .iter()
        .filter(|parameter| parameter.prior.is_none() && !parameter.places.iter().any(moved))
        .map(|parameter| parameter.name().to_owned())
        .collect();
    if names.is_empty() { Ok(()) } else { Err(FitError::Unseen { names }) }
}

/// Keypoint noise before the fit, one standard deviation per coordinate \[m\].
struct AssumedNoise {
    /// Somebody stated it.
    stated: bool,
    /// Of all runs together.
    common_m: f64,
    /// Of each run, in the order of the experiment.
    runs_m: Vec<(String, f64)>,
}

impl AssumedNoise {
    /// As stated; else as the images of each run tell. `paper` weighs all runs alike.
    fn of(experiment: &Experiment) -> Self {
        let common_m = experiment
            .noise_m
            .unwrap_or_else(|| initial::noise_m(experiment.runs.iter().map(|run| &run.trajectory)));
        let own = experiment.noise_m.is_none() && experiment.fit.method != Method::Paper;
        let of_run = |run: &Run| if own { initial::run_noise(run).std_m } else { common_m };
        let runs_m = experiment.runs.iter().map(|run| (run.id.clone(), of_run(run))).collect();
        Self { stated: experiment.noise_m.is_some(), common_m, runs_m }
    }

    fn of_run(&self, run: &Run) -> f64 {
        self.runs_m.iter().find(|(id, _)| *id == run.id).map_or(self.common_m, |(_, noise_m)| *noise_m)
    }
}

/// A run with every image looked at.
fn whole<'a>(model: &Model, run: &'a Run, estimate: Estimate, weighting: Weighting) -> Term<'a> {
    Term::new(
        Rehearsal::new(model, run, estimate, weighting.noise_m),
        observations(&run.trajectory, weighting, |_| true),
    )
}
