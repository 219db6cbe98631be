//! What the data say about each parameter, from the sensitivities at the optimum.
//!
//! With J the derivatives of the residuals in assumed standard deviations, the nuisances of every run projected
//! out, A = J'J is what the estimate weighs the data with. Their noise, of another size in each run and correlated
//! in time with matrix V, moves the estimate with covariance A⁻¹ (J'VJ) A⁻¹; where the noise is as assumed this is
//! the inverse of the Fisher information. (P. J. Huber, "The behavior of maximum likelihood estimates under
//! nonstandard conditions", Fifth Berkeley Symposium (1967); H. White, Econometrica 48 (1980) 817-838.)
//!
//! Bounds count as the weakest belief: even over their width, variance width²/12. That keeps the deviation of a
//! parameter no data speak about finite, and makes it as wide as its bounds.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::noise::{ResidualNoise, residual_noise};
use super::objective::Objective;
use super::problem::{Linear, Point};
use crate::noise::correlated;
use crate::parameters::FreeParameter;

/// What is known about each parameter.
#[derive(Debug, Clone, Default)]
pub(super) struct Information {
    /// Standard deviations, priors included, shape (P).
    pub(super) std: Vec<f64>,
    /// The same as the assumed noise would have it, shape (P).
    pub(super) naive_std: Vec<f64>,
    /// Whether the data determine the value, rather than its prior or bounds, shape (P).
    pub(super) determined: Vec<bool>,
    /// Whether no keypoint moves noticeably over its whole bounds, shape (P).
    pub(super) without_effect: Vec<bool>,
    /// Covariance, priors included, shape (P, P).
    pub(super) covariance: DMatrix<f64>,
    /// Inverse covariance, without priors and bounds, shape (P, P).
    pub(super) joint: DMatrix<f64>,
    /// How many parameters the data determine, summed over all directions.
    pub(super) effective: f64,
    /// Groups of which the data determine only a combination.
    pub(super) groups: Vec<Group>,
    /// By fitted run.
    pub(super) runs: Vec<RunInformation>,
}

/// Parameters of which the data determine only a combination.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Group {
    /// Which parameters, shape (G).
    pub(super) members: Vec<usize>,
    /// Combinations that the data determine: weights, shape (G), the largest 1; the standard deviation of the sum.
    pub(super) determined: Vec<(Vec<f64>, f64)>,
    /// Changes that leave the keypoints where they are, shape (G), the largest 1.
    pub(super) undetermined: Vec<Vec<f64>>,
}

/// What one run says, its nuisances projected out.
#[derive(Debug, Clone)]
pub(super) struct RunInformation {
    /// J'J, shape (P, P).
    pub(super) weight: DMatrix<f64>,
    /// J'VJ, shape (P, P).
    pub(super) noise: DMatrix<f64>,
    /// J' residuals, as far as the loss believes them, shape (P).
    pub(super) slope: DVector<f64>,
    /// Size and correlation of the run's residuals.
    pub(super) residual_noise: ResidualNoise,
}

/// A parameter is determined when its standard deviation is at most this share of its value, or at most its scale's resolution (chosen),
const DETERMINED_STD_SHARE_MAX: f64 = 1.0 / 3.0;
/// and at most this share of the bounds' width (chosen): a deviation that the bounds themselves limit says nothing.
pub(super) const DETERMINED_STD_WIDTH_SHARE_MAX: f64 = 1.0 / 6.0;
/// A parameter belongs to an undetermined direction when its component of the unit vector is at least this (chosen).
const DIRECTION_COMPONENT_MIN: f64 = 0.05;
/// A direction is undetermined when its variance exceeds this share of what the bounds alone give (chosen): the bounds then
/// say as much as the data.
const UNDETERMINED_VARIANCE_SHARE_MIN: f64 = 0.5;
/// A parameter has no effect when varying it over its whole bounds changes all residuals together by less than this, in squared
/// standard deviations (chosen).
const NO_EFFECT_CHI2_MAX: f64 = 1e-4;
/// Inverse variance of a uniform distribution of width 1: 1 / (1² / 12).
const UNIFORM_PRIOR_PRECISION: f64 = 12.0;

/// The largest standard deviation at which this parameter counts as determined.
fn determined_std_max(parameter: &FreeParameter, value: f64) -> f64 {
    let scale = &parameter.scale;
    (DETERMINED_STD_SHARE_MAX * value.abs())
        .max(scale.resolution())
        .min(DETERMINED_STD_WIDTH_SHARE_MAX * scale.width())
}

