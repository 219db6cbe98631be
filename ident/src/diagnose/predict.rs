//! Held-out runs as witnesses: which of several sets of causes that explain the fitted runs alike predicts them better, and
//! whether what is left there is noise.

use super::floor::{Floor, RunFloor, interval_s};
use super::gates::fitness_of;
use super::result::Fitness;
use super::search::{BETTER, Found};
use super::state::{Nuisances, State};
use crate::experiment::{Experiment, RunKind, Use};
use crate::fit::counts::Counts;
use crate::fit::least_squares::{Descent, Freedom};
use crate::fit::objective::Objective;
use crate::fit::problem::Term;
use crate::initial;
use crate::loss::{Weighting, observations};
use crate::simulate::{Nuisance, Rehearsal};

/// The held-out runs with the numbers of `state`, weighed with the noise of `floor`.
fn held_out<'a>(experiment: &'a Experiment, state: &State<'a>, floor: &Floor) -> Option<(State<'a>, Floor)> {
    let model = state.calibrated();
    let (mut terms, mut runs) = (Vec::new(), Vec::new());
    for run in experiment.runs.iter().filter(|run| run.usage == Use::Holdout) {
        let estimate = initial::estimate(&model, run, floor.noise_m).ok()?;
        let weighting = Weighting { noise_m: floor.noise_m, use_stated: true, run_weight: 1.0 };
        let list = observations(&run.trajectory, weighting, |_| true);
        terms.push(Term::new(Rehearsal::new(&model, run, estimate), list));
        runs.push(RunFloor {
            id: run.id.clone(),
            std_m: vec![floor.noise_m; run.trajectory.keypoints.len()],
            interval_s: interval_s(&run.trajectory.time_s),
        });
    }
    if terms.is_empty() {
        return None;
    }
    let floor = Floor { runs, ..floor.clone() };
    let mut held = State::baseline(&state.model, state.parameters.clone(), terms);
    held.point.values.clone_from(&state.point.values);
    // what each run has its own of is seen in that run only
    for cause in &state.causes {
        for (_, nuisance) in cause.free(&held.model).own {
            for (term, offsets) in held.terms.iter_mut().zip(&mut held.point.offsets) {
                term.rehearsal.nuisances.push(nuisance);
                offsets.push(0.0);
            }
        }
    }
    held.weigh(&floor);
    Some((held, floor))
}

/// Residuals of held-out runs against noise, with all fitted numbers projected out.
pub(super) fn fitness<'a>(
    experiment: &'a Experiment,
    leader: &State<'a>,
    floor: &Floor,
    counts: &mut Counts,
) -> Option<Fitness> {
    let (mut held, floor) = held_out(experiment, leader, floor)?;
    held.linear = held.problem().linearise(&held.point, true, counts)?;
    let nuisances = Nuisances::new(&held);
    let left = nuisances.residuals(&held);
    let residuals: Vec<_> =
        (0..held.terms.len()).map(|run| left.rows_range(nuisances.of_run(run)).into_owned()).collect();
    Some(fitness_of(&held, &floor, &residuals, nuisances.used()))
}

/// Squares of whitened residuals of the held-out runs, parameters frozen, the pose from the still images alone. `None` where
/// a run has none, or numbers of its own that only it could tell.
fn cost<'a>(
    experiment: &'a Experiment,
    state: &State<'a>,
    floor: &Floor,
    counts: &mut Counts,
) -> Option<f64> {
    let (mut held, _) = held_out(experiment, state, floor)?;
    let own = |nuisance: &Nuisance| matches!(nuisance, Nuisance::Own { .. } | Nuisance::Release { .. });
    if held
        .terms
        .iter()
        .any(|term| term.rehearsal.run.kind == RunKind::Free || term.rehearsal.nuisances.iter().any(own))
    {
        return None;
    }
    let mut still = State { linear: Vec::new(), ..held.clone() };
    for term in &mut still.terms {
        let start_s = term.rehearsal.start.start_s;
        let time_s = &term.rehearsal.run.trajectory.time_s;
        term.observations.retain(|o| time_s[o.instant] <= start_s);
        if term.observations.is_empty() {
            return None;
        }
        term.instants = term.observations.last().map_or(0, |last| last.instant + 1);
        term.whitening = None;
    }
    let objective = Objective::squares(still.problem());
    let mut descent = Descent::new(still.point.clone(), None);
    descent.run(&objective, Freedom::Nuisances, counts);
    held.point.offsets.clone_from(&descent.point.offsets);
    let cost = held.problem().costs_of_rollouts(std::slice::from_ref(&held.point), counts)[0];
    cost.is_finite().then_some(cost)
}

/// Lets the held-out runs decide between sets whose BIC is within reach of the leader's.
pub(super) fn decide<'a>(
    experiment: &'a Experiment,
    found: &mut Found<'a>,
    floor: &Floor,
    counts: &mut Counts,
) {
    if found.leader.causes.is_empty() {
        return;
    }
    let reach = found.leader.bic() + BETTER;
    let near: Vec<usize> = (0..found.tried.len())
        .filter(|&i| {
            found.tried[i].bic() <= reach && found.tried[i].causes.len() == found.leader.causes.len()
        })
        .collect();
    if near.len() < 2 {
        return;
    }
    let Some(least) = cost(experiment, &found.leader, floor, counts) else { return };
    for i in near {
        if !found.tried[i].descend(counts) {
            continue;
        }
        if let Some(other) = cost(experiment, &found.tried[i], floor, counts) {
            found.tried[i].predicted = other - least;
        }
    }
    found.tried.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
    let size = found.leader.causes.len();
    let best = found.tried.iter().find(|state| state.causes.len() == size);
    if let Some(best) = best.filter(|best| best.bic() < found.leader.bic()) {
        found.leader = best.clone();
    }
}
