//! A new fit beside an earlier one of the same mechanism: has anything changed, and may it replace the earlier one?
//!
//! What the earlier data say is a belief in information form, so that the new runs fitted with it give what one fit
//! of all runs would, as far as these are linear in the parameters. Drift is tested before that is believed: with the
//! earlier estimate's covariance C and the new data's alone D, the difference d of the estimates has chi-square
//! d' (C + D)⁻¹ d, over the directions that both determine.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::checkpoint::{INTERRUPTED, Observer};
use super::error::FitError;
use super::fitted::Fitted;
use super::objective::Belief;
use super::report::{Drift, Fit, Recalibration};
use super::run::{Begin, run};
use crate::experiment::Experiment;
use crate::initial::free_parameters;
use crate::parameters::Parameters;
use ground::statistics::chi2_survival;

/// Drift is reported below this probability (chosen): one false alarm in a thousand recalibrations.
const DRIFT_P_MAX: f64 = 1e-3;
/// A parameter is named as changed beyond this many standard deviations of the difference (chosen).
const CHANGED_PARAMETER_Z: f64 = 3.0;
/// Both fits determine a direction when neither has more than this many times the other's information about it (chosen).
const INFORMATION_RATIO_MAX: f64 = 1e4;
/// The new fit's residuals may exceed the earlier fit's by this factor (chosen).
const RESIDUAL_GROWTH_RATIO_MAX: f64 = 1.5;

/// Fits new runs, once by themselves; and, where that passes the gates against `earlier`, once more with what the
/// earlier fit found. [`Fit::recalibration`] of the outcome says which of both it is: a fit that was not accepted is
/// that of the new runs alone, and the earlier one should be kept. An interrupted one has no verdict.
///
/// # Errors
/// [`FitError`].
pub fn recalibrate(
    experiment: &Experiment,
    earlier: &Fit,
    observer: &mut dyn Observer,
) -> Result<Fitted, FitError> {
    let mut model = experiment.model.clone();
    experiment.fit.add_named_causes(&mut model);
    let parameters = free_parameters(&model, experiment)?;
    earlier.belief(&parameters, 1.0)?;
    let mut alone = run(experiment, None, Begin::Afresh, observer)?;
    if alone.fit.stop_reason == INTERRUPTED {
        return Ok(alone);
    }
    let verdict = judge(earlier, &alone.fit);
    if !verdict.accepted {
        alone.fit.recalibration = Some(verdict);
        return Ok(alone);
    }
    // The model's values would be a worse start than what the new runs say by themselves.
    let start = Experiment { model: alone.model.clone(), ..experiment.clone() };
    let belief = |parameters: &Parameters| earlier.belief(parameters, alone.fit.overweight());
    let mut both = run(&start, Some(&belief), Begin::Afresh, observer)?;
    both.fit.evaluations += alone.fit.evaluations;
    both.fit.rollouts += alone.fit.rollouts;
    both.fit.recalibration = Some(verdict);
    Ok(both)
}

/// Judges a fit of new runs, made without regard to `earlier`, against it.
fn judge(earlier: &Fit, new: &Fit) -> Recalibration {
    let mut reasons = Vec::new();
    if !new.has_converged() {
        reasons.push(format!("the new fit did not converge ({})", new.stop_reason));
    }
    let (before_m, after_m) = (residual_m(earlier), residual_m(new));
    if let (Some(before_m), Some(after_m)) = (before_m, after_m)
        && after_m > RESIDUAL_GROWTH_RATIO_MAX * before_m.max(new.noise_m)
    {
        reasons.push(format!(
            "its residuals of {:.3} mm exceed {RESIDUAL_GROWTH_RATIO_MAX} times the earlier {:.3} mm",
            after_m * 1e3,
            before_m * 1e3
        ));
    }
    for parameter in new.parameters.iter().filter(|parameter| parameter.at_bound && !parameter.determined) {
        if earlier.parameters.iter().any(|p| p.name == parameter.name && p.determined && !p.at_bound) {
            reasons.push(format!("`{}` was determined and now rests on a bound", parameter.name));
        }
    }
    let drift = drift(earlier, new);
    if let Some(drift) = drift.as_ref().filter(|drift| drift.p < DRIFT_P_MAX) {
        let named =
            if drift.parameters.is_empty() { "a combination".into() } else { drift.parameters.join(", ") };
        reasons.push(format!(
            "the mechanism has changed ({named}; chi-square {:.1} on {}, p = {:.1e}); fit the new runs by themselves",
            drift.chi2, drift.degrees, drift.p
        ));
    }
    Recalibration { accepted: reasons.is_empty(), reasons, drift }
}

