//! Searches that begin again where one has converged, with other populations.
//!
//! A larger population sees the valley behind the ripples, a smaller one with a shorter step combs a place
//! thoroughly. Every restart draws its start from the whole box.
//!
//! # Sources
//! IPOP: A. Auger, N. Hansen, "A restart CMA evolution strategy with increasing population size", IEEE Congress on
//! Evolutionary Computation (2005). BIPOP: N. Hansen, "Benchmarking a BI-population CMA-ES on the BBOB-2009
//! function testbed", GECCO workshop (2009).

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardUniform};
use serde::{Deserialize, Serialize};

use super::{CmaEs, Options, Stop};

/// How a search goes on once it has converged, while evaluations are left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Restarts {
    /// Not at all.
    #[default]
    None,
    /// Again, each time with twice the population.
    Ipop,
    /// Again, with twice the population or with a small one, whichever has had fewer evaluations.
    Bipop,
}

/// The searches of a series. Serialising it loses nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Restarting {
    kind: Restarts,
    /// Of the first search.
    options: Options,
    /// Population of the first search.
    population: usize,
    dimension: usize,
    /// Restarts so far, and those of them with a large population.
    restarts: u64,
    doublings: u32,
    /// Evaluations spent by large and by small populations, the first search left out.
    spent: [u64; 2],
    /// Evaluations of the last search with a large population, or of the first.
    last_large: u64,
    /// Evaluations of all searches that are over.
    total: u64,
    /// Whether the search under way has a small population.
    small: bool,
}

/// Every restart draws from a stream of its own: the streams of its seed are the generations.
const SEED_STEP: u64 = 0x9e37_79b9_7f4a_7c15;
/// A population is doubled at most so often.
const MAX_DOUBLINGS: u32 = 9;

impl Restarting {
    /// What follows `first`, which has not begun.
    pub fn new(kind: Restarts, first: &CmaEs) -> Self {
        Self {
            kind,
            options: first.options.clone(),
            population: first.population(),
            dimension: first.mean.len(),
            restarts: 0,
            doublings: 0,
            spent: [0; 2],
            last_large: 0,
            total: 0,
            small: false,
        }
    }

    /// Restarts so far.
    pub fn count(&self) -> u64 {
        self.restarts
    }

    /// The search that follows `over`; `None` where nothing does: no restarts are wanted, the target is met, or no
    /// evaluations are left for a generation.
    pub fn next(&mut self, over: &CmaEs) -> Option<CmaEs> {
        if self.kind == Restarts::None || over.stop() == Some(Stop::Target) {
            return None;
        }
        let used = over.evaluations();
        self.total += used;
        if self.restarts > 0 {
            self.spent[usize::from(self.small)] += used;
        }
        if !self.small {
            self.last_large = used;
        }
        self.restarts += 1;
        let seed = self.options.seed.wrapping_add(SEED_STEP.wrapping_mul(self.restarts));
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut uniform = || -> f64 { StandardUniform.sample(&mut random) };
        let start: Vec<f64> = (0..self.dimension).map(|_| uniform()).collect();

        let left = self.options.max_evaluations.saturating_sub(self.total);
        let mut options = Options { seed, max_evaluations: left, ..self.options.clone() };
        self.small = self.kind == Restarts::Bipop && self.doublings > 0 && self.spent[1] < self.spent[0];
        if self.small {
            let growth = f64::from(1 << self.doublings) / 2.0;
            let population = self.population as f64 * growth.powf(uniform().powi(2));
            options.population = Some(population as usize);
            options.sigma *= 10f64.powf(-2.0 * uniform());
            options.max_evaluations = left.min((self.last_large / 2).max(1));
        } else {
            self.doublings = (self.doublings + 1).min(MAX_DOUBLINGS);
            options.population = Some(self.population << self.doublings);
        }
        let next = CmaEs::new(&start, options);
        // A small search must at least be able to begin; what it may use up is no more than what is left.
        (next.population() as u64 <= left).then_some(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Many equal funnels on a slope: a single search with a small population ends in one of them.
    fn rastrigin(point: &[f64]) -> f64 {
        let term = |x: &f64| {
            let x = 10.0 * x - 3.7;
            x * x + 10.0 * (1.0 - (std::f64::consts::TAU * x).cos())
        };
        point.iter().map(term).sum()
    }

    fn best(kind: Restarts, seed: u64, max_evaluations: u64) -> (f64, u64, u64) {
        let options = Options {
            sigma: 0.2,
            unit_box: true,
            seed,
            max_evaluations,
            target: Some(1e-6),
            ..Options::default()
        };
        let mut sampler = CmaEs::new(&[0.9; 5], options);
        let mut restarting = Restarting::new(kind, &sampler);
        let (mut best, mut evaluations) = (f64::INFINITY, 0);
        loop {
            while sampler.stop().is_none() {
                let generation = sampler.ask();
                let losses: Vec<f64> = generation.points.iter().map(|point| rastrigin(point)).collect();
                sampler.tell(&generation, &losses);
            }
            best = best.min(sampler.best().unwrap().1);
            evaluations += sampler.evaluations();
            match restarting.next(&sampler) {
                Some(next) => sampler = next,
                None => return (best, evaluations, restarting.count()),
            }
        }
    }

    #[test]
    fn restarts_find_the_deepest_of_many_funnels() {
        let found = |kind| (1..=5).filter(|&seed| best(kind, seed, 100_000).0 <= 1e-6).count();
        let [once, ipop, bipop] = [Restarts::None, Restarts::Ipop, Restarts::Bipop].map(found);
        assert!(once <= 1, "{once} of 5 without restarts");
        assert_eq!([ipop, bipop], [5, 5]);
    }

    #[test]
    fn restarts_keep_the_budget() {
        for kind in [Restarts::Ipop, Restarts::Bipop] {
            let (_, evaluations, restarts) = best(kind, 1, 3000);
            assert!(restarts > 0 && evaluations <= 3000, "{kind:?}: {evaluations} in {restarts}");
        }
    }
}
