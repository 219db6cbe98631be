//! The fit as a sum of squares: residuals of all runs, priors, and their derivatives.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use sim::Model;
use sim::model::Parameter;
use sim::sensitivities::Sensitivities;

use super::counts::Counts;
use crate::config::Prior;
use crate::loss::{Observation, residuals, residuals_of_all};
use crate::noise::Whitening;
use crate::parameters::Parameters;
use crate::simulate::{Numbers, Rehearsal};

/// A run with what of it is looked at.
#[derive(Debug, Clone)]
pub(crate) struct Term<'a> {
    pub(crate) rehearsal: Rehearsal<'a>,
    pub(crate) observations: Vec<Observation>,
    /// Images to simulate: up to the last one looked at.
    pub(crate) instants: usize,
    /// What makes noise that lasts look white; `None`: it is white.
    pub(crate) whitening: Option<Whitening>,
}

impl<'a> Term<'a> {
    pub(crate) fn new(rehearsal: Rehearsal<'a>, observations: Vec<Observation>) -> Self {
        let instants = observations.last().map_or(0, |last| last.instant + 1);
        Self { rehearsal, observations, instants, whitening: None }
    }

    /// The residuals at each of `points`, of this term's run `run`; `None` where a simulation fails.
    fn residuals(
        &self,
        problem: &Problem<'_>,
        places: &[Parameter],
        points: &[Point],
        run: usize,
    ) -> Vec<Option<DVector<f64>>> {
        let spread = |point: &Point| problem.parameters.spread(&point.values);
        let candidates: Vec<(Vec<f64>, &[f64])> =
            points.iter().map(|point| (spread(point), &point.offsets[run][..])).collect();
        let width = self.rehearsal.run.trajectory.keypoints.len();
        let all = self.rehearsal.simulate_all(problem.model, places, &candidates, self.instants);
        let all: Vec<Option<Vec<[f64; 3]>>> =
            all.map_or_else(|_| vec![None; points.len()], |all| all.into_iter().map(Result::ok).collect());
        let simulated: Vec<&[[f64; 3]]> = all.iter().flatten().map(Vec::as_slice).collect();
        let mut found = residuals_of_all(&self.observations, &simulated, width).into_iter();
        let whitened = |mut residuals: Vec<f64>| {
            if let Some(whitening) = &self.whitening {
                whitening.apply(&mut residuals);
            }
            residuals.into()
        };
        all.iter().map(|one| one.as_ref().and_then(|_| found.next()).map(whitened)).collect()
    }

    /// Residuals and the `columns` of their derivatives.
    pub(crate) fn linear(
        &self,
        model: &Model,
        at: &Numbers<'_>,
        offsets: &[f64],
        columns: Range<usize>,
    ) -> Option<Linear> {
        let found = self.rehearsal.sensitivities(model, at, offsets, columns, self.instants);
        let Sensitivities { position_m, slopes, .. } = found.ok()?;
        let width = self.rehearsal.run.trajectory.keypoints.len();
        let rows = self.observations.iter().map(|o| (o.instant * width + o.keypoint, o.axis, o.per_m));
        let rows: Vec<(usize, usize, f64)> = rows.collect();
        let mut jacobian = DMatrix::from_fn(rows.len(), slopes.len(), |row, column| {
            let (place, axis, per_m) = rows[row];
            -slopes[column][place][axis] * per_m
        });
        let mut residuals = residuals(&self.observations, &position_m, width);
        if let Some(whitening) = &self.whitening {
            whitening.apply(&mut residuals);
            jacobian.column_iter_mut().for_each(|mut column| whitening.apply(column.as_mut_slice()));
        }
        Some(Linear { residuals: residuals.into(), jacobian })
    }

    /// Squares of the nuisances in units of their weak beliefs.
    pub(crate) fn belief_cost(&self, offsets: &[f64]) -> f64 {
        self.rehearsal.nuisances.iter().zip(offsets).map(|(n, x)| (x / n.belief()).powi(2)).sum()
    }
}

/// Parameters and nuisances, of the model and of each run.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Point {
    /// SI values, shape (P).
    pub(crate) values: Vec<f64>,
    /// Offsets by run.
    pub(crate) offsets: Vec<Vec<f64>>,
}

/// What is minimised: squared residuals in standard deviations, plus priors.
#[derive(Debug, Clone)]
pub(crate) struct Problem<'a> {
    pub(crate) model: &'a Model,
    pub(crate) parameters: &'a Parameters,
    pub(crate) terms: Vec<Term<'a>>,
}

/// Residuals of one run and their derivatives.
#[derive(Debug, Clone)]
pub(crate) struct Linear {
    pub(crate) residuals: DVector<f64>,
    /// Shape (residuals, columns): the free parameters first, then the run's nuisances.
    pub(crate) jacobian: DMatrix<f64>,
}

impl Linear {
    /// Products of the Jacobian's columns, shape (columns, columns).
    pub(crate) fn gram(&self) -> DMatrix<f64> {
        self.jacobian.transpose() * &self.jacobian
    }
}

impl<'a> Problem<'a> {
    /// The start of a fit: the model's values, every offset 0.
    pub(crate) fn start(&self) -> Point {
        let offsets = self.terms.iter().map(|term| vec![0.0; term.rehearsal.nuisances.len()]).collect();
        Point { values: self.parameters.start(), offsets }
    }

