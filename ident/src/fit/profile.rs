//! 95 % intervals from the profile of the likelihood: how far a parameter can go before even the best values of all
//! others leave residuals that are too large.
//!
//! Where the residuals are not linear in a parameter, the two sides differ, and this is right where the standard
//! deviation is not. Noise that is not as assumed raises the limit by what it does to the parameter's variance.
//! (R. E. Chandler, S. Bate, "Inference for clustered data using the independence loglikelihood", Biometrika 94
//! (2007) 167-183.)

use super::counts::Counts;
use super::covariance::Information;
use super::crossing::{Closeness, crossing};
use super::least_squares::{Descent, Freedom};
use super::objective::Objective;
use super::problem::{Point, Problem};
use ground::statistics::{CHI2_95, NORMAL_95};

/// The limit is met to 1 % of the interval.
const CLOSENESS: Closeness = Closeness { met: 0.01, most_points: 8 };

/// `[lower, upper]` of every free parameter; a bound where the data never object before it.
pub(super) fn profile(
    objective: &Objective<'_>,
    point: &Point,
    known: &Information,
    counts: &mut Counts,
) -> Vec<[f64; 2]> {
    let least = objective.costs(std::slice::from_ref(point), false, counts)[0];
    let sides: Vec<(usize, f64)> = (0..point.values.len()).flat_map(|i| [(i, -1.0), (i, 1.0)]).collect();
    let ends = counts
        .of_each(sides, |(which, side), counts| end(objective, point, known, least, which, side, counts));
    ends.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect()
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
    let limit = CHI2_95.sqrt() * known.std[which] / known.naive_std[which];
    let next = best + side * NORMAL_95 * known.std[which];
    crossing(best, next, limit, &scale, CLOSENESS, |x| rise(objective, point, known, least, which, x, counts))
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
