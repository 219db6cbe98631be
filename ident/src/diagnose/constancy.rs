//! What each run by itself would say of a number that is the same in all of them: numbers of a report, which decide nothing.

use nalgebra::{DMatrix, DVector};

use super::result::{ConstancyTest, PerRun};
use crate::hypothesis::candidates::Term;
use crate::hypothesis::nuisances::{Nuisances, joint_covariance};
use crate::hypothesis::state::State;
use ground::statistics::{chi2_survival, one_value};

/// A run sees a number when its effect there is worth this many standard deviations.
const SEEN_IN_RUN_Z: f64 = 3.0;

/// Whether the numbers of the causes are the same in all runs, and what each run would say.
pub(super) fn constancy(state: &State<'_>, baseline: usize) -> Vec<(ConstancyTest, Vec<PerRun>)> {
    let common = (baseline..state.parameters.len()).filter_map(|which| common(state, which));
    // what differs from run to run is asked for no constancy
    let own = state.causes.iter().filter(|term| !term.by_run).filter_map(|term| amplitudes(state, term));
    common.chain(own).collect()
}

fn ids(state: &State<'_>) -> Vec<String> {
    state.terms.iter().map(|term| term.rehearsal.run.id.clone()).collect()
}

/// A number common to all runs: a value for each, all others following.
fn common(state: &State<'_>, which: usize) -> Option<(ConstancyTest, Vec<PerRun>)> {
    let parameter = &state.parameters.free[which];
    let value = state.point.values[which];
    let nuisances = Nuisances::except(state, Some(which));
    let seen: Vec<usize> = (0..state.terms.len())
        .filter(|&run| state.linear[run].jacobian.column(which).norm() * value.abs() > SEEN_IN_RUN_Z)
        .collect();
    if seen.len() < 2 {
        return None;
    }
    let mut columns = DMatrix::zeros(nuisances.len(), seen.len());
    for (place, &run) in seen.iter().enumerate() {
        let rows = nuisances.of_run(run);
        columns
            .view_mut((rows.start, place), (rows.len(), 1))
            .copy_from(&state.linear[run].jacobian.column(which));
    }
    nuisances.take_out(columns.as_view_mut());
    let slope = columns.tr_mul(&nuisances.residuals(state));
    let mut gram = columns.tr_mul(&columns);
    let ridge = 1e-9 * gram.diagonal().max() + f64::MIN_POSITIVE;
    for i in 0..seen.len() {
        gram[(i, i)] += ridge;
    }
    let factor = gram.clone().cholesky()?;
    let change = -factor.solve(&slope);
    let (chi2, degrees, p) = one_value(&change, |values| &gram * values);
    let covariance = factor.inverse();
    let ids = ids(state);
    let list = seen.iter().enumerate().map(|(place, &run)| PerRun {
        run: ids[run].clone(),
        parameter: parameter.name().to_owned(),
        value: value + change[place],
        std: covariance[(place, place)].sqrt(),
    });
    Some((ConstancyTest { parameter: parameter.name().to_owned(), chi2, degrees, p }, list.collect()))
}

/// Numbers that each run has its own of by their nature, as the phase of waves: their common amplitude.
fn amplitudes(state: &State<'_>, term: &Term) -> Option<(ConstancyTest, Vec<PerRun>)> {
    let count = state.parameters.len();
    let ids = ids(state);
    let name = format!("{}/amplitude", term.info().name);
    let mut list: Vec<PerRun> = Vec::new();
    for (run, id) in ids.iter().enumerate() {
        let nuisances = &state.terms[run].rehearsal.nuisances;
        let is_its = |&k: &usize| state.own_name(nuisances[k]).is_some_and(|name| term.owns(name));
        let own: Vec<usize> = (0..nuisances.len()).filter(is_its).collect();
        if own.is_empty() {
            continue;
        }
        let values = DVector::from_iterator(own.len(), own.iter().map(|&k| state.point.offsets[run][k]));
        let amplitude = values.norm();
        let joint = joint_covariance(state, Some(run))?;
        let covariance =
            DMatrix::from_fn(own.len(), own.len(), |i, j| joint[(count + own[i], count + own[j])]);
        let direction = if amplitude > 0.0 { &values / amplitude } else { values.clone() };
        let std = direction.dot(&(&covariance * &direction)).max(0.0).sqrt();
        list.push(PerRun { run: id.clone(), parameter: name.clone(), value: amplitude, std });
    }
    if list.len() < 2 {
        return None;
    }
    let weight = |run: &PerRun| 1.0 / run.std.powi(2).max(f64::MIN_POSITIVE);
    let total: f64 = list.iter().map(weight).sum();
    let mean = list.iter().map(|run| weight(run) * run.value).sum::<f64>() / total;
    let chi2 = list.iter().map(|run| weight(run) * (run.value - mean).powi(2)).sum();
    let degrees = list.len() - 1;
    Some((ConstancyTest { parameter: name, chi2, degrees, p: chi2_survival(chi2, degrees as f64) }, list))
}
