//! Levenberg-Marquardt: nonlinear least squares by damped Gauss-Newton steps, over unknowns few enough for a dense matrix
//! (K. Madsen, H. B. Nielsen, O. Tingleff, "Methods for non-linear least squares problems", 2004).

use std::iter::successors;

use nalgebra::{DMatrix, DVector};

/// The damping at first, the least and the largest one that is tried, and the factor by which it falls after a step that lowers the sum of
/// squares and rises after one that does not (all chosen).
const DAMPING_INITIAL: f64 = 1e-3;
const DAMPING_MIN: f64 = 1e-9;
const DAMPING_MAX: f64 = 1e9;
const DAMPING_FACTOR: f64 = 5.0;

/// Settings of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevenbergMarquardt {
    /// Most linearisations.
    pub iterations_max: usize,
    /// Relative decrease of the sum of squares below which the search ends.
    pub relative_tolerance: f64,
    /// What the damping is a multiple of.
    pub scaling: Scaling,
}

/// What the damping of an unknown is a multiple of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scaling {
    /// Its own curvature, as Marquardt has it: the steps are the same in any units.
    Marquardt,
    /// The largest curvature, as Levenberg has it: an unknown on which the residuals hardly depend stays where it is.
    Levenberg,
}

/// Normal equations of the residuals r with the Jacobian J.
#[derive(Debug, Clone, PartialEq)]
pub struct NormalEquations {
    /// Gauss-Newton approximation of the Hessian, JᵀJ, shape (n, n).
    pub hessian: DMatrix<f64>,
    /// Half the gradient of the sum of squares, Jᵀr, shape (n).
    pub gradient: DVector<f64>,
}

impl NormalEquations {
    /// By central differences: `after` computes the residuals after a step, shape (n), and `differences` is the step of each unknown.
    pub fn by_differences(
        residuals: &DVector<f64>,
        differences: &[f64],
        after: impl Fn(&DVector<f64>) -> DVector<f64>,
    ) -> Self {
        let mut jacobian = DMatrix::zeros(residuals.len(), differences.len());
        for (k, difference) in differences.iter().enumerate() {
            let step = DVector::from_fn(differences.len(), |i, _| if i == k { *difference } else { 0.0 });
            jacobian.set_column(k, &((after(&step) - after(&-&step)) / (2.0 * difference)));
        }
        Self { hessian: jacobian.tr_mul(&jacobian), gradient: jacobian.tr_mul(residuals) }
    }

    /// The damped Gauss-Newton step; `None` where the damped matrix is not positive definite.
    fn step(&self, damping: f64, scaling: Scaling) -> Option<DVector<f64>> {
        let mut damped = self.hessian.clone();
        let curvature = self.hessian.diagonal();
        for i in 0..damped.nrows() {
            let scale = if scaling == Scaling::Marquardt { curvature[i] } else { curvature.max() };
            damped[(i, i)] += damping * scale + f64::MIN_POSITIVE;
        }
        damped.cholesky().map(|factor| -factor.solve(&self.gradient))
    }
}

/// Where a search ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Minimum<P> {
    /// The point.
    pub point: P,
    /// The residuals there.
    pub residuals: DVector<f64>,
    /// Whether no step lowers the sum of squares by more than the tolerance. Otherwise the iterations ran out, or nothing was finite.
    pub converged: bool,
}

