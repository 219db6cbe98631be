//! The global phase: CMA-ES over the parameters' unit box.
//!
//! The starts of the runs are not searched but eliminated: at an anchor point every run's start is fitted by
//! least squares, and how its keypoints answer to it is linearised there. Each candidate then costs one
//! simulation per run, and the part of its residuals that another start would explain is taken out of its
//! loss. Every [`ANCHOR_PERIOD`] generations the best candidate has its starts fitted for real; if it is better, it
//! becomes the anchor. Searched as extra dimensions instead, three angles per run would double the dimension
//! of a fit of a few runs and hide shallow directions of the parameters behind steep ones of the poses.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::counts::Counts;
use super::least_squares::{Descent, Freedom};
use super::objective::Objective;
use super::problem::Point;
use crate::cmaes::{CmaEs, Options, Restarting, Restarts, Stop};
use crate::config::Loss;

/// Generations between anchors (chosen).
const ANCHOR_PERIOD: u64 = 10;
/// Initial step as a share of the unit box: the start is a guess, the box holds everything possible.
const FIRST_STEP_SHARE: f64 = 0.2;
/// Losses that differ less, as a share of the best, end the search.
const TOL_LOSS_SHARE: f64 = 1e-8;
/// Steps shorter than this share of the box end the search.
const TOL_STEP_SHARE: f64 = 1e-7;
/// Candidates that one pass simulates side by side with AVX2, half of those with AVX-512 (see [`sim::Isa::candidates`]): as long
/// as there are fewer, more of them take no longer.
const PASS_CANDIDATES: usize = 8;

/// A search under way. Serialising it loses nothing.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Search {
    sampler: CmaEs,
    /// What follows a sampler that has converged.
    restarting: Restarting,
    /// Why the search is over.
    stop: Option<Stop>,
    /// The best point so far, its starts fitted.
    pub(super) anchor: Point,
    /// Its cost; JSON knows no infinity: `None` where it cannot be simulated.
    pub(super) cost: Option<f64>,
    /// Best candidate since the anchor was set, in the unit box, with its cost.
    candidate: Option<(Vec<f64>, f64)>,
    /// Derived from the anchor, never saved.
    #[serde(skip)]
    elimination: Option<Vec<Elimination>>,
}

/// How one run's residuals change with its start, linearised at the anchor.
#[derive(Debug, Clone)]
struct Elimination {
    /// Derivative of the residuals by the nuisances.
    jacobian: DMatrix<f64>,
    hessian: Cholesky<f64, Dyn>,
    /// Pull of the nuisances' beliefs.
    pull: DVector<f64>,
}

/// Candidates of a generation: the tutorial's 4 + 3 ln D, and as many more as fill a pass.
fn population(dimension: usize) -> usize {
    (4 + (3.0 * (dimension.max(1) as f64).ln()) as usize).next_multiple_of(PASS_CANDIDATES)
}

impl Search {
    /// A search that starts at `start`, whose starts are fitted first.
    pub(super) fn new(
        objective: &Objective<'_>,
        start: Point,
        restarts: Restarts,
        seed: u64,
        max_evaluations: u64,
        counts: &mut Counts,
    ) -> Self {
        let options = Options {
            sigma: FIRST_STEP_SHARE,
            unit_box: true,
            seed,
            max_evaluations,
            tol_loss: 0.0,
            tol_loss_share: TOL_LOSS_SHARE,
            tol_step: TOL_STEP_SHARE,
            population: Some(population(objective.parameters().len())),
            ..Options::default()
        };
        let (anchor, cost) = fit_starts(objective, start, counts);
        let sampler = CmaEs::new(&objective.parameters().units(&anchor.values), options);
        let restarting = Restarting::new(restarts, &sampler);
        Self { sampler, restarting, stop: None, anchor, cost, candidate: None, elimination: None }
    }

    /// Why the search is over, once it is.
    pub(super) fn stop(&self) -> Option<Stop> {
        self.stop
    }

    /// One generation.
    pub(super) fn step(&mut self, objective: &Objective<'_>, counts: &mut Counts) {
        if self.elimination.is_none() {
            // On resuming, these rollouts were counted before.
            let fresh = self.sampler.generation() == 0 && self.restarting.count() == 0;
            let mut uncounted = counts.apart();
            self.elimination =
                Some(eliminate(objective, &self.anchor, if fresh { counts } else { &mut uncounted }));
        }
        let generation = self.sampler.ask();
        let losses = self.losses(objective, &generation.points, counts);
        for (point, &loss) in generation.points.iter().zip(&losses) {
            if loss.is_finite() && self.candidate.as_ref().is_none_or(|(_, best)| loss < *best) {
                self.candidate = Some((point.clone(), loss));
            }
        }
        self.sampler.tell(&generation, &losses);
        let converged = self.sampler.stop();
        if self.sampler.generation().is_multiple_of(ANCHOR_PERIOD) || converged.is_some() {
            self.drop_anchor(objective, counts);
        }
        if converged.is_some() {
            match self.restarting.next(&self.sampler) {
                Some(sampler) => self.sampler = sampler,
                None => self.stop = converged,
            }
        }
    }

