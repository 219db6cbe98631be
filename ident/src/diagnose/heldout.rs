//! What a description leaves of the runs that it was not fitted to.

use super::goodness::goodness_of;
use super::result::GoodnessOfFit;
use crate::experiment::{Experiment, Use};
use crate::fit::counts::Counts;
use crate::fit::least_squares::{Descent, Freedom};
use crate::fit::objective::Objective;
use crate::fit::problem::Term;
use crate::hypothesis::nuisances::Nuisances;
use crate::hypothesis::state::State;
use crate::initial;
use crate::loss::{Weighting, observations};
use crate::noise::floor::{Floor, RunFloor, interval_s};
use crate::simulate::Rehearsal;

/// The held-out runs with the numbers of `state`, weighed with the noise of `floor`.
fn held_out<'a>(experiment: &'a Experiment, state: &State<'a>, floor: &Floor) -> Option<(State<'a>, Floor)> {
    let model = state.calibrated();
    let (mut terms, mut runs) = (Vec::new(), Vec::new());
    for run in experiment.runs.iter().filter(|run| run.usage == Use::Holdout) {
        let estimate = initial::estimate(&model, run, floor.noise_m).ok()?;
        let weighting = Weighting { noise_m: floor.noise_m, use_stated: true, run_weight: 1.0 };
        let list = observations(&run.trajectory, weighting, |_| true);
        terms.push(Term::new(Rehearsal::new(&model, run, estimate, floor.noise_m), list));
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
    held.add_own(&state.own());
    held.weigh(&floor);
    Some((held, floor))
}

/// Residuals of held-out runs against noise, with all fitted numbers projected out.
pub(super) fn goodness_of_fit<'a>(
    experiment: &'a Experiment,
    leader: &State<'a>,
    floor: &Floor,
    counts: &mut Counts,
) -> Option<GoodnessOfFit> {
    let (mut held, floor) = held_out(experiment, leader, floor)?;
    // what each run has its own of, its pose above all, may be too far off for a projection
    held.point = {
        let objective = Objective::squares(held.problem());
        let mut descent = Descent::new(held.point.clone(), None);
        descent.run(&objective, Freedom::Nuisances, counts);
        descent.point
    };
    held.linear = held.problem().linearise(&held.point, true, counts)?;
    let nuisances = Nuisances::new(&held);
    let left = nuisances.residuals(&held);
    let residuals: Vec<_> =
        (0..held.terms.len()).map(|run| left.rows_range(nuisances.of_run(run)).into_owned()).collect();
    Some(goodness_of(&held, &floor, &residuals, nuisances.used(), 0.0))
}
