//! Covariance matrix adaptation: a sampler that learns the shape of the valley it walks down.
//!
//! [`CmaEs::ask`] draws a generation of candidates, the caller judges them in whatever order and on however
//! many threads it likes, [`CmaEs::tell`] learns from the ranking. Drawing depends on nothing but the state
//! and the seed, and the state is plain data: a search that was saved goes on to the identical end.
//!
//! The constants and updates are those of the tutorial, with its negative weights (active update). With
//! [`Options::unit_box`] candidates are folded back at 0 and 1 like light between mirrors: the loss stays
//! continuous, an optimum on the boundary stays an optimum, no penalty has to be tuned, and the folded problem
//! has no minima that the boxed one has not.
//!
//! # Source
//! N. Hansen, "The CMA Evolution Strategy: A Tutorial", arXiv 1604.00772v2.

mod constants;
mod restarts;
mod stop;

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use constants::Constants;
pub use restarts::{Restarting, Restarts};
pub use stop::{Options, Stop};

/// A step may grow this many times its first size.
const MAX_GROWTH: f64 = 1e4;
/// Largest ratio of the covariance's eigenvalues that double precision still resolves.
const MAX_CONDITION: f64 = 1e14;

/// A search under way. Serialising it loses nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CmaEs {
    options: Options,
    generation: u64,
    evaluations: u64,
    /// Distribution mean, unfolded, shape (n).
    mean: Vec<f64>,
    /// Overall step size.
    sigma: f64,
    /// Covariance without the step size, shape (n, n), row-major.
    covariance: Vec<f64>,
    /// Evolution path of the step size, shape (n).
    path_sigma: Vec<f64>,
    /// Evolution path of the covariance, shape (n).
    path_c: Vec<f64>,
    /// Point and loss of the best candidate so far.
    best: Option<(Vec<f64>, f64)>,
    history: stop::History,
    stop: Option<Stop>,
}

/// One generation of candidates, drawn and not yet judged.
#[derive(Debug, Clone)]
pub struct Generation {
    /// Candidates, folded into the box where there is one, shape (population, n).
    pub points: Vec<Vec<f64>>,
    /// Steps from the mean in units of sigma, shape (population, n).
    steps: Vec<DVector<f64>>,
    /// The same steps made round: C^(-1/2) step.
    round: Vec<DVector<f64>>,
    /// Square roots of the covariance's eigenvalues, shape (n), and its eigenvectors by column.
    axes: (DVector<f64>, DMatrix<f64>),
}

impl CmaEs {
    /// A search from `start`, shape (n), n above 0.
    pub fn new(start: &[f64], options: Options) -> Self {
        let n = start.len();
        assert!(n > 0, "a search needs at least one dimension");
        Self {
            sigma: options.sigma,
            options,
            generation: 0,
            evaluations: 0,
            mean: start.to_vec(),
            covariance: DMatrix::<f64>::identity(n, n).as_slice().to_vec(),
            path_sigma: vec![0.0; n],
            path_c: vec![0.0; n],
            best: None,
            history: stop::History::default(),
            stop: None,
        }
    }

    /// Candidates of one generation.
    pub fn population(&self) -> usize {
        self.options.population_for(self.mean.len())
    }

    /// Candidates judged so far.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Generations judged so far.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// Point and loss of the best candidate so far.
    pub fn best(&self) -> Option<(&[f64], f64)> {
        self.best.as_ref().map(|(point, loss)| (point.as_slice(), *loss))
    }

    /// Why the search is over, once it is.
    pub fn stop(&self) -> Option<Stop> {
        self.stop
    }

    /// Draws the next generation; the same one until [`CmaEs::tell`] is called.
    pub fn ask(&self) -> Generation {
        let n = self.mean.len();
        let mut random = ChaCha8Rng::seed_from_u64(self.options.seed);
        random.set_stream(self.generation);
        let eigen = SymmetricEigen::new(DMatrix::from_column_slice(n, n, &self.covariance));
        let roots = eigen.eigenvalues.map(|value| value.max(f64::MIN_POSITIVE).sqrt());
        let mut generation =
            Generation { points: vec![], steps: vec![], round: vec![], axes: (roots, eigen.eigenvectors) };
        let (roots, vectors) = &generation.axes;
        for _ in 0..self.population() {
            let normal = DVector::from_fn(n, |_, _| StandardNormal.sample(&mut random));
            let step = vectors * roots.component_mul(&normal);
            let point = self.mean.iter().zip(&step).map(|(mean, step)| self.fold(mean + self.sigma * step));
            generation.points.push(point.collect());
            generation.steps.push(step);
            generation.round.push(vectors * normal);
        }
        generation
    }

    fn fold(&self, x: f64) -> f64 {
        if !self.options.unit_box {
            return x;
        }
        let turned = x.rem_euclid(2.0);
        if turned > 1.0 { 2.0 - turned } else { turned }
    }

