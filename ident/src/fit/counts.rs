//! What a fit has cost so far, and whether anybody still waits for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How long somebody who has interrupted waits for what follows from what was found (chosen).
const GRACE: Duration = Duration::from_millis(700);

/// Candidates tried and runs simulated.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Counts {
    /// Parameter vectors tried, those of finite differences included.
    pub(crate) evaluations: u64,
    /// Runs simulated.
    pub(crate) rollouts: u64,
    /// Raised by whoever no longer waits. From then on no run is simulated: every point looks as if it could not be, so that
    /// all loops end by themselves, and what they found is to be thrown away.
    #[serde(skip)]
    stop: Arc<AtomicBool>,
    /// When nobody waits any longer in any case.
    #[serde(skip)]
    deadline: Option<Instant>,
}

impl Counts {
    /// Nothing counted yet; `stop` says when nobody waits any longer.
    pub(crate) fn until(stop: Arc<AtomicBool>) -> Self {
        Self { stop, ..Self::default() }
    }

    /// Nothing counted yet, for part of the same work.
    pub(crate) fn apart(&self) -> Self {
        Self { deadline: self.deadline, ..Self::until(self.stop()) }
    }

    /// The same, where nobody waits any longer from `deadline` on either.
    pub(crate) fn by(self, deadline: Instant) -> Self {
        Self { deadline: Some(self.deadline.map_or(deadline, |earlier| earlier.min(deadline))), ..self }
    }

    /// The same for whoever has interrupted, who still waits a moment for what follows from what was found.
    pub(crate) fn for_last_words(&self) -> Self {
        let mut counts = Self::default().by(Instant::now() + GRACE);
        counts.add(self);
        counts
    }

    /// As many as `other` says, waited for as before.
    pub(crate) fn return_to(&mut self, other: &Self) {
        (self.evaluations, self.rollouts) = (other.evaluations, other.rollouts);
    }

    /// Raised where nobody waits any longer.
    pub(crate) fn stop(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.stop)
    }

    /// Whether nobody waits for the result any longer.
    pub(crate) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// Adds counts made separately with [`Self::apart`].
    pub(crate) fn add(&mut self, other: &Self) {
        self.evaluations += other.evaluations;
        self.rollouts += other.rollouts;
    }

    /// The results of `work` for each of `items`, in their order, computed in parallel; their counts are added.
    pub(crate) fn of_each<T: Send, R: Send>(
        &mut self,
        items: Vec<T>,
        work: impl Fn(T, &mut Self) -> R + Sync,
    ) -> Vec<R> {
        let counted = items.into_par_iter().map(|item| {
            let mut item_counts = self.apart();
            (work(item, &mut item_counts), item_counts)
        });
        let (results, counts): (Vec<R>, Vec<Self>) = counted.unzip();
        counts.iter().for_each(|item_counts| self.add(item_counts));
        results
    }
}
