//! Whether each run by itself would give the same value of a parameter.
//!
//! A parameter that is physical has one value in all runs; one that stands in for something else drifts from run to
//! run. Each parameter in turn gets a value per run, one Gauss-Newton step from the optimum, all others and the
//! starts of the runs following; the values are then compared with their covariance.

use nalgebra::{DMatrix, DVector};

use super::covariance::{DETERMINED_STD_WIDTH_SHARE_MAX, Information, RunInformation, sandwich};
use super::report::{Constancy, RunValue};
use crate::parameters::Parameters;
use ground::statistics::one_value;

/// Values of parameter `which` per run that determines it, and the test that they are one; `None` with fewer than two
/// such runs.
pub(super) fn constancy(
    parameters: &Parameters,
    values: &[f64],
    known: &Information,
    ids: &[String],
    which: usize,
) -> Option<(Vec<RunValue>, Constancy)> {
    let (changes, covariance) = split(parameters, known, which)?;
    let width = parameters.free[which].scale.width();
    let runs: Vec<usize> = (0..changes.len())
        .filter(|&run| covariance[(run, run)].sqrt() <= DETERMINED_STD_WIDTH_SHARE_MAX * width)
        .collect();
    if runs.len() < 2 {
        return None;
    }
    let list = runs.iter().map(|&run| RunValue {
        run: ids[run].clone(),
        value: values[which] + changes[run],
        std: covariance[(run, run)].sqrt(),
    });
    let changes = DVector::from_iterator(runs.len(), runs.iter().map(|&run| changes[run]));
    let part = DMatrix::from_fn(runs.len(), runs.len(), |i, j| covariance[(runs[i], runs[j])]);
    let factor = part.cholesky()?;
    let (chi2, degrees, p) = one_value(&changes, |values| factor.solve(values));
    Some((list.collect(), Constancy { chi2, degrees, p }))
}

/// Changes of parameter `which` in every run, shape (runs), and their covariance.
fn split(parameters: &Parameters, known: &Information, which: usize) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let (count, runs) = (parameters.len(), known.runs.len());
    let size = count - 1 + runs;
    // The other parameters first, then this one, run by run.
    let place = |parameter: usize, run: usize| match parameter {
        i if i == which => count - 1 + run,
        i if i < which => i,
        i => i - 1,
    };
    let widths: Vec<f64> = parameters.free.iter().map(|parameter| parameter.scale.width()).collect();
    let spread = |of: &dyn Fn(&RunInformation) -> &DMatrix<f64>| {
        let mut sum = DMatrix::zeros(size, size);
        for (run, information) in known.runs.iter().enumerate() {
            let block = of(information);
            for i in 0..count {
                for j in 0..count {
                    sum[(place(i, run), place(j, run))] += block[(i, j)] * widths[i] * widths[j];
                }
            }
        }
        sum
    };
    let (weight, noise) = (spread(&|run| &run.weight), spread(&|run| &run.noise));
    let mut slope = DVector::zeros(size);
    for (run, information) in known.runs.iter().enumerate() {
        for i in 0..count {
            slope[place(i, run)] += information.slope[i] * widths[i];
        }
    }
    let mut belief = DMatrix::identity(size, size);
    for (i, parameter) in parameters.free.iter().enumerate().filter(|(i, _)| *i != which) {
        let at = place(i, 0);
        if let Some(prior) = parameter.prior {
            belief[(at, at)] += (widths[i] / prior.std.get()).powi(2);
        }
        // At the optimum priors and bounds hold the data's pull on the others.
        slope[at] = 0.0;
    }
    let covariance = sandwich(&weight, &noise, &belief)?;
    let step = -(weight + belief).cholesky()?.solve(&slope);
    let unit = widths[which];
    let changes = step.rows(count - 1, runs) * unit;
    let covariance = covariance.view((count - 1, count - 1), (runs, runs)) * (unit * unit);
    Some((changes, covariance))
}