    /// Learns from the `losses` of `generation`, in its order; one that is not finite ranks last.
    pub fn tell(&mut self, generation: &Generation, losses: &[f64]) {
        let n = self.mean.len();
        let population = generation.points.len();
        assert_eq!(population, losses.len(), "one loss per candidate");
        let losses: Vec<f64> =
            losses.iter().map(|l| if l.is_finite() { *l } else { f64::INFINITY }).collect();
        let mut order: Vec<usize> = (0..population).collect();
        order.sort_by(|&a, &b| losses[a].total_cmp(&losses[b]));
        self.generation += 1;
        self.evaluations += population as u64;
        let (first, first_loss) = (order[0], losses[order[0]]);
        if first_loss.is_finite() && self.best.as_ref().is_none_or(|(_, loss)| first_loss < *loss) {
            self.best = Some((generation.points[first].clone(), first_loss));
        }

        let k = Constants::new(n, population);
        let mut mean_step = DVector::<f64>::zeros(n);
        let mut mean_round = DVector::<f64>::zeros(n);
        for (&candidate, &weight) in order.iter().zip(&k.weights).filter(|(_, weight)| **weight > 0.0) {
            mean_step.axpy(weight, &generation.steps[candidate], 1.0);
            mean_round.axpy(weight, &generation.round[candidate], 1.0);
        }
        for (mean, step) in self.mean.iter_mut().zip(&mean_step) {
            *mean += self.sigma * step;
        }

        let mut path_sigma = DVector::from_column_slice(&self.path_sigma);
        path_sigma *= 1.0 - k.c_sigma;
        path_sigma.axpy((k.c_sigma * (2.0 - k.c_sigma) * k.mu_eff).sqrt(), &mean_round, 1.0);
        let warm_up = 1.0 - (1.0 - k.c_sigma).powf(2.0 * self.generation as f64);
        let length = path_sigma.norm();
        // A path this long means the step size lags behind: hold the covariance's path still meanwhile.
        let steady = length / warm_up.sqrt() < (1.4 + 2.0 / (n as f64 + 1.0)) * k.expected_length;

        let mut path_c = DVector::from_column_slice(&self.path_c);
        path_c *= 1.0 - k.c_c;
        if steady {
            path_c.axpy((k.c_c * (2.0 - k.c_c) * k.mu_eff).sqrt(), &mean_step, 1.0);
        }

        let mut covariance = DMatrix::from_column_slice(n, n, &self.covariance);
        let held = if steady { 0.0 } else { k.c_c * (2.0 - k.c_c) };
        let weight_sum: f64 = k.weights.iter().sum();
        covariance *= 1.0 + k.c_1 * held - k.c_1 - k.c_mu * weight_sum;
        covariance.syger(k.c_1, &path_c, &path_c, 1.0);
        for (&candidate, &weight) in order.iter().zip(&k.weights) {
            let round = &generation.round[candidate];
            let bounded = if weight < 0.0 { weight * n as f64 / round.norm_squared() } else { weight };
            let step = &generation.steps[candidate];
            covariance.syger(k.c_mu * bounded, step, step, 1.0);
        }
        covariance.fill_upper_triangle_with_lower_triangle();

        self.sigma *= ((k.c_sigma / k.d_sigma) * (length / k.expected_length - 1.0)).min(1.0).exp();
        self.path_sigma = path_sigma.as_slice().to_vec();
        self.path_c = path_c.as_slice().to_vec();
        self.covariance = covariance.as_slice().to_vec();
        let ranked: Vec<f64> = order.iter().map(|&candidate| losses[candidate]).collect();
        self.history.push(&ranked, self.options.history_for(n));
        self.stop = self.reason_to_stop(&ranked, &generation.axes);
    }

    /// Criteria of the tutorial's appendix B.3 on the state after a generation.
    fn reason_to_stop(&self, ranked: &[f64], axes: &(DVector<f64>, DMatrix<f64>)) -> Option<Stop> {
        let (n, options) = (self.mean.len(), &self.options);
        let best = self.best.as_ref().map_or(f64::INFINITY, |(_, loss)| *loss);
        if options.target.is_some_and(|target| best <= target) {
            return Some(Stop::Target);
        }
        if self.evaluations + ranked.len() as u64 > options.max_evaluations {
            return Some(Stop::MaxEvaluations);
        }
        let window = 10 + (30.0 * n as f64 / ranked.len() as f64).ceil() as usize;
        if self.history.is_flat(window, ranked, options.tol_loss + options.tol_loss_share * best.abs()) {
            return Some(Stop::TolLoss);
        }
        let deviation = |i: usize| self.covariance[i * n + i].sqrt();
        if (0..n).all(|i| self.sigma * self.path_c[i].abs().max(deviation(i)) < options.tol_step) {
            return Some(Stop::TolStep);
        }
        if self.sigma > MAX_GROWTH * options.sigma || !self.sigma.is_finite() {
            return Some(Stop::Diverged);
        }
        let (roots, vectors) = axes;
        if (roots.max() / roots.min()).powi(2) > MAX_CONDITION {
            return Some(Stop::Condition);
        }
        let axis = self.generation as usize % n;
        let unmoved = |i: usize, by: f64| self.mean[i] + by == self.mean[i];
        if (0..n).all(|i| unmoved(i, 0.1 * self.sigma * roots[axis] * vectors[(i, axis)]))
            || (0..n).any(|i| unmoved(i, 0.2 * self.sigma * deviation(i)))
        {
            return Some(Stop::NoEffect);
        }
        self.history.is_stagnant(options.history_for(n)).then_some(Stop::Stagnation)
    }
}

#[cfg(test)]
mod tests;
