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
