//! What runs leave open stays at the model's own values.
//!
//! Along a combination of numbers that no keypoint feels, an optimum lies anywhere, mostly at some bound. A model with such numbers repeats
//! these runs and misleads wherever the combination matters. So the optimum is drawn towards the values that the fit began with, as weakly as
//! a belief would that takes a whole width of the bounds for one standard deviation: what the runs tell does not feel it.

use nalgebra::{DMatrix, DVector};

use super::counts::Counts;
use super::information::Information;
use super::least_squares::{Descent, Freedom};
use super::objective::Objective;
use super::problem::Point;

/// Most that it may cost, in noise variances of all residuals together, as large as they are: a fifth of what one number saves by chance.
const UNNOTICED_COST: f64 = 0.2;
/// Shares of the way that are tried.
const TRIED_SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.125];
/// A way shorter than this share of the bounds is none.
const LEAST_WAY_SHARE: f64 = 1e-3;

/// `point`, an optimum of which the runs say what is `known`, with what they leave open as the fit began; `None` where nothing moves.
pub(super) fn rested(
    objective: &Objective<'_>,
    point: &Point,
    known: &Information,
    counts: &mut Counts,
) -> Option<Point> {
    let way = way(objective, point, &known.joint)?;
    let cost = objective.costs(std::slice::from_ref(point), false, counts)[0];
    let residuals: usize = objective.problem.terms.iter().map(|term| term.observations.len()).sum();
    let level = (cost / residuals.max(1) as f64).max(1.0);
    TRIED_SHARES.iter().find_map(|share| {
        let values = point.values.iter().zip(&way).map(|(value, way)| value + share * way).collect();
        let mut descent = Descent::new(Point { values, offsets: point.offsets.clone() }, None);
        descent.run(objective, Freedom::Nuisances, counts);
        let there = descent.cost.filter(|there| *there <= cost + UNNOTICED_COST * level);
        there.map(|_| descent.point)
    })
}

/// How far each value moves; `None` where none does.
fn way(objective: &Objective<'_>, point: &Point, joint: &DMatrix<f64>) -> Option<Vec<f64>> {
    let free = &objective.parameters().free;
    if joint.nrows() != free.len() {
        return None;
    }
    // in widths of the bounds
    let widths: Vec<f64> = free.iter().map(|parameter| parameter.scale.width()).collect();
    let information = DMatrix::from_fn(free.len(), free.len(), |i, j| joint[(i, j)] * widths[i] * widths[j]);
    let wanted = DVector::from_iterator(
        free.len(),
        free.iter().zip(&point.values).zip(&widths).map(|((parameter, value), width)| {
            if parameter.prior.is_some() { 0.0 } else { (parameter.start - value) / width }
        }),
    );
    let room = |i: usize| {
        let scale = &free[i].scale;
        [(scale.lower() - point.values[i]) / widths[i], (scale.upper() - point.values[i]) / widths[i]]
    };
    let mut fixed: Vec<Option<f64>> = free.iter().map(|parameter| parameter.prior.map(|_| 0.0)).collect();
    let way = loop {
        let mut matrix = information.clone();
        let displaced = DVector::from_iterator(fixed.len(), fixed.iter().map(|by| by.unwrap_or(0.0)));
        let mut pull = &wanted - &information * &displaced;
        for (i, by) in fixed.iter().enumerate() {
            matrix[(i, i)] += 1.0;
            if by.is_some() {
                matrix.row_mut(i).fill(0.0);
                matrix.column_mut(i).fill(0.0);
                matrix[(i, i)] = 1.0;
                pull[i] = 0.0;
            }
        }
        let way = matrix.cholesky()?.solve(&pull) + displaced;
        let out = (0..fixed.len()).find(|&i| {
            let [lower, upper] = room(i);
            fixed[i].is_none() && !(lower..=upper).contains(&way[i])
        });
        match out {
            Some(i) => fixed[i] = Some(way[i].clamp(room(i)[0], room(i)[1])),
            None => break way,
        }
    };
    let moves = way.iter().any(|share| share.abs() > LEAST_WAY_SHARE);
    moves.then(|| way.iter().zip(&widths).map(|(share, width)| share * width).collect())
}