/// `linear`: the problem at `point`. `stated`: the noise is what somebody says, not an estimate from the images.
pub(super) fn information(
    objective: &Objective<'_>,
    point: &Point,
    linear: &[Linear],
    stated: bool,
) -> Option<Information> {
    let problem = &objective.problem;
    let count = problem.parameters.len();
    let noises = residual_noise(objective, point, linear, stated);
    let mut runs = Vec::new();
    for (run, (linear, noise)) in linear.iter().zip(&noises).enumerate() {
        runs.push(one_run(objective, run, count, linear, *noise)?);
    }
    if count == 0 {
        return Some(Information { runs, ..Information::default() });
    }
    let free = &problem.parameters.free;
    // In units of the bounds' width, so that all directions can be compared.
    let widths: Vec<f64> = free.iter().map(|parameter| parameter.scale.width()).collect();
    let in_widths =
        |m: DMatrix<f64>| DMatrix::from_fn(count, count, |i, j| m[(i, j)] * widths[i] * widths[j]);
    let sum = |of: &dyn Fn(&RunInformation) -> DMatrix<f64>| {
        runs.iter().fold(DMatrix::zeros(count, count), |sum, run| sum + of(run))
    };
    let mut weight = in_widths(sum(&|run| run.weight.clone()));
    let mut noise = in_widths(sum(&|run| run.noise.clone()));
    if let Some(belief) = &objective.belief {
        for (i, &a) in belief.places.iter().enumerate() {
            for (j, &b) in belief.places.iter().enumerate() {
                let precision = belief.information[(i, j)] * widths[a] * widths[b];
                weight[(a, b)] += belief.weight * precision;
                noise[(a, b)] += belief.weight.powi(2) * precision;
            }
        }
    }
    let identity = DMatrix::<f64>::identity(count, count);
    let data = sandwich(&weight, &noise, &identity)?;
    let mut believed = &identity * UNIFORM_PRIOR_PRECISION;
    for (i, parameter) in free.iter().enumerate() {
        if let Some(prior) = parameter.prior {
            believed[(i, i)] += (widths[i] / prior.std.get()).powi(2);
        }
    }
    let covariance = sandwich(&weight, &noise, &believed)?;
    let naive = sandwich(&weight, &weight, &believed)?;

    let sizes: Vec<f64> =
        free.iter().zip(&point.values).map(|(parameter, &x)| determined_std_max(parameter, x)).collect();
    let data_std: Vec<f64> = (0..count).map(|i| data[(i, i)].sqrt() * widths[i]).collect();
    let narrow = |i: usize| data_std[i] <= sizes[i];
    let groups = groups(&data, &widths, &sizes, &narrow);
    let determined = (0..count).map(|i| {
        let grouped = groups.iter().any(|group| group.members.contains(&i));
        narrow(i) && !grouped && free[i].prior.is_none_or(|prior| data_std[i] < prior.std.get())
    });
    let in_sizes =
        DMatrix::from_fn(count, count, |i, j| data[(i, j)] * widths[i] * widths[j] / (sizes[i] * sizes[j]));
    let effective =
        in_sizes.symmetric_eigenvalues().iter().map(|variance| 1.0 / (1.0 + variance.max(0.0))).sum();
    let deviations = |m: &DMatrix<f64>| (0..count).map(|i| m[(i, i)].sqrt() * widths[i]).collect();
    Some(Information {
        std: deviations(&covariance),
        naive_std: deviations(&naive),
        determined: determined.collect(),
        without_effect: (0..count).map(|i| weight[(i, i)] < NO_EFFECT_CHI2_MAX).collect(),
        covariance: in_widths(covariance),
        joint: joint(&data, &widths),
        effective,
        groups,
        runs,
    })
}

/// The inverse covariance of `data`, in widths, with the unit precision that stands for the bounds taken out.
fn joint(data: &DMatrix<f64>, widths: &[f64]) -> DMatrix<f64> {
    let eigen = SymmetricEigen::new(data.clone());
    let left = eigen.eigenvalues.map(|variance| (1.0 / variance.max(f64::MIN_POSITIVE) - 1.0).max(0.0));
    let joint = &eigen.eigenvectors * DMatrix::from_diagonal(&left) * eigen.eigenvectors.transpose();
    DMatrix::from_fn(widths.len(), widths.len(), |i, j| joint[(i, j)] / (widths[i] * widths[j]))
}

/// Covariance of an estimate that weighs data of information `weight` and a `belief` alike, when the data's noise is
/// `noise` and the belief's is as it says.
pub(super) fn sandwich(
    weight: &DMatrix<f64>,
    noise: &DMatrix<f64>,
    belief: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let inverse = (weight + belief).cholesky()?.inverse();
    let covariance = &inverse * (noise + belief) * &inverse;
    Some((&covariance + covariance.transpose()) / 2.0)
}

