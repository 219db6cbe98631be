//! Parameters that the runs do not determine stay at the model's values.
//!
//! Along a combination of parameters that moves no keypoint, the optimum is arbitrary and mostly at some bound. A model with such values
//! reproduces these runs and misleads wherever the combination matters. So the optimum is drawn towards the values that the fit began with, as
//! weakly as by a prior whose standard deviation is the whole width of the bounds: what the runs determine hardly changes.

use nalgebra::{DMatrix, DVector};

use super::counts::Counts;
use super::covariance::Information;
use super::least_squares::{Descent, Freedom};
use super::objective::Objective;
use super::problem::Point;

/// Largest increase of the cost, in variances of the noise that the residuals show (chosen): a fifth of what one more parameter saves by chance.
const COST_INCREASE_MAX: f64 = 0.2;
/// Shares of the step that are tried, the largest first (chosen).
const STEP_SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.125];
/// Steps shorter than this share of the bounds' width are not made (chosen).
const STEP_WIDTH_SHARE_MIN: f64 = 1e-3;

/// `point`, an optimum, with what the runs do not determine (see `known`) moved towards the values the fit began with; `None` where nothing moves.
pub(super) fn rested(
    objective: &Objective<'_>,
    point: &Point,
    known: &Information,
    counts: &mut Counts,
) -> Option<Point> {
    let step = step(objective, point, &known.joint)?;
    let cost = objective.costs(std::slice::from_ref(point), false, counts)[0];
    let residuals: usize = objective.problem.terms.iter().map(|term| term.observations.len()).sum();
    let level = (cost / residuals.max(1) as f64).max(1.0);
    STEP_SHARES.iter().find_map(|share| {
        let values = point.values.iter().zip(&step).map(|(value, step)| value + share * step).collect();
        let mut descent = Descent::new(Point { values, offsets: point.offsets.clone() }, None);
        descent.run(objective, Freedom::Nuisances, counts);
        let there = descent.cost.filter(|there| *there <= cost + COST_INCREASE_MAX * level);
        there.map(|_| descent.point)
    })
}

/// The change of each value, SI, shape (P); `None` where none moves.
fn step(objective: &Objective<'_>, point: &Point, joint: &DMatrix<f64>) -> Option<Vec<f64>> {
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
    let step = loop {
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
        let step = matrix.cholesky()?.solve(&pull) + displaced;
        let out = (0..fixed.len()).find(|&i| {
            let [lower, upper] = room(i);
            fixed[i].is_none() && !(lower..=upper).contains(&step[i])
        });
        match out {
            Some(i) => fixed[i] = Some(step[i].clamp(room(i)[0], room(i)[1])),
            None => break step,
        }
    };
    let moves = step.iter().any(|share| share.abs() > STEP_WIDTH_SHARE_MIN);
    moves.then(|| step.iter().zip(&widths).map(|(share, width)| share * width).collect())
}
