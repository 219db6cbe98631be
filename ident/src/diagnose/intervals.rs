//! What is named, with its intervals, and what had bent to cover for it.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::result::{Bent, CauseParameter};
use crate::fit::counts::Counts;
use crate::fit::crossing::{Closeness, crossing};
use crate::fit::problem::Point;
use crate::hypothesis::nuisances::{Nuisances, covariance, joint_covariance};
use crate::hypothesis::state::State;
use ground::statistics::{CHI2_95, NORMAL_95};

/// The rise of the cost at an interval's end is met to 3 %.
const CLOSENESS: Closeness = Closeness { met: 0.03, most_points: 6 };
/// Steps that let all other numbers follow one that is pinned.
const MOST_STEPS: usize = 12;
/// What all other numbers could still save is no reason to let them go on, as a share of the rise.
const UNSETTLED_SHARE: f64 = 0.1;
/// A coefficient that moved by more of its standard deviations had bent.
const BENT_Z: f64 = 2.0;

/// The numbers of the causes of `state`, whose baseline has `first`, with 95 % intervals from the profile of the
/// likelihood; `counts` says whether anybody waits for them.
pub(super) fn values(state: &State<'_>, first: usize, counts: &Counts) -> Vec<CauseParameter> {
    let free = state.parameters.len();
    let covariance = covariance(state).unwrap_or_else(|| DMatrix::identity(free, free)) * level(state);
    let places: Vec<usize> = (first..state.parameters.len()).collect();
    let ends: Vec<f64> = places
        .iter()
        .flat_map(|&which| [(which, -1.0), (which, 1.0)])
        .collect::<Vec<_>>()
        .par_iter()
        .map(|&(which, side)| end(state, which, side, &covariance, counts.apart()))
        .collect();
    let unit = |name: &str| {
        let cause = name.split('/').next().unwrap_or_default();
        let effect = state.model.causes().iter().find(|effect| effect.cause().name() == cause);
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
                let Some(name) = state.own_name(*nuisance) else { continue };
                if term.owns(name) {
                    let best = state.point.offsets[run][k];
                    let variance = |joint: &DMatrix<f64>| level(state) * joint[(free + k, free + k)];
                    let wide = joint.as_ref().map(|joint| NORMAL_95 * variance(joint).sqrt());
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
fn end(state: &State<'_>, which: usize, side: f64, covariance: &DMatrix<f64>, counts: Counts) -> f64 {
    let (best, scale) = (state.point.values[which], state.parameters.free[which].scale);
    let limit = CHI2_95 * level(state);
    let passed = vec![state.point.clone()];
    let mut profile = Profile {
        state,
        which,
        covariance,
        others: Nuisances::except(state, Some(which)),
        limit,
        passed,
        counts,
    };
    let next = best + side * NORMAL_95 * covariance[(which, which)].sqrt();
    let end = crossing(best, next, limit.sqrt(), &scale, CLOSENESS, |x| profile.rise(x));
    // as if the cost rose as a parabola, where nobody waits for its profile
    if profile.counts.is_stopped() { scale.clamp(next) } else { end }
}

/// What the cost rises by as a common number leaves its optimum and all others follow.
struct Profile<'s> {
    /// At its optimum.
    state: &'s State<'s>,
    /// The number.
    which: usize,
    covariance: &'s DMatrix<f64>,
    others: Nuisances,
    /// The rise that is looked for.
    limit: f64,
    /// The optimum, and points at which all others had followed.
    passed: Vec<Point>,
    counts: Counts,
}

impl Profile<'_> {
    /// Root of how much more the best point with the number at `x` costs.
    fn rise(&mut self, x: f64) -> f64 {
        let Self { state, which, limit, .. } = *self;
        let mut pinned = State { linear: Vec::new(), point: self.ahead(x), ..state.clone() };
        pinned.parameters = state.parameters.pinned(which, x);
        if let Some(residuals) = pinned.problem().residuals(&pinned.point, &mut self.counts) {
            let all: f64 = residuals.iter().map(|r| r.norm_squared()).sum();
            let left = self.others.left_of(residuals.iter()).norm_squared();
            let least = self.others.residuals(state).norm_squared();
            let known: f64 = state.linear.iter().map(|linear| linear.residuals.norm_squared()).sum();
            // what the others could still save if they went on is little, or not for what is pinned: that they have not does not
            // matter
            if all - left
                <= UNSETTLED_SHARE * (left - least).max(0.0) + UNSETTLED_SHARE * limit + (known - least)
            {
                self.passed.push(pinned.point);
                return (left - least).max(0.0).sqrt();
            }
        }
        if !pinned.steps(MOST_STEPS, &mut self.counts) {
            return f64::INFINITY;
        }
        self.passed.push(pinned.point);
        (pinned.cost - state.cost).max(0.0).sqrt()
    }

    /// Where all others are with the number at `x`, if they go on straight from the points that are nearest.
    fn ahead(&self, x: f64) -> Point {
        let Self { state, which, covariance, .. } = *self;
        let mut near: Vec<&Point> = self.passed.iter().collect();
        near.sort_by(|a, b| (a.values[which] - x).abs().total_cmp(&(b.values[which] - x).abs()));
        let mut point = near[0].clone();
        match near.get(1) {
            Some(next) => {
                let share = (x - point.values[which]) / (next.values[which] - point.values[which]);
                let from = point.values.iter_mut().chain(point.offsets.iter_mut().flatten());
                let to = next.values.iter().chain(next.offsets.iter().flatten());
                from.zip(to).for_each(|(from, to)| *from += share * (to - *from));
            }
            None => {
                let share = (x - point.values[which]) / covariance[(which, which)];
                for (place, value) in point.values.iter_mut().enumerate() {
                    *value += share * covariance[(place, which)];
                }
            }
        }
        for (parameter, value) in state.parameters.free.iter().zip(&mut point.values) {
            *value = parameter.scale.clamp(*value);
        }
        for (term, offsets) in state.terms.iter().zip(&mut point.offsets) {
            let nuisances = term.rehearsal.nuisances.iter();
            nuisances.zip(offsets).for_each(|(nuisance, offset)| *offset = nuisance.clamp(*offset));
        }
        point.values[which] = x;
        point
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
        .filter(|(moved, _)| *moved > BENT_Z)
        .collect();
    list.sort_by(|a, b| b.0.total_cmp(&a.0));
    list.into_iter().map(|(_, bent)| bent).collect()
}
