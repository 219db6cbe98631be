//! The fit as a sum of squares: residuals of all runs, priors, and their derivatives.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use sim::Model;

use super::counts::Counts;
use crate::loss::{Observation, residuals};
use crate::parameters::Parameters;
use crate::simulate::Rehearsal;

/// A run with what of it is looked at.
#[derive(Debug, Clone)]
pub(super) struct Term<'a> {
    pub(super) rehearsal: Rehearsal<'a>,
    pub(super) observations: Vec<Observation>,
    /// Images to simulate: up to the last one looked at.
    pub(super) instants: usize,
}

impl<'a> Term<'a> {
    pub(super) fn new(rehearsal: Rehearsal<'a>, observations: Vec<Observation>) -> Self {
        let instants = observations.last().map_or(0, |last| last.instant + 1);
        Self { rehearsal, observations, instants }
    }

    pub(super) fn residuals(&self, model: &Model, offsets: &[f64]) -> Option<DVector<f64>> {
        let simulated = self.rehearsal.simulate(model, offsets, self.instants).ok()?;
        let width = self.rehearsal.run.trajectory.keypoints.len();
        Some(residuals(&self.observations, &simulated, width).into())
    }

    /// Squares of the nuisances in units of their weak beliefs.
    pub(super) fn belief_cost(&self, offsets: &[f64]) -> f64 {
        self.rehearsal.nuisances.iter().zip(offsets).map(|(n, x)| (x / n.belief()).powi(2)).sum()
    }
}

/// Parameters and nuisances, of the model and of each run.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Point {
    /// SI values, shape (P).
    pub(super) values: Vec<f64>,
    /// Offsets by run.
    pub(super) offsets: Vec<Vec<f64>>,
}

/// What is minimised: squared residuals in standard deviations, plus priors.
#[derive(Debug, Clone)]
pub(super) struct Problem<'a> {
    pub(super) model: &'a Model,
    pub(super) parameters: &'a Parameters,
    pub(super) terms: Vec<Term<'a>>,
}

/// Residuals of one run and their derivatives.
pub(super) struct Linear {
    pub(super) residuals: DVector<f64>,
    /// Shape (residuals, columns): the free parameters first, then the run's nuisances.
    pub(super) jacobian: DMatrix<f64>,
}

/// How derivatives are taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Difference {
    /// One rollout per column.
    Forward,
    /// Two, and a thousand times more exact.
    Central,
}

/// Relative step of a parameter's finite difference.
const STEP: f64 = 1e-4;

impl<'a> Problem<'a> {
    /// The start of a fit: the model's values, every offset 0.
    pub(super) fn start(&self) -> Point {
        let offsets = self.terms.iter().map(|term| vec![0.0; term.rehearsal.nuisances.len()]).collect();
        Point { values: self.parameters.start(), offsets }
    }

