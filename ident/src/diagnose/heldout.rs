//! What held-out runs say of a description: whether what it leaves of them is noise, and how probable it had them.

use nalgebra::{DMatrix, DVector};

use super::gates::goodness_of;
use super::result::GoodnessOfFit;
use crate::experiment::Experiment;
use crate::fit::counts::Counts;
use crate::fit::least_squares::{Descent, Freedom};
use crate::fit::objective::Objective;
use crate::hypothesis::held_out::held_out;
use crate::hypothesis::nuisances::{Nuisances, joint_information};
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

/// The same after a fit of all runs together, from the optimum of the fitted ones: what these lose by it counts as well, so
/// that numbers follow the held-out runs just as far as the fit leaves them open.
pub(super) fn goodness_of_all<'a>(
    experiment: &'a Experiment,
    leader: &State<'a>,
    floor: &Floor,
    counts: &mut Counts,
) -> Option<GoodnessOfFit> {
    let (mut held, floor) = held_out(experiment, leader, floor)?;
    let mut all = joined(leader, &held, counts)?;
    let first = leader.terms.len();
    held.linear = all.linear.split_off(first);
    held.point.offsets = all.point.offsets.split_off(first);
    held.point.values = all.point.values;
    let residuals: Vec<_> = held.linear.iter().map(|linear| linear.residuals.clone()).collect();
    let own = held.terms.iter().map(|term| term.rehearsal.nuisances.len() as f64).sum();
    let kept: f64 = residuals.iter().map(DVector::norm_squared).sum();
    let lost = (all.cost - leader.cost - kept).max(0.0);
    Some(goodness_of(&held, &floor, &residuals, own, lost))
}

/// `state` with the runs `held` besides, at their common optimum. `None` where there is none.
fn joined<'a>(state: &State<'a>, held: &State<'a>, counts: &mut Counts) -> Option<State<'a>> {
    let mut all = State { linear: Vec::new(), ..state.clone() };
    all.terms.extend(held.terms.iter().cloned());
    all.point.offsets.extend(held.point.offsets.iter().cloned());
    // what could not be simulated has no optimum
    (!state.linear.is_empty() && all.descend(counts)).then_some(all)
}

/// How improbable `state`, at its optimum of the fitted runs, has the held-out ones: -2 ln of their probability density, up to a
/// constant that all descriptions share, with the numbers as uncertain as the fit leaves them. `None` where nothing is held out, or
/// cannot be simulated.
///
/// The density is that of all runs over that of the fitted ones, each by Laplace's approximation: what the least cost grows by
/// when the held-out runs join, and the logarithm of how much the information grows. What these move the numbers by is for this
/// score alone, and nothing is fitted to them.
///
/// # Source
/// A. Gelman et al., "Bayesian Data Analysis", 3rd ed. (2013), sections 4.1 and 7.2 (log predictive density).
pub(super) fn deviance<'a>(
    experiment: &'a Experiment,
    state: &State<'a>,
    floor: &Floor,
    counts: &mut Counts,
) -> Option<f64> {
    let (held, _) = held_out(experiment, state, floor)?;
    let all = joined(state, &held, counts)?;
    let free = state.parameters.len();
    let mut log_determinant = log_growth(&joint_information(state, None), &joint_information(&all, None))?;
    for run in state.terms.len()..all.terms.len() {
        let nuisances = &all.terms[run].rehearsal.nuisances;
        let beliefs = nuisances.iter().map(|nuisance| nuisance.belief().powi(-2));
        let before = DMatrix::from_diagonal(&DVector::from_iterator(nuisances.len(), beliefs));
        let own = all.linear[run].jacobian.columns(free, nuisances.len());
        log_determinant += log_growth(&before, &(&before + own.tr_mul(&own)))?;
    }
    Some(all.cost - state.cost + log_determinant)
}

/// Logarithm of the determinant of `after` over that of `before`, both positive.
fn log_growth(before: &DMatrix<f64>, after: &DMatrix<f64>) -> Option<f64> {
    // in units that make both well conditioned
    let units: Vec<f64> = before.diagonal().iter().map(|x| x.sqrt()).collect();
    let scaled =
        |m: &DMatrix<f64>| DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] / (units[i] * units[j]));
    Some(scaled(after).cholesky()?.ln_determinant() - scaled(before).cholesky()?.ln_determinant())
}