/// Root mean square of the fitted runs' residuals \[m\].
fn residual_m(fit: &Fit) -> Option<f64> {
    let squares: Vec<f64> =
        fit.runs.iter().filter_map(|run| run.noise).map(|noise| noise.residual_m.powi(2)).collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

fn drift(earlier: &Fit, new: &Fit) -> Option<Drift> {
    let common: Vec<&String> = earlier.names().iter().filter(|name| new.names().contains(name)).collect();
    let (before, after) = (earlier.information_about(&common)?, new.information_about(&common)?);
    let count = common.len();
    let value = |fit: &Fit, name: &str| fit.parameters.iter().find(|p| p.name == name).map(|p| p.value);
    let change: Option<Vec<f64>> =
        common.iter().map(|name| Some(value(new, name)? - value(earlier, name)?)).collect();
    // In units that make both together 1, the informations are a and 1 - a along common axes.
    let sizes: Vec<f64> = (0..count)
        .map(|i| (before[(i, i)] + after[(i, i)]).sqrt())
        .map(|root| if root > 0.0 { 1.0 / root } else { 0.0 })
        .collect();
    let scaled = |m: &DMatrix<f64>| DMatrix::from_fn(count, count, |i, j| m[(i, j)] * sizes[i] * sizes[j]);
    let eigen = SymmetricEigen::new(scaled(&before) + scaled(&after));
    let largest = eigen.eigenvalues.max();
    let axes: Vec<DVector<f64>> = eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
        .filter(|(value, _)| **value > largest * 1e-12)
        .map(|(value, axis)| axis / value.sqrt())
        .collect();
    if axes.is_empty() {
        return None;
    }
    let round = DMatrix::from_columns(&axes);
    let eigen = SymmetricEigen::new(round.transpose() * scaled(&before) * &round);
    let change = DVector::from_vec(change?);
    let unscaled = DVector::from_fn(count, |i, _| if sizes[i] > 0.0 { change[i] / sizes[i] } else { 0.0 });
    // Coordinates of the change along the common axes: with T'(A + B)T = 1 they are T'(A + B) change.
    let coordinates = round.transpose() * (scaled(&before) + scaled(&after)) * unscaled;
    let coordinates = eigen.eigenvectors.transpose() * coordinates;
    let (mut chi2, mut degrees) = (0.0, 0);
    for (share, coordinate) in eigen.eigenvalues.iter().zip(&coordinates) {
        let share = share.clamp(0.0, 1.0);
        if share.min(1.0 - share) * INFORMATION_RATIO_MAX >= 1.0 {
            chi2 += share * (1.0 - share) * coordinate * coordinate;
            degrees += 1;
        }
    }
    let changed = |name: &&&String| {
        let of = |fit: &Fit| {
            fit.parameters.iter().find(|p| p.name == ***name && p.determined).map(|p| (p.value, p.std))
        };
        of(earlier)
            .zip(of(new))
            .is_some_and(|((a, s), (b, t))| (a - b).abs() > CHANGED_PARAMETER_Z * s.hypot(t))
    };
    let parameters = common.iter().filter(changed).map(|name| (*name).clone()).collect();
    (degrees > 0).then(|| Drift { chi2, degrees, p: chi2_survival(chi2, degrees as f64), parameters })
}

impl Fit {
    /// Whether it ended because there was nothing more to gain, and not for want of evaluations.
    pub fn has_converged(&self) -> bool {
        !["max-evaluations", "simulation-failed", INTERRUPTED].contains(&self.stop_reason.as_str())
    }

    fn names(&self) -> &[String] {
        self.information.as_ref().map_or(&[], |information| &information.names)
    }

    /// Information about `names`, all others free.
    fn information_about(&self, names: &[&String]) -> Option<DMatrix<f64>> {
        let joint = self.information.as_ref().filter(|joint| !joint.names.is_empty())?;
        let count = joint.names.len();
        if joint.matrix.len() != count || joint.matrix.iter().any(|row| row.len() != count) {
            return None;
        }
        let wanted: Vec<usize> =
            names.iter().filter_map(|name| joint.names.iter().position(|known| known == *name)).collect();
        let others: Vec<usize> = (0..count).filter(|i| !wanted.contains(i)).collect();
        let part = |rows: &[usize], columns: &[usize]| {
            DMatrix::from_fn(rows.len(), columns.len(), |i, j| joint.matrix[rows[i]][columns[j]])
        };
        let block = part(&wanted, &wanted);
        if others.is_empty() {
            return Some(block);
        }
        let inverse = part(&others, &others).pseudo_inverse(f64::EPSILON).ok()?;
        let across = part(&wanted, &others);
        Some(block - &across * inverse * across.transpose())
    }

    /// By what factor the fit overstates its information: its residuals are larger than assumed, and correlated.
    fn overweight(&self) -> f64 {
        let factors: Vec<f64> = self
            .runs
            .iter()
            .filter_map(|run| run.noise)
            .map(|noise| noise.chi2_per_degree * (1.0 + noise.correlation) / (1.0 - noise.correlation))
            .collect();
        if factors.is_empty() { 1.0 } else { factors.iter().sum::<f64>() / factors.len() as f64 }
    }

    /// What this fit says about those of `parameters` that it has, as a belief that counts `weight` times.
    fn belief(&self, parameters: &Parameters, weight: f64) -> Result<Belief, FitError> {
        let places: Vec<usize> = (0..parameters.len())
            .filter(|&i| self.names().iter().any(|name| name == parameters.free[i].name()))
            .collect();
        let names: Vec<String> = places.iter().map(|&i| parameters.free[i].name().to_owned()).collect();
        let information =
            self.information_about(&names.iter().collect::<Vec<_>>()).ok_or(FitError::NothingInherited)?;
        let value = |name: &String| self.parameters.iter().find(|p| p.name == *name).map(|p| p.value);
        let mean: Option<Vec<f64>> = names.iter().map(value).collect();
        let mean = mean.ok_or(FitError::NothingInherited)?;
        if names.is_empty() || !information.iter().chain(&mean).all(|x| x.is_finite()) {
            return Err(FitError::NothingInherited);
        }
        Ok(Belief { places, mean, information, weight })
    }
}
