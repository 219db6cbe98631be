//! Slow drift: coefficients that have moved over many runs by more than their intervals, though no single run contradicted the one
//! before.
//!
//! The last five runs that determine a coefficient are compared with the first five that do. Each mean is as uncertain as its runs say, or as
//! they scatter, whichever is more.

use serde::{Deserialize, Serialize};

use store::runs::Coefficient;
use store::{Store, StoreError};

/// Runs in each of the two means. Chosen.
const RUNS_PER_MEAN: usize = 5;
/// A difference beyond this many standard deviations is a drift. Scatters of five runs are uncertain themselves: of differences without
/// drift one in a thousand is beyond this (Student's t with 8 degrees of freedom).
const DRIFT_LIMIT_STDS: f64 = 5.0;

/// A coefficient that has moved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Moved {
    /// Its name.
    pub name: String,
    /// Mean of the first runs.
    pub from: f64,
    /// Mean of the last runs.
    pub to: f64,
    /// Standard deviation of the difference.
    pub std: f64,
}

impl std::fmt::Display for Moved {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { name, from, to, std } = self;
        write!(f, "{name} has moved from {from:.4} to {to:.4} ({std:.1e})")
    }
}

/// The coefficients that have moved in the runs of `store`.
///
/// # Errors
/// [`StoreError`].
pub fn moved(store: &mut Store) -> Result<Vec<Moved>, StoreError> {
    store.refresh(false)?;
    let mut list = Vec::new();
    for name in store.coefficient_names()? {
        list.extend(drift(&store.trend(&name)?));
    }
    Ok(list)
}

fn drift(trend: &[Coefficient]) -> Option<Moved> {
    let known: Vec<(f64, f64)> = trend
        .iter()
        .filter(|one| one.determined)
        .filter_map(|one| Some((one.value, one.std.filter(|&std| std > 0.0)?)))
        .collect();
    if known.len() < 2 * RUNS_PER_MEAN {
        return None;
    }
    let (from, from_var) = mean(&known[..RUNS_PER_MEAN]);
    let (to, to_var) = mean(&known[known.len() - RUNS_PER_MEAN..]);
    let std = (from_var + to_var).sqrt();
    let name = trend.first()?.name.clone();
    ((to - from).abs() > DRIFT_LIMIT_STDS * std).then_some(Moved { name, from, to, std })
}

/// Weighted mean of values with standard deviations, and its variance.
fn mean(runs: &[(f64, f64)]) -> (f64, f64) {
    let weight: f64 = runs.iter().map(|(_, std)| std.powi(-2)).sum();
    let mean = runs.iter().map(|(value, std)| value * std.powi(-2)).sum::<f64>() / weight;
    let count = runs.len() as f64;
    let scatter = runs.iter().map(|(value, _)| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, (1.0 / weight).max(scatter / count))
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};

    use super::*;

    /// Runs whose values differ by `scatter` from run to run, and move by `slope` a run.
    fn trend(runs: usize, scatter: f64, slope: f64, seed: u64) -> Vec<Coefficient> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let normal = rand_distr::StandardNormal;
        (0..runs)
            .map(|run| {
                let noise: f64 = random.sample(normal);
                Coefficient {
                    run: run.to_string(),
                    name: "g3/blunt".into(),
                    unit: "1".into(),
                    value: 1.0 + slope * run as f64 + scatter * noise,
                    std: Some(0.01),
                    determined: true,
                    lower: 0.0,
                    upper: 10.0,
                }
            })
            .collect()
    }

    #[test]
    fn slow_drift_is_seen_and_scatter_is_none() {
        // 1 % of the interval's width a run: no run contradicts the one before
        let found = drift(&trend(60, 0.01, 0.002, 1)).unwrap();
        assert!((found.to - found.from - 0.11).abs() < 4.0 * found.std, "{found}");
        // what runs scatter beyond their intervals is no drift
        let false_alarms = (0..2000).filter(|&seed| drift(&trend(60, 0.03, 0.0, seed)).is_some()).count();
        assert!(false_alarms <= 8, "{false_alarms} of 2000");
        assert_eq!(drift(&trend(9, 0.0, 0.1, 1)), None, "too few");
    }
}