    /// The part of the problem that is one run.
    pub(super) fn alone(&self, run: usize) -> Problem<'a> {
        Problem { terms: vec![self.terms[run].clone()], ..*self }
    }

    /// Squared distance from the priors in their standard deviations.
    pub(super) fn prior_cost(&self, values: &[f64]) -> f64 {
        let parameters = self.parameters.free.iter().zip(values);
        let cost =
            |prior: crate::experiment::Prior, x: f64| ((x - prior.mean.get()) / prior.std.get()).powi(2);
        parameters.filter_map(|(parameter, &x)| Some(cost(parameter.prior?, x))).sum()
    }

    /// The cost of each point; infinite where a simulation fails. Runs of all points share the threads; sums
    /// are taken in the order of the runs.
    pub(super) fn costs(&self, points: &[Point], counts: &mut Counts) -> Vec<f64> {
        counts.evaluations += points.len() as u64;
        self.costs_of_rollouts(points, counts)
    }

    /// As [`Problem::costs`], where points differ in nuisances only and count as no further evaluation.
    pub(super) fn costs_of_rollouts(&self, points: &[Point], counts: &mut Counts) -> Vec<f64> {
        let runs = self.terms.len();
        counts.rollouts += (points.len() * runs) as u64;
        let models: Vec<Model> =
            points.iter().map(|point| self.parameters.applied(&point.values, self.model)).collect();
        let squares: Vec<f64> = (0..points.len() * runs)
            .into_par_iter()
            .map(|task| {
                let (point, run) = (task / runs, task % runs);
                let (term, offsets) = (&self.terms[run], &points[point].offsets[run]);
                let squares = term.residuals(&models[point], offsets).map(|r| r.norm_squared());
                squares.map_or(f64::INFINITY, |squares| squares + term.belief_cost(offsets))
            })
            .collect();
        let cost = |(index, point): (usize, &Point)| {
            squares[index * runs..(index + 1) * runs].iter().sum::<f64>() + self.prior_cost(&point.values)
        };
        points.iter().enumerate().map(cost).collect()
    }

    /// Residuals and derivatives of every run at `point`, by the parameters (if `by_parameters`) and by the run's
    /// own nuisances. `None` where the point itself cannot be simulated; a column that cannot is 0.
    pub(super) fn linearise(
        &self,
        point: &Point,
        by_parameters: bool,
        difference: Difference,
        counts: &mut Counts,
    ) -> Option<Vec<Linear>> {
        let free = if by_parameters { self.parameters.len() } else { 0 };
        let sides: &[f64] = if difference == Difference::Central { &[1.0, -1.0] } else { &[1.0] };
        counts.evaluations += u64::from(by_parameters) * (1 + free * sides.len()) as u64;
        let base_model = self.parameters.applied(&point.values, self.model);

        // (run, column, side); the column past the last is the point itself.
        let mut tasks: Vec<(usize, usize, f64)> = Vec::new();
        for (run, term) in self.terms.iter().enumerate() {
            tasks.push((run, usize::MAX, 0.0));
            for column in 0..free + term.rehearsal.nuisances.len() {
                tasks.extend(sides.iter().map(|&side| (run, column, side)));
            }
        }
        counts.rollouts += tasks.len() as u64;
        let shifted: Vec<Option<DVector<f64>>> = tasks
            .par_iter()
            .map(|&(run, column, side)| {
                let (term, offsets) = (&self.terms[run], &point.offsets[run]);
                if column == usize::MAX {
                    return term.residuals(&base_model, offsets);
                }
                if column < free {
                    let mut values = point.values.clone();
                    values[column] += side * self.parameter_step(point, column);
                    return term.residuals(&self.parameters.applied(&values, self.model), offsets);
                }
                let mut offsets = offsets.clone();
                offsets[column - free] += side * term.rehearsal.nuisances[column - free].step();
                term.residuals(&base_model, &offsets)
            })
            .collect();

        let mut shifted = shifted.into_iter();
        let mut linear = Vec::with_capacity(self.terms.len());
        for term in &self.terms {
            let base = shifted.next()??;
            let columns = free + term.rehearsal.nuisances.len();
            let mut jacobian = DMatrix::zeros(base.len(), columns);
            for column in 0..columns {
                let step = if column < free {
                    self.parameter_step(point, column)
                } else {
                    term.rehearsal.nuisances[column - free].step()
                };
                let up = shifted.next()?;
                let down = if difference == Difference::Central { shifted.next()? } else { None };
                let slope = match (up, down) {
                    (Some(up), Some(down)) => (up - down) / (2.0 * step),
                    (Some(up), None) => (up - &base) / step,
                    (None, Some(down)) => (&base - down) / step,
                    (None, None) => continue,
                };
                jacobian.set_column(column, &slope);
            }
            linear.push(Linear { residuals: base, jacobian });
        }
        Some(linear)
    }

    /// Signed, so that a step from the upper bound stays within; from a lower bound of 0 it always does.
    fn parameter_step(&self, point: &Point, index: usize) -> f64 {
        let (scale, value) = (&self.parameters.free[index].scale, point.values[index]);
        let step = STEP * value.abs().max(scale.resolution());
        if value + step > scale.upper() { -step } else { step }
    }
}
