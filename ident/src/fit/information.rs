//! What the data say about each parameter, from the Fisher information at the optimum.
//!
//! With J the derivatives of the residuals in standard deviations, the information about the parameters is
//! J'J with the nuisances of every run projected out. Bounds count as the weakest belief: even
//! over their width, variance width²/12. That keeps the deviation of a parameter no data speak about finite, and
//! makes it as wide as its bounds.

use nalgebra::{DMatrix, SymmetricEigen};

use super::counts::Counts;
use super::problem::{Difference, Linear, Point, Problem};

/// What is known about each parameter, shape (P) each.
#[derive(Debug, Clone, Default)]
pub(super) struct Information {
    /// Standard deviations, priors included.
    pub(super) std: Vec<f64>,
    /// Whether the data settle the value, rather than its prior or bounds.
    pub(super) determined: Vec<bool>,
    /// Groups of which only a combination is seen.
    pub(super) groups: Vec<Vec<usize>>,
}

/// A value is settled when its deviation is at most this share of it, or at most its scale's resolution.
const SETTLED: f64 = 0.5;
/// Share of a blind direction that makes a parameter part of it.
const SHARE: f64 = 0.05;

/// `noise_scale`: true over assumed standard deviation of the residuals.
pub(super) fn information(
    problem: &Problem<'_>,
    point: &Point,
    noise_scale: f64,
    counts: &mut Counts,
) -> Option<Information> {
    let count = problem.parameters.len();
    if count == 0 {
        return Some(Information::default());
    }
    let linear = problem.linearise(point, true, Difference::Central, counts)?;
    let mut data = DMatrix::zeros(count, count);
    for (run, linear) in linear.iter().enumerate() {
        data += one_run(problem, run, count, linear)?;
    }
    data /= noise_scale * noise_scale;

    // In units of the bounds' width, so that all directions can be compared.
    let widths: Vec<f64> = problem.parameters.free.iter().map(|parameter| parameter.scale.width()).collect();
    let scaled = DMatrix::from_fn(count, count, |i, j| data[(i, j)] * widths[i] * widths[j]);
    let bounded = &scaled + DMatrix::identity(count, count) * 12.0;
    let data_std = deviations(&bounded)?;
    let mut believed = bounded;
    for (i, parameter) in problem.parameters.free.iter().enumerate() {
        if let Some(prior) = parameter.prior {
            believed[(i, i)] += (widths[i] / prior.std.get()).powi(2);
        }
    }
    let std: Vec<f64> = deviations(&believed)?.iter().zip(&widths).map(|(std, width)| std * width).collect();
    let determined = problem.parameters.free.iter().enumerate().map(|(i, parameter)| {
        let own = data_std[i] * widths[i];
        let settled = (SETTLED * point.values[i].abs()).max(parameter.scale.resolution());
        own <= settled && parameter.prior.is_none_or(|prior| own < prior.std.get())
    });
    Some(Information { std, determined: determined.collect(), groups: groups(&scaled) })
}

/// Information of one run: squares of what is left of the parameters' columns when all that its nuisances could
/// explain is taken out. By orthogonal projection: the difference of two large matrices would lose what matters.
fn one_run(problem: &Problem<'_>, run: usize, count: usize, linear: &Linear) -> Option<DMatrix<f64>> {
    let nuisances = &problem.terms[run].rehearsal.nuisances;
    let rows = linear.jacobian.nrows();
    // Beliefs about the nuisances are further rows.
    let augmented = linear.jacobian.clone().insert_rows(rows, nuisances.len(), 0.0);
    let mut parameters = augmented.columns(0, count).into_owned();
    if !nuisances.is_empty() {
        let mut own = augmented.columns(count, nuisances.len()).into_owned();
        for (k, nuisance) in nuisances.iter().enumerate() {
            own[(rows + k, k)] = 1.0 / nuisance.belief();
        }
        let basis = own.qr().q();
        parameters -= &basis * basis.tr_mul(&parameters);
    }
    Some(parameters.tr_mul(&parameters)).filter(|information| information.iter().all(|x| x.is_finite()))
}

fn deviations(information: &DMatrix<f64>) -> Option<Vec<f64>> {
    let covariance = information.clone().cholesky()?.inverse();
    Some(covariance.diagonal().iter().map(|variance| variance.sqrt()).collect())
}

/// Parameters that share a direction along which the whole width of the bounds changes the residuals by less
/// than one standard deviation. A parameter that is blind all by itself belongs to no group.
fn groups(scaled: &DMatrix<f64>) -> Vec<Vec<usize>> {
    let count = scaled.nrows();
    let eigen = SymmetricEigen::new(scaled.clone());
    // Onto the blind directions; the projector does not depend on how these are chosen among themselves.
    let mut projector = DMatrix::<f64>::zeros(count, count);
    for (k, value) in eigen.eigenvalues.iter().enumerate() {
        if *value < 1.0 {
            let direction = eigen.eigenvectors.column(k);
            projector += direction * direction.transpose();
        }
    }
    let mut group: Vec<usize> = (0..count).collect();
    for i in 0..count {
        for j in 0..i {
            if projector[(i, j)].abs() > SHARE {
                let (keep, merge) = (group[i].min(group[j]), group[i].max(group[j]));
                group.iter_mut().filter(|g| **g == merge).for_each(|g| *g = keep);
            }
        }
    }
    let members = |leader: usize| (0..count).filter(|&i| group[i] == leader).collect::<Vec<_>>();
    (0..count).map(members).filter(|members| members.len() > 1).collect()
}
