//! Runs that nothing is fitted to, as a model with some causes meets them.

use super::state::State;
use crate::experiment::{Experiment, Use};
use crate::fit::problem::Term;
use crate::initial;
use crate::loss::{Weighting, observations};
use crate::noise::floor::{Floor, RunFloor, interval_s};
use crate::simulate::Rehearsal;

/// The held-out runs with the numbers of `state`, weighed with the noise of `floor`.
pub(crate) fn held_out<'a>(
    experiment: &'a Experiment,
    state: &State<'a>,
    floor: &Floor,
) -> Option<(State<'a>, Floor)> {
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
