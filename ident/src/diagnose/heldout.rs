//! What a description leaves of the runs that it was not fitted to.

use super::goodness::goodness_of;
use super::result::GoodnessOfFit;
use crate::experiment::Experiment;
use crate::fit::counts::Counts;
use crate::fit::least_squares::{Descent, Freedom};
use crate::fit::objective::Objective;
use crate::hypothesis::held_out::held_out;
use crate::hypothesis::nuisances::Nuisances;
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;

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
