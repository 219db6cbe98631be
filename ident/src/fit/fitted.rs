//! What a fit yields.

use std::sync::Arc;
use std::time::Duration;

use sim::{BasePath, Model, Poses, State, Trajectory};

use super::report::{FirstTouch, Fit};
use crate::experiment::Use;

/// A calibrated model, and how well it repeats the runs.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// `fit.json`.
    pub fit: Fit,
    /// The calibrated model.
    pub model: Model,
    /// Each run of the experiment, in its order.
    pub runs: Vec<FittedRun>,
    /// How long it took; kept apart, because [`Fit`] must not depend on it.
    pub timing: Timing,
}

impl Fitted {
    /// The calibrated model as MJCF text that begins with `comment`, with a keyframe where each run starts. Causes that MJCF holds exactly stand where MuJoCo looks
    /// for them; others stay as our own numbers, and the comment says what MuJoCo lacks.
    pub fn to_mjcf(&self, comment: &str) -> String {
        let folded = self.model.folded();
        let starts = FittedRun::starts(&self.runs);
        if folded.lost.is_empty() && folded.altered.is_empty() {
            return folded.model.to_mjcf_from(comment, &starts);
        }
        let lost: Vec<&str> = folded.lost.iter().map(|cause| cause.name()).collect();
        let lacks = match lost[..] {
            [] => String::new(),
            _ => format!(" MuJoCo itself moves without {}.", lost.join(", ")),
        };
        self.model.to_mjcf_from(&format!("{comment}{lacks}"), &starts)
    }
}

/// One run with its simulation.
#[derive(Debug, Clone)]
pub struct FittedRun {
    /// Id of the run.
    pub id: String,
    /// Whether the run was fitted or held out.
    pub usage: Use,
    /// Estimated state, held until the motion starts.
    pub initial: State,
    /// When the motion starts \[s\].
    pub start_s: f64,
    /// Errors are over the images from here on \[s\].
    pub scored_from_s: f64,
    /// The same keypoints at the same instants, from the calibrated model.
    pub simulated: Trajectory,
    /// The coordinates behind them, row-major, shape (N, nq).
    pub qpos: Vec<f64>,
    /// Path of the base; `None`: it did not move.
    pub base: Option<Arc<BasePath>>,
    /// The measured keypoints, shape as `simulated`.
    pub measured: Trajectory,
    /// Geoms of the calibrated model that touch without contact being simulated: from then on it does not move as MuJoCo would have it.
    pub touch: Option<FirstTouch>,
}

impl FittedRun {
    /// Where each of `runs` starts, by its id.
    pub fn starts(runs: &[Self]) -> Vec<(&str, &State)> {
        runs.iter().map(|run| (run.id.as_str(), &run.initial)).collect()
    }

    /// Where everything of `model`, the calibrated one, is at each instant, in the world.
    pub fn poses(&self, model: &Model) -> Vec<Poses> {
        let altered = model.altered();
        let model = altered.as_ref().unwrap_or(model);
        let instants = self.simulated.time_s.iter().zip(self.qpos.chunks_exact(model.nq().max(1)));
        let poses = |(&time_s, qpos): (&f64, &[f64])| {
            let poses = model.poses(qpos);
            self.base.as_ref().map_or_else(|| poses.clone(), |base| base.at(time_s).carried(&poses))
        };
        instants.map(poses).collect()
    }
}

/// How long a fit took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// From the first estimate to the last error bar.
    pub wall: Duration,
    /// Threads that simulated.
    pub threads: usize,
}