    /// The part of the problem that is one run.
    pub(crate) fn alone(&self, run: usize) -> Problem<'a> {
        Problem { terms: vec![self.terms[run].clone()], ..*self }
    }

    /// Squared distance from the priors in their standard deviations.
    pub(crate) fn prior_cost(&self, values: &[f64]) -> f64 {
        let parameters = self.parameters.free.iter().zip(values);
        let cost = |prior: Prior, x: f64| ((x - prior.mean.get()) / prior.std.get()).powi(2);
        parameters.filter_map(|(parameter, &x)| Some(cost(parameter.prior?, x))).sum()
    }

    /// The cost of each point; infinite where a simulation fails. Runs of all points share the threads; sums
    /// are taken in the order of the runs.
    pub(crate) fn costs(&self, points: &[Point], counts: &mut Counts) -> Vec<f64> {
        counts.evaluations += points.len() as u64;
        self.costs_of_rollouts(points, counts)
    }

    /// As [`Problem::costs`], where points differ in nuisances only and count as no further evaluation.
    pub(crate) fn costs_of_rollouts(&self, points: &[Point], counts: &mut Counts) -> Vec<f64> {
        let parts = self.judged(points, |_, residuals| residuals.norm_squared(), counts);
        self.summed(points, &parts)
    }

    /// What `judge`, told the run and its residuals, says of each run at each point, and what the run's offsets cost; shape
    /// (points, runs), infinite where a simulation fails. Runs and points share the threads.
    pub(crate) fn judged(
        &self,
        points: &[Point],
        judge: impl Fn(usize, &DVector<f64>) -> f64 + Sync,
        counts: &mut Counts,
    ) -> Vec<f64> {
        let runs = self.terms.len();
        counts.rollouts += (points.len() * runs) as u64;
        let places = self.parameters.places();
        // one task is a run with as many points as share a pass, or fewer where a thread would have nothing to do
        let shares = rayon::current_num_threads().div_ceil(runs.max(1));
        let together = points.len().div_ceil(shares).clamp(1, sim::Isa::best().candidates());
        let tasks: Vec<(usize, usize)> = (0..runs)
            .flat_map(|run| (0..points.len()).step_by(together).map(move |first| (run, first)))
            .collect();
        let parts: Vec<Vec<f64>> = tasks
            .par_iter()
            .map(|&(run, first)| {
                if counts.is_stopped() {
                    return vec![f64::INFINITY; together.min(points.len() - first)];
                }
                let (term, points) = (&self.terms[run], &points[first..points.len().min(first + together)]);
                let residuals = term.residuals(self, &places, points, run);
                let cost = |(residuals, point): (Option<DVector<f64>>, &Point)| {
                    let offsets = term.belief_cost(&point.offsets[run]);
                    residuals.map_or(f64::INFINITY, |residuals| judge(run, &residuals) + offsets)
                };
                residuals.into_iter().zip(points).map(cost).collect()
            })
            .collect();
        let mut table = vec![0.0; points.len() * runs];
        for ((run, first), part) in tasks.into_iter().zip(parts) {
            for (k, cost) in part.into_iter().enumerate() {
                table[(first + k) * runs + run] = cost;
            }
        }
        table
    }

    /// Sums of `parts`, shape (points, runs), with the priors; in the order of the runs.
    pub(crate) fn summed(&self, points: &[Point], parts: &[f64]) -> Vec<f64> {
        let runs = self.terms.len();
        let cost = |(index, point): (usize, &Point)| {
            parts[index * runs..(index + 1) * runs].iter().sum::<f64>() + self.prior_cost(&point.values)
        };
        points.iter().enumerate().map(cost).collect()
    }

    /// Residuals and derivatives of every run at `point`, by the parameters (if `by_parameters`) and by the run's
    /// own nuisances, exact to rounding. `None` where the point cannot be simulated.
    pub(crate) fn linearise(
        &self,
        point: &Point,
        by_parameters: bool,
        counts: &mut Counts,
    ) -> Option<Vec<Linear>> {
        let free = if by_parameters { self.parameters.len() } else { 0 };
        counts.evaluations += u64::from(by_parameters);
        counts.rollouts +=
            self.terms.iter().map(|term| (1 + free + term.rehearsal.nuisances.len()) as u64).sum::<u64>();
        let places = self.parameters.places();
        let values = self.parameters.spread(&point.values);
        let varied: Vec<_> = self.parameters.rates().into_iter().take(free).collect();
        let at = Numbers { places: &places, values: &values, varied: &varied };
        // one task is a run with as many columns as share a pass
        let together = sim::Isa::best().directions();
        let tasks: Vec<(usize, usize)> = self
            .terms
            .iter()
            .enumerate()
            .flat_map(|(run, term)| {
                let columns = free + term.rehearsal.nuisances.len();
                (0..columns.max(1)).step_by(together).map(move |first| (run, first))
            })
            .collect();
        let parts: Vec<Option<Linear>> = tasks
            .par_iter()
            .map(|&(run, first)| {
                let columns = first..first + together;
                let linear = || self.terms[run].linear(self.model, &at, &point.offsets[run], columns);
                if counts.is_stopped() { None } else { linear() }
            })
            .collect();
        let mut linear: Vec<Linear> = Vec::with_capacity(self.terms.len());
        for ((_, first), part) in tasks.into_iter().zip(parts) {
            let part = part?;
            match linear.last_mut().filter(|_| first > 0) {
                Some(whole) => {
                    let (columns, more) = (whole.jacobian.ncols(), part.jacobian.ncols());
                    let mut jacobian =
                        std::mem::take(&mut whole.jacobian).resize_horizontally(columns + more, 0.0);
                    jacobian.columns_mut(columns, more).copy_from(&part.jacobian);
                    whole.jacobian = jacobian;
                }
                None => linear.push(part),
            }
        }
        Some(linear)
    }
}
