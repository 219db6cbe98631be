//! What a fit or a diagnosis works on: a model, and runs of the real thing.
//!
//! `experiment.toml` names both; [`Experiment::read`] loads everything it names, so that whatever follows
//! needs no files. A program that has its runs in memory builds an [`Experiment`] itself and calls
//! [`Experiment::check`].

mod adrift;
mod check;
mod error;
mod file;
mod folder;
mod in_the_mean;
mod lost;
mod measured;
mod scale;
mod spikes;

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use sim::{BasePath, Command, Model, State, Trajectory};

pub use crate::config::{DesignConfig, DiagnoseConfig, FitConfig, Loss, Method, Prior};
pub use crate::own_cause::{CauseConfig, CauseError, CauseParameterConfig};
pub(crate) use adrift::{DRIFT_LEAD_S, not_estimated, resting, unknown_rates};
pub use error::{ExperimentError, Place};
pub(crate) use in_the_mean::in_the_mean;
pub use lost::LostMark;
pub use spikes::Spike;

use crate::table::{MeasuredAngles, ServoTable};

/// A model and the runs it should reproduce.
#[derive(Debug, Clone)]
pub struct Experiment {
    /// The model as it stands before the fit; what is not fitted stays as it says.
    pub model: Model,
    /// Keypoint noise \[m\], one standard deviation per coordinate; `None`: estimated.
    pub noise_m: Option<f64>,
    /// What is fitted, and how.
    pub fit: FitConfig,
    /// What may be wrong with the model, and how long it is sought.
    pub diagnose: DiagnoseConfig,
    /// Which runs could be made next.
    pub design: DesignConfig,
    /// The runs, in the order of the file.
    pub runs: Vec<Run>,
}

impl Experiment {
    /// `runs` of a mechanism that `model` describes, `fit` saying what of it is fitted; all else as in a file that states nothing more.
    pub fn new(model: Model, fit: FitConfig, runs: Vec<Run>) -> Self {
        Self {
            model,
            noise_m: None,
            fit,
            diagnose: DiagnoseConfig::default(),
            design: DesignConfig::default(),
            runs,
        }
    }
}

/// One run of the mechanism: what was commanded, and where its keypoints went.
#[derive(Debug, Clone)]
pub struct Run {
    /// Its name, unique in the experiment.
    pub id: String,
    /// How the motion starts.
    pub kind: RunKind,
    /// Whether it is fitted or only scored.
    pub usage: Use,
    /// Measured keypoints, named as sites of the model; gaps where they were set aside.
    pub trajectory: Trajectory,
    /// Marks that stand for a keypoint that was not seen; gaps.
    pub lost: Vec<LostMark>,
    /// Keypoints that were misread in single images.
    pub set_aside: Vec<Spike>,
    /// What the drives were told; a driven run has it.
    pub command: Option<Command>,
    /// In what each column of the commands is, where a table says so ([`crate::table::ServoTable::units`]).
    pub units: Vec<&'static str>,
    /// Parameters that in this run are so many times what they are elsewhere, by name: another gain of a controller, another weight.
    pub times: BTreeMap<String, f64>,
    /// What the servos measured, where they did: taken into the trajectory by [`Experiment::take_in_measured`].
    pub measured: Vec<MeasuredAngles>,
    /// Path of the base; `None`: it did not move.
    pub base: Option<Arc<BasePath>>,
    /// Actuated joints follow the command exactly, see [`Run::follows`].
    pub prescribed: bool,
    /// Whether its body floats freely and is drifting when the servo first moves: set by [`Experiment::set_adrift`].
    pub adrift: bool,
    /// When a drop was let go \[s\]; `None`: detected, then fitted.
    pub release_s: Option<f64>,
    /// How much of the start of a held-out `free` run goes into its initial state \[s\].
    pub init_s: f64,
    /// How often each of its images counts; 1 by default.
    pub weight: f64,
    /// The exact state at the start of motion, where it is known; `None`: estimated.
    pub initial: Option<State>,
}

/// How the motion of a run starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RunKind {
    /// At rest, then let go.
    Drop,
    /// At rest until the servo first moves, but for a body that floats.
    Driven,
    /// Already moving in the first image.
    Free,
}

/// Whether a run is fitted or held out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Use {
    /// Parameters are fitted to it.
    #[default]
    Fit,
    /// Never fitted, only scored.
    Holdout,
}

/// [`Run::init_s`] where the experiment does not state it \[s\] (chosen).
pub const DEFAULT_INIT_S: f64 = 0.1;

impl Run {
    /// A run of `kind` with nothing but its trajectory known, of which keypoints lost, or misread in single images, are set aside; fields are
    /// public, set the others.
    pub fn new(id: impl Into<String>, kind: RunKind, mut trajectory: Trajectory) -> Self {
        let lost = lost::make_gaps(&mut trajectory);
        let set_aside = spikes::set_aside(&mut trajectory);
        Self {
            id: id.into(),
            kind,
            usage: Use::Fit,
            trajectory,
            lost,
            set_aside,
            command: None,
            units: Vec::new(),
            times: BTreeMap::new(),
            measured: Vec::new(),
            base: None,
            prescribed: false,
            adrift: false,
            release_s: None,
            init_s: DEFAULT_INIT_S,
            weight: 1.0,
            initial: None,
        }
    }

    /// Takes what a servo table says.
    pub fn take_servo(&mut self, table: ServoTable) {
        (self.command, self.units, self.measured) = (Some(table.command), table.units, table.measured);
    }

    /// Whether actuated joints follow the command exactly: where `prescribed` says so, and the run is driven, or is `free` and has a command. In a
    /// drop the servo is off.
    pub fn follows(&self) -> bool {
        self.prescribed
            && match self.kind {
                RunKind::Drop => false,
                RunKind::Driven => true,
                RunKind::Free => self.command.is_some(),
            }
    }

    /// When a servo or the base first moves \[s\]; `None` when neither ever does.
    pub fn first_motion_s(&self) -> Option<f64> {
        // the mean of fine steps is on its way before the first of them
        let servo = self.command.as_ref().and_then(|command| in_the_mean(command).first_motion_s());
        let base = self.base.as_ref().and_then(|base| base.first_motion_s());
        servo.into_iter().chain(base).reduce(f64::min)
    }
}

#[cfg(test)]
mod tests;