impl LevenbergMarquardt {
    /// The least sum of squares of `residuals` from `start` on. `linearise` makes the normal equations at a point, whose residuals it
    /// is given; `moved` is the point that a step, shape (n), leads to.
    pub fn minimise<P>(
        &self,
        start: P,
        residuals: impl Fn(&P) -> DVector<f64>,
        linearise: impl Fn(&P, &DVector<f64>) -> NormalEquations,
        moved: impl Fn(&P, &DVector<f64>) -> P,
    ) -> Minimum<P> {
        let at = |point| Minimum { residuals: residuals(&point), point, converged: false };
        let mut best = at(start);
        let mut damping = DAMPING_INITIAL;
        for _ in 0..self.iterations_max {
            let normal = linearise(&best.point, &best.residuals);
            let before = best.residuals.norm_squared();
            let mut dampings = successors(Some(damping), |damping| Some(damping * DAMPING_FACTOR))
                .take_while(|damping| *damping <= DAMPING_MAX);
            let Some((used, lower)) = dampings.find_map(|damping| {
                let tried = at(moved(&best.point, &normal.step(damping, self.scaling)?));
                (tried.residuals.norm_squared() < before).then_some((damping, tried))
            }) else {
                return Minimum { converged: before.is_finite(), ..best };
            };
            (best, damping) = (lower, (used / DAMPING_FACTOR).max(DAMPING_MIN));
            let after = best.residuals.norm_squared();
            if before - after <= self.relative_tolerance * after {
                return Minimum { converged: true, ..best };
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEARCH: LevenbergMarquardt =
        LevenbergMarquardt { iterations_max: 100, relative_tolerance: 1e-12, scaling: Scaling::Marquardt };
    const DIFFERENCE_STEP_RELATIVE: f64 = 1e-6;

    fn minimum(
        search: LevenbergMarquardt,
        start: &[f64],
        residuals: impl Fn(&DVector<f64>) -> DVector<f64>,
    ) -> Minimum<DVector<f64>> {
        let differences = vec![DIFFERENCE_STEP_RELATIVE; start.len()];
        let linearise = |at: &DVector<f64>, here: &DVector<f64>| {
            NormalEquations::by_differences(here, &differences, |step| residuals(&(at + step)))
        };
        search.minimise(DVector::from_column_slice(start), &residuals, linearise, |at, step| at + step)
    }

    #[test]
    fn rosenbrocks_valley_is_followed_to_its_lowest_point() {
        let residuals =
            |at: &DVector<f64>| DVector::from_vec(vec![10.0 * (at[1] - at[0] * at[0]), 1.0 - at[0]]);
        for scaling in [Scaling::Marquardt, Scaling::Levenberg] {
            let found = minimum(LevenbergMarquardt { scaling, ..SEARCH }, &[-1.2, 1.0], residuals);
            assert!(found.converged && found.point.add_scalar(-1.0).amax() < 1e-8, "{found:?}");
            // three steps do not lead round the bend
            let stopped =
                minimum(LevenbergMarquardt { iterations_max: 3, scaling, ..SEARCH }, &[-1.2, 1.0], residuals);
            assert!(!stopped.converged && stopped.residuals.norm() > 0.1, "{stopped:?}");
        }
    }

    #[test]
    fn linear_residuals_end_where_their_normal_equations_are_solved() {
        let slopes = DMatrix::from_row_slice(4, 2, &[1.0, 0.0, 1.0, 1.0, 1.0, 2.0, 1.0, 3.0]);
        let values = DVector::from_vec(vec![1.0, 3.0, 2.0, 5.0]);
        let residuals = |at: &DVector<f64>| &slopes * at - &values;
        // the line through them: JᵀJ = [4 6; 6 14], Jᵀy = [11; 22], solved by 1.1 and 1.1
        let normal = NormalEquations::by_differences(&-&values, &[DIFFERENCE_STEP_RELATIVE; 2], residuals);
        assert!((normal.hessian - DMatrix::from_row_slice(2, 2, &[4.0, 6.0, 6.0, 14.0])).amax() < 1e-8);
        assert!((normal.gradient + DVector::from_vec(vec![11.0, 22.0])).amax() < 1e-8);
        let found = minimum(SEARCH, &[-50.0, 70.0], residuals);
        assert!(found.converged && found.point.add_scalar(-1.1).amax() < 1e-8, "{found:?}");
        assert!((found.residuals.norm_squared() - 2.7).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn an_unknown_of_no_effect_stays_where_it_is() {
        for scaling in [Scaling::Marquardt, Scaling::Levenberg] {
            let search = LevenbergMarquardt { scaling, ..SEARCH };
            let found = minimum(search, &[3.0, 7.0], |at| DVector::from_vec(vec![at[0].sinh()]));
            assert!(found.converged && found.point[0].abs() < 1e-8 && found.point[1] == 7.0, "{found:?}");
        }
    }

    #[test]
    fn residuals_that_are_not_finite_do_not_converge() {
        let found = minimum(SEARCH, &[1.0], |at| DVector::from_vec(vec![(at[0] - 2.0).sqrt()]));
        assert!(!found.converged && found.point[0] == 1.0, "{found:?}");
    }
}
