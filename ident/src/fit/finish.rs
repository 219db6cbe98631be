//! From the optimum to error bars, held-out runs and `fit.json`.

use sim::{Model, Trajectory};

use super::counts::Counts;
use super::information::{Information, information};
use super::least_squares::{Descent, Freedom};
use super::problem::{Point, Problem, Term};
use super::{Fit, FitError, FittedParameter, FittedRun, RunErrors};
use crate::experiment::{Experiment, Run, RunKind, Use};
use crate::geometry::characteristic_length_m;
use crate::initial;
use crate::loss::{SquaredError, Weighting, keypoint_errors, observations};
use crate::parameters::Parameters;
use crate::simulate::Rehearsal;

/// A value this share of the bounds' width from a bound lies on it.
const AT_BOUND: f64 = 1e-9;

pub(super) fn finish(
    experiment: &Experiment,
    problem: &Problem<'_>,
    point: &Point,
    assumed_noise_m: f64,
    stop_reason: String,
    mut counts: Counts,
) -> Result<(Fit, Model, Vec<FittedRun>), FitError> {
    let noise_scale = match experiment.noise_m {
        Some(_) => 1.0,
        None => noise_scale(problem, point, &mut counts).unwrap_or(1.0),
    };
    let noise_m = assumed_noise_m * noise_scale;
    let known = information(problem, point, noise_scale, &mut counts).ok_or(FitError::NoOptimum)?;
    let model = problem.parameters.applied(&point.values, &experiment.model);

    let mut runs = Vec::new();
    let mut error = SquaredError::default();
    let mut fitted = problem.terms.iter().zip(&point.offsets);
    for run in &experiment.runs {
        let repeated = match (run.usage, &mut fitted) {
            (Use::Fit, terms) => {
                let Some((term, offsets)) = terms.next() else { continue };
                counts.rollouts += 1;
                let start = term.rehearsal.start_with(&model, offsets);
                let repeated = repeat(&model, &term.rehearsal, offsets, start.start_s)?;
                error.add(&run.trajectory, &repeated.simulated.position_m, start.start_s, run.weight);
                repeated
            }
            (Use::Holdout, _) => hold_out(&model, run, noise_m, &mut counts)?,
        };
        runs.push(repeated);
    }

    let fit = Fit {
        method: experiment.fit.method.name().into(),
        seed: experiment.fit.seed,
        evaluations: counts.evaluations,
        rollouts: counts.rollouts,
        stop_reason,
        loss_m2: error.loss_m2(),
        noise_m,
        parameters: fitted_parameters(problem.parameters, point, &known),
        runs: runs
            .iter()
            .map(|run| RunErrors {
                id: run.id.clone(),
                usage: run.usage,
                keypoints: keypoint_errors(&run.measured, &run.simulated.position_m, run.scored_from_s),
            })
            .collect(),
        characteristic_length_m: characteristic_length_m(&experiment.model),
        unidentifiable: known
            .groups
            .iter()
            .map(|group| group.iter().map(|&i| problem.parameters.free[i].name().to_owned()).collect())
            .collect(),
    };
    Ok((fit, model, runs))
}

/// Root mean square of the residuals in assumed standard deviations, per degree of freedom left.
fn noise_scale(problem: &Problem<'_>, point: &Point, counts: &mut Counts) -> Option<f64> {
    let observations: usize = problem.terms.iter().map(|term| term.observations.len()).sum();
    let unknowns = point.values.len() + point.offsets.iter().map(Vec::len).sum::<usize>();
    let left = observations.checked_sub(unknowns).filter(|left| *left > 0)?;
    let cost = problem.costs_of_rollouts(std::slice::from_ref(point), counts)[0];
    let data = cost - problem.prior_cost(&point.values);
    Some((data / left as f64).sqrt()).filter(|scale| scale.is_finite() && *scale > 0.0)
}

fn fitted_parameters(parameters: &Parameters, point: &Point, known: &Information) -> Vec<FittedParameter> {
    let mut list = Vec::new();
    for (i, parameter) in parameters.free.iter().enumerate() {
        let (scale, value) = (&parameter.scale, point.values[i]);
        let near = AT_BOUND * scale.width();
        list.extend(parameter.names.iter().map(|name| FittedParameter {
            name: name.clone(),
            value,
            std: known.std[i],
            lower: scale.lower(),
            upper: scale.upper(),
            at_bound: value - scale.lower() <= near || scale.upper() - value <= near,
            determined: known.determined[i],
        }));
    }
    list
}

/// Scores a held-out run: its start comes from its still images alone, or where there are none (`free`, or let
/// go before the first image) from the first `init_s` seconds of motion, which are not scored. A release that
/// nobody stated is seen in the motion only, and takes the same share of it.
fn hold_out(model: &Model, run: &Run, noise_m: f64, counts: &mut Counts) -> Result<FittedRun, FitError> {
    let estimate = initial::estimate(model, run, noise_m)?;
    let start_s = estimate.start.start_s;
    let has_still = run.kind != RunKind::Free && run.trajectory.time_s[0] <= start_s;
    let window_s = match estimate.release {
        Some(release) => release.latest_s + run.init_s,
        None if has_still || run.initial.is_some() => start_s,
        None => start_s.max(run.trajectory.time_s[0]) + run.init_s,
    };
    let weighting = Weighting { noise_m, use_stated: true, run_weight: 1.0 };
    let seen = observations(&run.trajectory, weighting, |time_s| time_s <= window_s);
    let term = Term::new(Rehearsal::new(model, run, estimate), seen);
    let nothing = Parameters::default();
    let problem = Problem { model, parameters: &nothing, terms: vec![term] };
    let mut descent = Descent::new(problem.start(), None);
    descent.run(&problem, Freedom::Nuisances, counts);
    let offsets = descent.point.offsets.concat();
    counts.rollouts += 1;
    let scored_from_s = if window_s > start_s { window_s.next_up() } else { start_s };
    repeat(model, &problem.terms[0].rehearsal, &offsets, scored_from_s)
}

fn repeat(
    model: &Model,
    rehearsal: &Rehearsal<'_>,
    offsets: &[f64],
    scored_from_s: f64,
) -> Result<FittedRun, FitError> {
    let run = rehearsal.run;
    let measured = &run.trajectory;
    let position_m = rehearsal
        .simulate(model, offsets, measured.time_s.len())
        .map_err(|source| FitError::Simulation { run: run.id.clone(), source })?;
    let start = rehearsal.start_with(model, offsets);
    Ok(FittedRun {
        id: run.id.clone(),
        usage: run.usage,
        initial: start.state,
        start_s: start.start_s,
        scored_from_s,
        simulated: Trajectory {
            time_s: measured.time_s.clone(),
            keypoints: measured.keypoints.clone(),
            position_m,
            std_m: None,
        },
        measured: measured.clone(),
    })
}
