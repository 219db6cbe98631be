//! 95 % intervals from the profile of the likelihood: how far a parameter can go before even the best values of all
//! others leave residuals that are too large.
//!
//! Where the residuals are not linear in a parameter, the two sides differ, and this is right where the standard
//! deviation is not. Noise that is not as assumed raises the limit by what it does to the parameter's variance.
//! (R. E. Chandler, S. Bate, "Inference for clustered data using the independence loglikelihood", Biometrika 94
//! (2007) 167-183.)

use rayon::prelude::*;

use super::counts::Counts;
use super::information::Information;
use super::least_squares::{Descent, Freedom};
use super::objective::Objective;
use super::problem::{Point, Problem};
use crate::statistics::{CHI2_95, NORMAL_95};

/// Most points of a profile on one side.
const MOST_POINTS: usize = 8;
/// The root of the cost's rise is met to this share: 1 % of the interval.
const MET: f64 = 0.01;
/// A step beyond the last point is at most this many times as far.
const MOST_GROWTH: f64 = 3.0;

/// `[lower, upper]` of every free parameter; a bound where the data never object before it.
pub(super) fn profile(
    objective: &Objective<'_>,
    point: &Point,
    known: &Information,
    counts: &mut Counts,
) -> Vec<[f64; 2]> {
    let least = objective.costs(std::slice::from_ref(point), false, counts)[0];
    let sides: Vec<(usize, f64)> = (0..point.values.len()).flat_map(|i| [(i, -1.0), (i, 1.0)]).collect();
    let ends: Vec<(f64, Counts)> = sides
        .par_iter()
        .map(|&(which, side)| {
            let mut own = Counts::default();
            (end(objective, point, known, least, which, side, &mut own), own)
        })
        .collect();
    for (_, own) in &ends {
        counts.evaluations += own.evaluations;
        counts.rollouts += own.rollouts;
    }
    ends.chunks_exact(2).map(|pair| [pair[0].0, pair[1].0]).collect()
}

/// Where the profile of parameter `which` crosses the limit on one `side`.
fn end(
    objective: &Objective<'_>,
    point: &Point,
    known: &Information,
    least: f64,
    which: usize,
    side: f64,
    counts: &mut Counts,
) -> f64 {
    let (scale, best) = (objective.parameters().free[which].scale, point.values[which]);
    let bound = if side < 0.0 { scale.lower() } else { scale.upper() };
    // In roots of the cost's rise, which grow in proportion to the distance where all is linear.
    let limit = CHI2_95.sqrt() * known.std[which] / known.naive_std[which];
    let (mut inside, mut outside) = ((best, 0.0), None);
    let mut next = best + side * NORMAL_95 * known.std[which];
    for _ in 0..MOST_POINTS {
        let x = scale.clamp(next);
        if x == inside.0 {
            return x;
        }
        let rise = rise(objective, point, known, least, which, x, counts);
        if (rise / limit - 1.0).abs() <= MET || x == bound && rise < limit {
            return x;
        }
        if rise < limit {
            inside = (x, rise);
        } else {
            outside = Some((x, rise));
        }
        next = match outside {
            Some((far, high)) if high.is_finite() => {
                inside.0 + (far - inside.0) * (limit - inside.1) / (high - inside.1)
            }
            Some((far, _)) => (inside.0 + far) / 2.0,
            None => {
                let growth = if inside.1 > 0.0 { (limit / inside.1).min(MOST_GROWTH) } else { MOST_GROWTH };
                best + (inside.0 - best) * growth.max(1.0 + MET)
            }
        };
    }
    scale.clamp(next)
}

/// Root of how much more the best point with parameter `which` at `x` costs.
fn rise(
    objective: &Objective<'_>,
    point: &Point,
    known: &Information,
    least: f64,
    which: usize,
    x: f64,
    counts: &mut Counts,
) -> f64 {
    let parameters = objective.parameters().pinned(which, x);
    let problem = Problem { parameters: &parameters, ..objective.problem.clone() };
    let pinned = Objective { problem, loss: objective.loss, belief: objective.belief.clone() };
    // The others begin where they go if all is linear.
    let share = (x - point.values[which]) / known.covariance[(which, which)];
    let values = point.values.iter().enumerate().map(|(i, &value)| match i == which {
        true => x,
        false => parameters.free[i].scale.clamp(value + share * known.covariance[(i, which)]),
    });
    let from = |values: Vec<f64>, counts: &mut Counts| {
        let mut descent = Descent::new(Point { values, offsets: point.offsets.clone() }, None);
        descent.run(&pinned, Freedom::Everything, counts);
        descent.cost
    };
    let cost = from(values.collect(), counts).or_else(|| {
        let mut values = point.values.clone();
        values[which] = x;
        from(values, counts)
    });
    cost.map_or(f64::INFINITY, |cost| (cost - least).max(0.0).sqrt())
}
