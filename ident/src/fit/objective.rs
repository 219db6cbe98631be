//! What a fit minimises, in full: the squares of [`Problem`], their robust form, and an earlier fit's belief.

use nalgebra::{DMatrix, DVector};

use super::counts::Counts;
use super::problem::{Linear, Point, Problem};
use crate::config::Loss;
use crate::parameters::Parameters;

/// Beyond so many standard deviations a residual counts linearly: 95 % efficient where the noise is normal.
///
/// # Source
/// P. J. Huber, "Robust Estimation of a Location Parameter", Annals of Mathematical Statistics 35 (1964) 73-101;
/// the constant: P. J. Huber, "Robust Statistics" (1981), section 4.5.
const HUBER_Z: f64 = 1.345;

impl Loss {
    /// What a residual \[standard deviations\] costs: its square, as far as it is believed.
    pub(crate) fn cost(self, residual: f64) -> f64 {
        match self {
            Self::Huber if residual.abs() > HUBER_Z => HUBER_Z * (2.0 * residual.abs() - HUBER_Z),
            Self::Huber | Self::Squares => residual * residual,
        }
    }

    /// What all of `residuals` cost.
    pub(crate) fn total(self, residuals: &DVector<f64>) -> f64 {
        match self {
            Self::Squares => residuals.norm_squared(),
            Self::Huber => residuals.iter().map(|&r| self.cost(r)).sum(),
        }
    }

    /// Weight of a residual's row in the normal equations that have the same slope.
    fn weight(self, residual: f64) -> f64 {
        match self {
            Self::Huber if residual.abs() > HUBER_Z => HUBER_Z / residual.abs(),
            Self::Huber | Self::Squares => 1.0,
        }
    }

    /// Half the slope of [`Loss::cost`]: the residual, cut off where it is not believed.
    pub(crate) fn influence(self, residual: f64) -> f64 {
        self.weight(residual) * residual
    }

    /// Slope of [`Loss::influence`].
    pub(crate) fn slope(self, residual: f64) -> f64 {
        if self == Self::Huber && residual.abs() > HUBER_Z { 0.0 } else { 1.0 }
    }
}

/// A belief about several parameters at once, as another fit left it: weight (x - mean)' information (x - mean).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Belief {
    /// Which free parameters, shape (B).
    pub(crate) places: Vec<usize>,
    /// Their most probable values, shape (B).
    pub(crate) mean: Vec<f64>,
    /// Inverse covariance, shape (B, B).
    pub(crate) information: DMatrix<f64>,
    /// How many times over it counts: as often as the data count themselves, whose noise is larger and more
    /// correlated than assumed.
    pub(crate) weight: f64,
}

impl Belief {
    fn offset(&self, values: &[f64]) -> DVector<f64> {
        let offsets = self.places.iter().zip(&self.mean).map(|(&place, mean)| values[place] - mean);
        DVector::from_iterator(self.places.len(), offsets)
    }

    pub(crate) fn cost(&self, values: &[f64]) -> f64 {
        let offset = self.offset(values);
        self.weight * offset.dot(&(&self.information * &offset))
    }

    /// Half the slope of the cost, shape (B).
    pub(crate) fn pull(&self, values: &[f64]) -> DVector<f64> {
        &self.information * self.offset(values) * self.weight
    }
}

/// The function that a fit minimises.
#[derive(Debug, Clone)]
pub(crate) struct Objective<'a> {
    pub(crate) problem: Problem<'a>,
    pub(crate) loss: Loss,
    pub(crate) belief: Option<Belief>,
}

impl<'a> Objective<'a> {
    /// Plain squares.
    pub(crate) fn squares(problem: Problem<'a>) -> Self {
        Self { problem, loss: Loss::Squares, belief: None }
    }

    pub(crate) fn parameters(&self) -> &'a Parameters {
        self.problem.parameters
    }

    /// The part of the objective that is one run.
    pub(crate) fn alone(&self, run: usize) -> Self {
        Self { problem: self.problem.alone(run), loss: self.loss, belief: self.belief.clone() }
    }

    /// What values cost before any run is looked at.
    pub(crate) fn prior_cost(&self, values: &[f64]) -> f64 {
        self.problem.prior_cost(values) + self.belief.as_ref().map_or(0.0, |belief| belief.cost(values))
    }

    /// The cost of each point, infinite where a simulation fails. `evaluates`: the points differ in parameters, and
    /// count as evaluations.
    pub(crate) fn costs(&self, points: &[Point], evaluates: bool, counts: &mut Counts) -> Vec<f64> {
        let mut costs = match (self.loss, evaluates) {
            (Loss::Squares, true) => self.problem.costs(points, counts),
            (Loss::Squares, false) => self.problem.costs_of_rollouts(points, counts),
            (Loss::Huber, _) => {
                counts.evaluations += if evaluates { points.len() as u64 } else { 0 };
                self.robust_costs(points, counts)
            }
        };
        if let Some(belief) = &self.belief {
            costs.iter_mut().zip(points).for_each(|(cost, point)| *cost += belief.cost(&point.values));
        }
        costs
    }

    fn robust_costs(&self, points: &[Point], counts: &mut Counts) -> Vec<f64> {
        let judge = |_: usize, residuals: &DVector<f64>| self.loss.total(residuals);
        let parts = self.problem.judged(points, judge, counts);
        self.problem.summed(points, &parts)
    }

    /// As [`Problem::linearise`] with rows weighed as the loss believes them, and what the residuals cost.
    pub(crate) fn linearise(
        &self,
        point: &Point,
        by_parameters: bool,
        counts: &mut Counts,
    ) -> Option<(Vec<Linear>, f64)> {
        let mut runs = self.problem.linearise(point, by_parameters, counts)?;
        let mut cost = 0.0;
        for linear in &mut runs {
            cost += self.loss.total(&linear.residuals);
            if self.loss == Loss::Squares {
                continue;
            }
            for row in 0..linear.residuals.len() {
                let root = self.loss.weight(linear.residuals[row]).sqrt();
                linear.residuals[row] *= root;
                linear.jacobian.row_mut(row).scale_mut(root);
            }
        }
        Some((runs, cost))
    }
}
