//! What a fit has cost so far.

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
}
