//! A run beside its simulation by a calibrated model.

use sim::{Model, Trajectory};

use super::counts::Counts;
use super::error::FitError;
use super::fitted::FittedRun;
use super::least_squares::{Descent, Freedom};
use super::objective::Objective;
use super::problem::{Problem, Term};
use crate::experiment::{Run, RunKind};
use crate::initial;
use crate::loss::{Weighting, observations};
use crate::parameters::Parameters;
use crate::simulate::{Nuisance, Rehearsal, Watched};

/// Scores a held-out run: its start comes from its still images alone, or where there are none (`free`, or let
/// go before the first image) from the first `init_s` seconds of motion, which are not scored. A release time that
/// nobody stated is estimated from the same seconds of the motion. `run_parameters` are parameters with a value per run: they and the start
/// then come from the first `init_share` of the run, which is not scored either.
pub(crate) fn hold_out(
    model: &Model,
    run: &Run,
    noise_m: f64,
    (run_parameters, init_share): (&[Nuisance], f64),
    counts: &mut Counts,
) -> Result<FittedRun, FitError> {
    let estimate = initial::estimate(model, run, noise_m)?;
    let start_s = estimate.start.start_s;
    let has_still = run.kind != RunKind::Free && !run.adrift && run.trajectory.time_s[0] <= start_s;
    let window_s = match estimate.release {
        Some(release) => release.latest_s + run.init_s,
        None if run.adrift => run.first_motion_s().unwrap_or(start_s),
        None if has_still || run.initial.is_some() => start_s,
        None => start_s.max(run.trajectory.time_s[0]) + run.init_s,
    };
    let end_s = run.trajectory.time_s.last().copied().unwrap_or(start_s);
    let window_s =
        if init_share > 0.0 { window_s.max(start_s + init_share * (end_s - start_s)) } else { window_s };
    let weighting = Weighting { noise_m, use_stated: true, run_weight: 1.0 };
    let init_observations = observations(&run.trajectory, weighting, |time_s| time_s <= window_s);
    let mut rehearsal = Rehearsal::new(model, run, estimate, noise_m);
    rehearsal.nuisances.extend(run_parameters);
    let term = Term::new(rehearsal, init_observations);
    let nothing = Parameters::default();
    let problem = Problem { model, parameters: &nothing, terms: vec![term] };
    let objective = Objective::squares(problem);
    let mut descent = Descent::new(objective.problem.start(), None);
    descent.run(&objective, Freedom::Nuisances, counts);
    let offsets = descent.point.offsets.concat();
    counts.rollouts += 1;
    let scored_from_s = if window_s > start_s { window_s.next_up() } else { start_s };
    repeat(model, &objective.problem.terms[0].rehearsal, &offsets, scored_from_s)
}

pub(crate) fn repeat(
    model: &Model,
    rehearsal: &Rehearsal<'_>,
    offsets: &[f64],
    scored_from_s: f64,
) -> Result<FittedRun, FitError> {
    let run = rehearsal.run;
    let measured = &run.trajectory;
    let Watched { position_m, qpos, touch } = rehearsal
        .simulate_watched(model, offsets)
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
            pose_std_m: None,
        },
        qpos,
        base: run.base.clone(),
        measured: measured.clone(),
        touch: touch.map(Into::into),
    })
}