/// Squares of what is left of the parameters' columns when all that the run's nuisances could explain is taken out.
/// By orthogonal projection: the difference of two large matrices would lose what matters.
fn one_run(
    objective: &Objective<'_>,
    run: usize,
    count: usize,
    linear: &Linear,
    residual_noise: ResidualNoise,
) -> Option<RunInformation> {
    let term = &objective.problem.terms[run];
    let nuisances = &term.rehearsal.nuisances;
    let rows = linear.jacobian.nrows();
    // Beliefs about the nuisances are further rows.
    let augmented = linear.jacobian.clone().insert_rows(rows, nuisances.len(), 0.0);
    let mut parameters = augmented.columns(0, count).into_owned();
    if !nuisances.is_empty() {
        let mut nuisance_columns = augmented.columns(count, nuisances.len()).into_owned();
        for (k, nuisance) in nuisances.iter().enumerate() {
            nuisance_columns[(rows + k, k)] = 1.0 / nuisance.belief();
        }
        let basis = nuisance_columns.qr().q();
        parameters -= &basis * basis.tr_mul(&parameters);
    }
    let images = parameters.rows(0, rows).into_owned();
    let beliefs = parameters.rows(rows, nuisances.len()).into_owned();
    let spread =
        correlated(&term.observations, residual_noise.correlation, &images) * residual_noise.scale.powi(2);
    // The derivative of a residual is minus that of the simulation: a step against the slope raises the parameter.
    let residuals: Vec<f64> = linear.residuals.iter().map(|&r| objective.loss.influence(r)).collect();
    let slope = images.tr_mul(&DVector::from_vec(residuals));
    let information = RunInformation {
        weight: parameters.tr_mul(&parameters),
        noise: images.tr_mul(&spread) + beliefs.tr_mul(&beliefs),
        slope,
        residual_noise,
    };
    Some(information).filter(|run| run.weight.iter().chain(&run.noise).all(|x| x.is_finite()))
}

/// Parameters that share a direction along which the whole width of the bounds changes the residuals by less
/// than one standard deviation. A parameter without any effect belongs to no group, nor does one that the
/// data determine.
fn groups(
    covariance: &DMatrix<f64>,
    widths: &[f64],
    sizes: &[f64],
    narrow: &dyn Fn(usize) -> bool,
) -> Vec<Group> {
    let count = covariance.nrows();
    // Onto the undetermined directions; the projector does not depend on how these are chosen among themselves.
    let projector = undetermined_directions(covariance)
        .iter()
        .fold(DMatrix::<f64>::zeros(count, count), |sum, direction| sum + direction * direction.transpose());
    let mut leader: Vec<usize> = (0..count).collect();
    for i in 0..count {
        for j in 0..i {
            if projector[(i, j)].abs() > DIRECTION_COMPONENT_MIN && !narrow(i) && !narrow(j) {
                let (keep, merge) = (leader[i].min(leader[j]), leader[i].max(leader[j]));
                leader.iter_mut().filter(|l| **l == merge).for_each(|l| *l = keep);
            }
        }
    }
    let members = |of: usize| (0..count).filter(|&i| leader[i] == of).collect::<Vec<_>>();
    let lists = (0..count).map(members).filter(|members| members.len() > 1);
    lists.map(|members| combinations(members, covariance, widths, sizes)).collect()
}

/// Unit vectors of the directions that the data do not determine, given the covariance in widths.
fn undetermined_directions(covariance: &DMatrix<f64>) -> Vec<DVector<f64>> {
    let eigen = SymmetricEigen::new(covariance.clone());
    let directions = eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter());
    directions
        .filter(|(variance, _)| **variance > UNDETERMINED_VARIANCE_SHARE_MIN)
        .map(|(_, direction)| direction.into_owned())
        .collect()
}

fn combinations(members: Vec<usize>, covariance: &DMatrix<f64>, widths: &[f64], sizes: &[f64]) -> Group {
    let part = DMatrix::from_fn(members.len(), members.len(), |i, j| covariance[(members[i], members[j])]);
    let change = |direction: &DVector<f64>| {
        scaled_to_one(members.iter().zip(direction).map(|(&i, x)| x * widths[i]).collect())
    };
    let undetermined = undetermined_directions(&part).iter().map(change).collect();
    let unit = |i: usize| widths[members[i]] / sizes[members[i]];
    let in_sizes = DMatrix::from_fn(members.len(), members.len(), |i, j| part[(i, j)] * unit(i) * unit(j));
    let eigen = SymmetricEigen::new(in_sizes);
    let directions = eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter());
    let determined = directions.filter(|(variance, _)| **variance < 1.0).map(|(variance, direction)| {
        let weights: Vec<f64> = members.iter().zip(direction.iter()).map(|(&i, x)| x / sizes[i]).collect();
        let largest = weights.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        (scaled_to_one(weights), variance.max(0.0).sqrt() / largest)
    });
    Group { determined: determined.collect(), undetermined, members }
}

/// `numbers` over the one of largest size; those of next to no size are 0.
fn scaled_to_one(numbers: Vec<f64>) -> Vec<f64> {
    let largest =
        numbers.iter().copied().fold(0.0, |most: f64, x| if x.abs() > most.abs() { x } else { most });
    numbers
        .iter()
        .map(|x| x / largest)
        .map(|x| if x.abs() < DIRECTION_COMPONENT_MIN { 0.0 } else { x })
        .collect()
}
