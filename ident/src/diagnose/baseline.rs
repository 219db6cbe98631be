//! The baseline: the model as it stands, fitted as `[fit]` says, at its optimum, with the noise floor that goes with it.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use rayon::prelude::*;
use sim::model::Parameter;

use super::DiagnoseError;
use crate::config::Method;
use crate::experiment::{Experiment, Run, Use};
use crate::fit::counts::Counts;
use crate::fit::problem::Term;
use crate::fit::{self, FitError, FittedParameter, Flow};
use crate::hypothesis::state::{State, relative_std};
use crate::initial::{self, StartError};
use crate::loss::{Weighting, observations};
use crate::noise::floor::{Floor, Seen, floor};
use crate::noise::pose::PoseErrors;
use crate::noise::stamps::velocities;
use crate::parameters::Parameters;
use crate::simulate::Rehearsal;

/// Times that floor and fit are found in turn: one needs the other.
const MOST_TURNS: usize = 3;
/// A noise floor that moves by less than this share has been found: the fit would not move with it.
const SAME_FLOOR_SHARE: f64 = 0.01;

/// The fitted baseline of `experiment`, and its noise floor.
pub(crate) fn baseline<'a>(
    experiment: &'a Experiment,
    parameters: Parameters,
    counts: &mut Counts,
) -> Result<(State<'a>, Floor), DiagnoseError> {
    let term = |run: &'a Run| -> Result<Term<'a>, StartError> {
        let seen = initial::run_noise(run);
        let noise_m = experiment.noise_m.unwrap_or(seen.std_m);
        let estimate = initial::estimate(&experiment.model, run, noise_m)?;
        let weighting = Weighting { noise_m: seen.std_m, use_stated: false, run_weight: 1.0 };
        let list = observations(&run.trajectory, weighting, |_| true);
        Ok(Term::new(Rehearsal::new(&experiment.model, run, estimate, noise_m), list))
    };
    let fitted = experiment.runs.par_iter().filter(|run| run.usage == Use::Fit);
    // all of them, and the error of the first that has one
    let terms: Vec<Result<Term<'a>, StartError>> = fitted.map(term).collect();
    let terms = terms.into_iter().collect::<Result<Vec<Term<'a>>, StartError>>()?;
    if terms.is_empty() {
        return Err(FitError::NothingToFit.into());
    }
    let mut state = State::baseline(&experiment.model, parameters, terms);
    // dry friction has optima of its own, where a joint sticks: a search is as wanted as in a fit
    let sticks = state.parameters.places().iter().any(|place| matches!(place, Parameter::FrictionLoss(_)));
    let searches = sticks && experiment.fit.method != Method::LeastSquares;
    if searches || !state.descend(counts) {
        let mut wider = experiment.clone();
        wider.fit.method = Method::Hybrid;
        match fit::fit(&wider, &mut Watched(counts)) {
            Ok(fitted) => {
                counts.rollouts += fitted.fit.rollouts;
                for (value, parameter) in state.point.values.iter_mut().zip(&state.parameters.free) {
                    let named = |found: &&FittedParameter| found.name == parameter.name();
                    if let Some(found) = fitted.fit.parameters.iter().find(named) {
                        *value = found.value;
                    }
                }
            }
            // where a joint sticks, derivatives may outgrow all numbers at what a search ends with: then from the model's own values
            Err(FitError::NoOptimum) => {}
            Err(error) => return Err(error.into()),
        }
        if !state.descend(counts) {
            return Err(FitError::NoOptimum.into());
        }
    }
    let mut floor: Option<Floor> = None;
    for _ in 0..MOST_TURNS {
        let next = seen_floor(&state)?;
        let same = floor.as_ref().is_some_and(|before| is_same(before, &next, SAME_FLOOR_SHARE));
        state.weigh(&next);
        if floor.is_none() {
            state.replan(next.noise_m, counts);
        }
        floor = Some(next);
        if !state.descend(counts) {
            return Err(FitError::NoOptimum.into());
        }
        if same {
            break;
        }
    }
    floor.map(|floor| (state, floor)).ok_or_else(|| FitError::NoOptimum.into())
}

/// Ends a fit for which nobody waits.
struct Watched<'a>(&'a Counts);

impl fit::Observer for Watched<'_> {
    fn interrupted(&self) -> Arc<AtomicBool> {
        self.0.stop()
    }

    fn progress(&mut self, _: &fit::Progress<'_>) -> Flow {
        if self.0.is_stopped() { Flow::Stop } else { Flow::Continue }
    }
}

/// The floor that the residuals of `state` show.
pub(super) fn seen_floor(state: &State<'_>) -> Result<Floor, DiagnoseError> {
    let raw: Option<Vec<Vec<f64>>> = (0..state.terms.len()).map(|run| state.raw_residuals(run)).collect();
    let raw = raw.ok_or(FitError::NoOptimum)?;
    let weighed = |term: &Term<'_>| -> Vec<f64> {
        let trajectory = &term.rehearsal.run.trajectory;
        let (width, relative) = (trajectory.keypoints.len(), relative_std(trajectory));
        let list = velocities(trajectory, &term.observations);
        let cells = term.observations.iter().map(|o| relative[o.instant * width + o.keypoint]);
        list.iter().zip(cells).map(|(velocity, relative)| velocity / relative).collect()
    };
    let velocities: Vec<Vec<f64>> = state.terms.iter().map(weighed).collect();
    let seen: Vec<Seen<'_>> = state
        .terms
        .iter()
        .zip(raw.iter().zip(&velocities))
        .enumerate()
        .map(|(run, (term, (residuals, velocities)))| Seen {
            id: &term.rehearsal.run.id,
            observations: &term.observations,
            residuals,
            velocities,
            time_s: &term.rehearsal.run.trajectory.time_s,
            start_s: state.start_s(run),
            pose_std_m: PoseErrors::of(&term.rehearsal.run.trajectory).map(|errors| errors.rms_m()),
        })
        .collect();
    Ok(floor(&seen))
}

/// Whether two floors agree to a share `within`.
pub(super) fn is_same(a: &Floor, b: &Floor, within: f64) -> bool {
    let stds = a.runs.iter().flat_map(|run| &run.std_m).zip(b.runs.iter().flat_map(|run| &run.std_m));
    (a.correlation - b.correlation).abs() <= within
        && (a.stamp_std_s - b.stamp_std_s).abs() <= within * a.stamp_std_s.max(b.stamp_std_s)
        && stds.into_iter().all(|(a, b)| (a / b - 1.0).abs() <= within)
}
