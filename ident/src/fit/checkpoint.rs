//! A fit that was interrupted, and what it says while it runs.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use super::counts::Counts;
use super::least_squares::Descent;
use super::problem::{Linear, Point};
use super::search::Search;
use crate::experiment::Experiment;
use crate::parameters::Parameters;

/// Everything a fit needs to go on to the identical result.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Which experiment it belongs to.
    pub(super) experiment: String,
    pub(super) counts: Counts,
    pub(super) stage: Stage,
    /// Descents of `hybrid` that are over.
    pub(super) ended: Vec<Ended>,
    /// Where further ones begin.
    pub(super) waiting: Vec<(Origin, Point)>,
}

/// The stage that a fit is in.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Stage {
    Search(Box<Search>),
    /// A descent, how many evaluations there may be when it ends, and, as long as it is on the rough objective, when that ends.
    Descent {
        origin: Origin,
        descent: Descent,
        limit: u64,
        rough: Option<u64>,
    },
}

/// Where a descent began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Origin {
    /// At the model's values, or the priors' means.
    Model,
    /// Where the search ended.
    Search,
    /// The same with loose joints: next to no dry friction.
    Loose,
    /// At the best of some points drawn evenly from the bounds.
    Drawn,
    /// Where a fit of the first part of the runs ended.
    Warm,
}

impl Origin {
    /// Whether a descent from there may be all that is needed: else a search follows.
    pub(super) fn precedes_search(self) -> bool {
        match self {
            Self::Model | Self::Loose | Self::Warm => true,
            Self::Search | Self::Drawn => false,
        }
    }
}

/// A descent that is over.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Ended {
    pub(super) origin: Origin,
    pub(super) point: Point,
    /// `None`: its start cannot be simulated.
    pub(super) cost: Option<f64>,
    pub(super) reason: String,
    /// Whether the point has been linearised.
    pub(super) settled: bool,
    /// The linearisation there; found again after a resumption.
    #[serde(skip)]
    pub(super) linear: Option<Vec<Linear>>,
}

/// Why a state file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// It could not be read.
    #[error("state file {}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// It is no state file.
    #[error("{}: not the state of a fit", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line, column and reason.
        source: serde_json::Error,
    },
    /// It belongs to something else.
    #[error("the state belongs to another experiment ({got}, this one is {expected}); start the fit afresh")]
    OtherExperiment {
        /// Fingerprint of this experiment.
        expected: String,
        /// Fingerprint in the state.
        got: String,
    },
}

impl Checkpoint {
    /// The state as text, to be read again by [`Self::read`].
    ///
    /// # Errors
    /// What the serialiser says.
    pub fn to_json(&self) -> Result<Vec<u8>, serde_json::Error> {
        serde_json::to_vec(self)
    }

    /// Reads the state at `path`.
    ///
    /// # Errors
    /// [`CheckpointError::Io`] and [`CheckpointError::Malformed`].
    pub fn read(path: &Path) -> Result<Self, CheckpointError> {
        let text = std::fs::read(path).map_err(|source| CheckpointError::Io { path: path.into(), source })?;
        serde_json::from_slice(&text)
            .map_err(|source| CheckpointError::Malformed { path: path.into(), source })
    }
}

/// Fingerprint of everything a fit depends on (FNV-1a over the exact numbers).
pub(super) fn fingerprint(experiment: &Experiment) -> String {
    let hash = format!("{experiment:?}").bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    format!("{hash:016x}")
}

/// [`Fit::stop_reason`](super::Fit::stop_reason) of a fit that its observer stopped.
pub const INTERRUPTED: &str = "interrupted";

/// What a fit says after each generation or iteration.
#[derive(Debug, Clone, Copy)]
pub struct Progress<'a> {
    /// `search` or `descent`.
    pub phase: &'static str,
    /// Parameter vectors tried so far.
    pub evaluations: u64,
    /// Largest number of parameter vectors that will be tried.
    pub max_evaluations: u64,
    /// Runs simulated so far.
    pub rollouts: u64,
    /// Best loss so far \[m2\], over all images; infinite before there is one.
    pub loss_m2: f64,
    /// Whether that is the loss over the thinned images, which a search uses throughout and a descent until near its end.
    pub is_rough: bool,
    /// Whether this start, or the search, has come to its end, or, where more than noise is left, so near that error bars hardly
    /// tell the difference.
    pub is_answer: bool,
    /// What is fitted, shape (P).
    pub parameters: &'a Parameters,
    /// Their present values in the search or the descent, SI, shape (P).
    pub values: &'a [f64],
    /// From here the fit can be resumed.
    pub checkpoint: &'a Checkpoint,
}

/// Whether a fit should go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flow {
    /// Go on.
    Continue,
    /// Finish with the best point so far.
    Stop,
}

/// Watches a fit.
pub trait Observer {
    /// Called after each generation or iteration; returns whether to go on.
    fn progress(&mut self, progress: &Progress<'_>) -> Flow;

    /// Becomes true when nobody waits for more than what the fit has found. Asked for once; looked at before every simulation, by all
    /// threads, so that a fit ends in the midst of an iteration, and while it prepares or finishes, too.
    fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::default()
    }
}

/// Watches nothing, never stops.
impl Observer for () {
    fn progress(&mut self, _: &Progress<'_>) -> Flow {
        Flow::Continue
    }
}
