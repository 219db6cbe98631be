//! What a fit has cost so far.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Candidates tried and runs simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub(crate) struct Counts {
    /// Parameter vectors tried, those of finite differences included.
    pub(crate) evaluations: u64,
    /// Runs simulated.
    pub(crate) rollouts: u64,
}

impl Counts {
    /// Counts what was counted apart.
    pub(crate) fn add(&mut self, other: &Self) {
        self.evaluations += other.evaluations;
        self.rollouts += other.rollouts;
    }

    /// What `work` makes of each of `items`, in their order; they share the threads, and what each costs is counted.
    pub(crate) fn of_each<T: Send, R: Send>(
        &mut self,
        items: Vec<T>,
        work: impl Fn(T, &mut Self) -> R + Sync,
    ) -> Vec<R> {
        let counted = items.into_par_iter().map(|item| {
            let mut own = Self::default();
            (work(item, &mut own), own)
        });
        let (results, counts): (Vec<R>, Vec<Self>) = counted.unzip();
        counts.iter().for_each(|own| self.add(own));
        results
    }
}
