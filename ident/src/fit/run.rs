//! A fit from the experiment to the calibrated model: everything made ready, driven through its stages, finished.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use rayon::prelude::*;
use sim::Model;
use sim::model::ActuatorKind;

use super::checkpoint::{Checkpoint, CheckpointError, Flow, INTERRUPTED, Observer, Progress, fingerprint};
use super::counts::Counts;
use super::driver::Driver;
use super::error::FitError;
use super::finish;
use super::fitted::{Fitted, Timing};
use super::noise::AssumedNoise;
use super::objective::{Belief, Objective};
use super::problem::{Point, Problem, Term};
use super::rough::{self, Thinned};
use super::warm_start::WarmStart;
use crate::config::{Loss, Method};
use crate::experiment::{Experiment, Run, RunKind, Use};
use crate::initial::{self, Estimate};
use crate::initial::{free_parameters, prescribed_dofs};
use crate::loss::{Weighting, observations};
use crate::parameters::Parameters;
use crate::simulate::Rehearsal;

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
    fn interrupted(&self) -> Arc<AtomicBool> {
        self.observer.interrupted()
    }

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
pub(super) enum Begin<'a> {
    /// At the model's values, as its method says.
    Afresh,
    /// With a descent from here, which nothing rough has to precede.
    Warm(&'a WarmStart),
    /// Where it was left.
    At(Box<Checkpoint>),
}

/// What an earlier fit says about the parameters of this one.
pub(super) type Inherited<'a> = dyn Fn(&Parameters) -> Result<Belief, FitError> + 'a;

/// A fit from where it begins to its end, with what an earlier one says as a `belief`.
pub(super) fn run(
    experiment: &Experiment,
    belief: Option<&Inherited<'_>>,
    begin: Begin<'_>,
    observer: &mut dyn Observer,
) -> Result<Fitted, FitError> {
    let began = Instant::now();
    let mut counts = Counts::until(observer.interrupted());
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
    let parameters = free_parameters(model, experiment)?;
    let fitted_runs = || experiment.runs.iter().filter(|run| run.usage == Use::Fit);
    if fitted_runs().next().is_none() && !parameters.is_empty() {
        return Err(FitError::NothingToFit);
    }
    refuse_without_effect(model, experiment, &parameters)?;
    let assumed = AssumedNoise::of(experiment);
    let use_stated = experiment.fit.method != Method::Paper;
    let fitted_runs: Vec<&Run> = fitted_runs().collect();
    let waited_for = || if counts.is_stopped() { Err(FitError::Interrupted) } else { Ok(()) };
    let estimates = fitted_runs.par_iter().map(|run| {
        waited_for()?;
        Ok(initial::estimate(model, run, assumed.of_run(run))?)
    });
    // all of them, and the error of the first that has one
    let estimates: Vec<Result<Estimate, FitError>> = estimates.collect();
    let estimates = estimates.into_iter().collect::<Result<Vec<Estimate>, FitError>>()?;
    let hybrid = experiment.fit.method == Method::Hybrid;
    let warm = match &begin {
        Begin::Warm(warm) if hybrid => warm.values(&parameters).map(|values| (warm, values)),
        _ => None,
    };
    let with_rough = hybrid && warm.is_none();
    let thinned = |(run, estimate): (&&Run, &Estimate)| Thinned::new(run, estimate.start.start_s);
    let thinned: Vec<Thinned> = match with_rough {
        true => fitted_runs.iter().zip(&estimates).map(thinned).collect(),
        false => Vec::new(),
    };
    waited_for()?;
    let terms = fitted_runs.par_iter().zip(&estimates).enumerate().map(|(index, (run, estimate))| {
        let weighting = Weighting { noise_m: assumed.of_run(run), use_stated, run_weight: run.weight };
        let rough = || thinned.get(index).map(|thinned| thinned.term(model, estimate.clone(), weighting));
        waited_for().map(|()| rayon::join(|| whole(model, run, estimate.clone(), weighting), rough))
    });
    let terms = terms.collect::<Result<Vec<(Term, Option<Term>)>, FitError>>()?;
    let (terms, rough): (Vec<Term>, Vec<Option<Term>>) = terms.into_iter().unzip();
    let loss = if experiment.fit.method == Method::Paper { Loss::Squares } else { experiment.fit.loss };
    let belief = belief.map(|belief| belief(&parameters)).transpose()?;
    let problem = Problem { model, parameters: &parameters, terms };
    let objective = Objective { problem, loss, belief };

    let rough = with_rough.then(|| rough::rough(&objective, rough.into_iter().flatten().collect()));
    let driver = Driver::new(experiment, &objective, rough.as_ref(), expected);
    let state = match begin {
        Begin::At(state) => {
            counts.return_to(&state.counts);
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
    if counts.is_stopped() {
        return Err(FitError::Interrupted);
    }
    let arrival = driver.finish(state, &mut counts, observer)?;
    let finished = finish::finish(experiment, &objective, arrival, &assumed, &mut counts);
    if counts.is_stopped() {
        // what was not simulated any more looks as if it could not be
        return Err(FitError::Interrupted);
    }
    let (fit, model, runs) = finished?;
    let timing = Timing { wall: began.elapsed(), threads: rayon::current_num_threads() };
    Ok(Fitted { fit, model, runs, timing })
}

/// Refuses a drive's gain that no fitted run drives, and a joint's resistance that every one overrides: their
/// sensitivities are nothing but zeros.
fn refuse_without_effect(
    model: &Model,
    experiment: &Experiment,
    parameters: &Parameters,
) -> Result<(), FitError> {
    use sim::model::Parameter::{Damping, FrictionLoss, Gain, Stiffness};
    let drives = |run: &Run, joint: usize| {
        let commanded = run.command.iter().flat_map(|command| &command.actuators);
        run.kind != RunKind::Drop
            && commanded.into_iter().any(|name| {
                model.actuators.iter().any(|actuator| actuator.joint == joint && actuator.name == *name)
            })
    };
    let moved = |place: &sim::model::Parameter| {
        let mut runs = experiment.runs.iter().filter(|run| run.usage == Use::Fit);
        match *place {
            Gain(actuator) => runs.any(|run| {
                let actuator = &model.actuators[actuator];
                !(run.prescribed && actuator.kind == ActuatorKind::Position) && drives(run, actuator.joint)
            }),
            Damping(joint) | FrictionLoss(joint) | Stiffness(joint, _) => {
                runs.any(|run| !prescribed_dofs(model, run)[model.joints[joint].dof_address])
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

/// A run with every image looked at.
fn whole<'a>(model: &Model, run: &'a Run, estimate: Estimate, weighting: Weighting) -> Term<'a> {
    Term::new(
        Rehearsal::new(model, run, estimate, weighting.noise_m),
        observations(&run.trajectory, weighting, |_| true),
    )
}
