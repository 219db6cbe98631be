//! `timing.json`: how long each stage took. Kept apart from the results, which are the same on every machine.

use std::time::Instant;

use serde::{Deserialize, Serialize};

/// Wall times of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Worker threads that the fit used.
    pub workers: usize,
    /// The stages, in order.
    pub stages: Vec<Stage>,
}

/// One stage's wall time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// Which stage.
    pub name: String,
    /// How long it took \[s\].
    pub wall_s: f64,
}

impl Timing {
    /// Carries out `stage` and notes how long it took.
    pub fn measure<T>(&mut self, name: &str, stage: impl FnOnce() -> T) -> T {
        let begun = Instant::now();
        let result = stage();
        self.stages.push(Stage { name: name.into(), wall_s: begun.elapsed().as_secs_f64() });
        result
    }
}