    /// Fits the starts of the best candidate; it becomes the anchor if that makes it the best point.
    pub(super) fn drop_anchor(&mut self, objective: &Objective<'_>, counts: &mut Counts) {
        let Some((point, loss)) = self.candidate.take() else { return };
        let start =
            Point { values: objective.parameters().values(&point), offsets: self.anchor.offsets.clone() };
        let known = start.offsets.iter().all(Vec::is_empty);
        let (fitted, cost) = if known { (start, Some(loss)) } else { fit_starts(objective, start, counts) };
        if cost.is_some_and(|cost| self.cost.is_none_or(|best| cost < best)) {
            (self.anchor, self.cost) = (fitted, cost);
            self.elimination = Some(eliminate(objective, &self.anchor, counts));
        }
    }

    /// Losses of candidates in the unit box.
    fn losses(&self, objective: &Objective<'_>, units: &[Vec<f64>], counts: &mut Counts) -> Vec<f64> {
        let problem = &objective.problem;
        let runs = problem.terms.len();
        counts.evaluations += units.len() as u64;
        let point = |units: &Vec<f64>| Point {
            values: problem.parameters.values(units),
            offsets: self.anchor.offsets.clone(),
        };
        let points: Vec<Point> = units.iter().map(point).collect();
        let elimination = self.elimination.as_deref().unwrap_or(&[]);
        let judge = |run: usize, residuals: &DVector<f64>| match elimination.get(run) {
            Some(elimination) => elimination.cost(residuals, objective.loss),
            None => objective.loss.total(residuals),
        };
        let parts = problem.judged(&points, judge, counts);
        let loss = |(point, parts): (&Point, &[f64])| {
            let loss = parts.iter().sum::<f64>() + objective.prior_cost(&point.values);
            if loss.is_finite() { loss } else { f64::INFINITY }
        };
        points.iter().zip(parts.chunks(runs.max(1))).map(loss).collect()
    }
}

impl Elimination {
    /// What residuals cost that no change of the start explains.
    fn cost(&self, residuals: &DVector<f64>, loss: Loss) -> f64 {
        let slope = self.jacobian.tr_mul(residuals) + &self.pull;
        let step = self.hessian.solve(&slope);
        match loss {
            Loss::Squares => residuals.norm_squared() - slope.dot(&step),
            Loss::Huber => loss.total(&(residuals - &self.jacobian * step)),
        }
    }
}

/// Fits the start of every run by itself with the parameters held fixed; returns the point and its cost.
pub(super) fn fit_starts(
    objective: &Objective<'_>,
    mut point: Point,
    counts: &mut Counts,
) -> (Point, Option<f64>) {
    let prior_cost = objective.prior_cost(&point.values);
    let fits: Vec<(Descent, Counts)> = (0..objective.problem.terms.len())
        .into_par_iter()
        .map(|run| {
            let start = Point { values: point.values.clone(), offsets: vec![point.offsets[run].clone()] };
            let (mut descent, mut run_counts) = (Descent::new(start, None), counts.apart());
            let alone = objective.alone(run);
            if alone.problem.terms[0].rehearsal.nuisances.is_empty() {
                let cost = alone.costs(std::slice::from_ref(&descent.point), false, &mut run_counts)[0];
                descent.cost = Some(cost).filter(|cost| cost.is_finite());
            } else {
                descent.run(&alone, Freedom::Nuisances, &mut run_counts);
            }
            (descent, run_counts)
        })
        .collect();
    let mut total = Some(prior_cost);
    for (run, (descent, run_counts)) in fits.into_iter().enumerate() {
        counts.rollouts += run_counts.rollouts;
        total = total.zip(descent.cost).map(|(total, cost)| total + cost - prior_cost);
        point.offsets[run] = descent.point.offsets.concat();
    }
    (point, total)
}

fn eliminate(objective: &Objective<'_>, anchor: &Point, counts: &mut Counts) -> Vec<Elimination> {
    let problem = &objective.problem;
    if anchor.offsets.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let linear = problem.linearise(anchor, false, counts).unwrap_or_default();
    let one = |(run, linear): (usize, super::problem::Linear)| {
        let nuisances = &problem.terms[run].rehearsal.nuisances;
        let mut hessian = linear.gram();
        for (k, nuisance) in nuisances.iter().enumerate() {
            hessian[(k, k)] += nuisance.belief().powi(-2);
        }
        let pulls = nuisances.iter().zip(&anchor.offsets[run]).map(|(n, x)| x * n.belief().powi(-2));
        let pull = DVector::from_iterator(nuisances.len(), pulls);
        Some(Elimination { hessian: hessian.cholesky()?, jacobian: linear.jacobian, pull })
    };
    // Where the anchor cannot be simulated, candidates are judged with their starts as they are.
    linear.into_iter().enumerate().map(one).collect::<Option<Vec<_>>>().unwrap_or_default()
}
