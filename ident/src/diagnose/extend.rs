//! What is named, with its intervals, and what had bent to cover for it.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::nuisances::{Nuisances, covariance, joint_covariance};
use super::result::{Bent, CauseParameter};
use super::state::State;
use crate::fit::counts::Counts;
use crate::fit::crossing::{Closeness, crossing};
use crate::statistics::{CHI2_95, NORMAL_95};

/// The rise of the cost at an interval's end is met to 3 %.
const CLOSENESS: Closeness = Closeness { met: 0.03, most_points: 6 };
/// Steps that let all other numbers follow one that is pinned.
const STEPS: usize = 12;
/// What all other numbers could still save is no reason to let them go on, as a share of the rise.
const BESIDE: f64 = 1.0;
/// A coefficient that moved by more of its standard deviations had bent.
const BENT: f64 = 2.0;

/// The numbers of the causes of `state`, whose baseline has `first`, with 95 % intervals from the profile of the
/// likelihood.
pub(super) fn values(state: &State<'_>, first: usize) -> Vec<CauseParameter> {
    let free = state.parameters.len();
    let covariance = covariance(state).unwrap_or_else(|| DMatrix::identity(free, free)) * level(state);
    let places: Vec<usize> = (first..state.parameters.len()).collect();
    let ends: Vec<f64> = places
        .iter()
        .flat_map(|&which| [(which, -1.0), (which, 1.0)])
        .collect::<Vec<_>>()
        .par_iter()
        .map(|&(which, side)| end(state, which, side, &covariance))
        .collect();
    let unit = |name: &str| {
        let cause = name.split('/').next().unwrap_or_default();
        let effect = state.model.effects().iter().find(|effect| effect.cause().name() == cause);
        effect
            .and_then(|effect| {
                let place = effect.names().iter().position(|known| known == name)?;
                effect.parameters().nth(place).map(|info| info.unit.to_owned())
            })
            .unwrap_or_default()
    };
    let mut list: Vec<CauseParameter> = places
        .iter()
        .map(|&which| {
            let parameter = &state.parameters.free[which];
            let (lower, upper) = (ends[2 * (which - first)], ends[2 * (which - first) + 1]);
            CauseParameter {
                name: parameter.name().to_owned(),
                value: state.point.values[which],
                ci95: Some([lower, upper]),
                unit: unit(parameter.name()),
            }
        })
        .collect();
    for term in &state.causes {
        for (name, value) in &term.choices {
            list.push(CauseParameter { name: name.clone(), value: *value, ci95: None, unit: unit(name) });
        }
        if term.free(&state.model).own.is_empty() {
            continue;
        }
        for (run, one) in state.terms.iter().enumerate() {
            let joint = joint_covariance(state, Some(run));
            for (k, nuisance) in one.rehearsal.nuisances.iter().enumerate() {
                let crate::simulate::Nuisance::Own { place, .. } = *nuisance else { continue };
                let sim::model::Parameter::Effect(effect, value) = place else { continue };
                let name = &state.model.effects()[effect].names()[value];
                if state.model.effects()[effect].cause() == term.cause {
                    let best = state.point.offsets[run][k];
                    let wide = joint.as_ref().map(|joint| NORMAL_95 * joint[(free + k, free + k)].sqrt());
                    list.push(CauseParameter {
                        name: format!("{name}@{}", one.rehearsal.run.id),
                        value: best,
                        ci95: wide.map(|wide| [best - wide, best + wide]),
                        unit: unit(name),
                    });
                }
            }
        }
    }
    list
}

/// What is left over what noise alone would leave, at least 1: no number is known better than the model repeats the runs.
fn level(state: &State<'_>) -> f64 {
    let left = state.count() as f64 - Nuisances::new(state).used();
    (state.cost / left.max(1.0)).max(1.0)
}

/// Where the profile of common number `which` crosses the limit on one `side`.
fn end(state: &State<'_>, which: usize, side: f64, covariance: &DMatrix<f64>) -> f64 {
    let (best, scale) = (state.point.values[which], state.parameters.free[which].scale);
    let std = covariance[(which, which)].sqrt();
    let others = Nuisances::except(state, Some(which));
    let limit = CHI2_95 * level(state);
    let next = best + side * NORMAL_95 * std;
    crossing(best, next, limit.sqrt(), &scale, CLOSENESS, |x| {
        rise(state, which, x, covariance, &others, limit)
    })
}

/// Root of how much more the best point with number `which` at `x` costs, of which the `limit` is looked for.
fn rise(
    state: &State<'_>,
    which: usize,
    x: f64,
    covariance: &DMatrix<f64>,
    others: &Nuisances,
    limit: f64,
) -> f64 {
    let mut pinned = State { linear: Vec::new(), ..state.clone() };
    // the others begin where they go if all is linear
    let share = (x - state.point.values[which]) / covariance[(which, which)];
    for (place, value) in pinned.point.values.iter_mut().enumerate() {
        *value = state.parameters.free[place].scale.clamp(*value + share * covariance[(place, which)]);
    }
    pinned.point.values[which] = x;
    pinned.parameters = state.parameters.pinned(which, x);
    let mut counts = Counts::default();
    if let Some(residuals) = pinned.problem().residuals(&pinned.point, &mut counts) {
        let all: f64 = residuals.iter().map(|r| r.norm_squared()).sum();
        let left = others.left_of(residuals.iter()).norm_squared();
        let least = others.residuals(state).norm_squared();
        let known: f64 = state.linear.iter().map(|linear| linear.residuals.norm_squared()).sum();
        // what the others could still save if they went on is little, or not for what is pinned: that they have not does not matter
        if all - left <= BESIDE * (left - least).max(0.0) + BESIDE * limit + (known - least) {
            return (left - least).max(0.0).sqrt();
        }
    }
    match pinned.steps(STEPS, &mut counts) {
        true => (pinned.cost - state.cost).max(0.0).sqrt(),
        false => f64::INFINITY,
    }
}

/// Baseline coefficients that differ between `before` and `after`.
pub(super) fn bent(before: &State<'_>, after: &State<'_>) -> Vec<Bent> {
    let Some(covariance) = covariance(after) else { return Vec::new() };
    let level = level(after);
    let mut list: Vec<(f64, Bent)> = (0..before.parameters.len())
        .map(|which| {
            let (a, b) = (before.point.values[which], after.point.values[which]);
            let std = (level * covariance[(which, which)]).sqrt();
            let name = before.parameters.free[which].name().to_owned();
            ((a - b).abs() / std, Bent { name, before: a, after: b, std })
        })
        .filter(|(moved, _)| *moved > BENT)
        .collect();
    list.sort_by(|a, b| b.0.total_cmp(&a.0));
    list.into_iter().map(|(_, bent)| bent).collect()
}
