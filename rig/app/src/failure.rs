//! Errors by class: input, data, hardware, interruption, or our own fault.

use std::path::PathBuf;

use record::outputs::OutputError;
use run::RunError;
use store::StoreError;
use vision::{SequenceError, VisionError};

/// Exit code of a process that a signal has ended, as shells give it for Ctrl-C.
pub const INTERRUPTED: u8 = 130;

/// The word of `--json` for what hardware has ended.
pub const HARDWARE_FAULT: &str = "hardware-fault";
/// The word of `--json` for what did not begin because the rig is held.
pub const HELD: &str = "held";

/// An error with its class, which decides the exit code and the status in a daemon's journal.
#[derive(Debug)]
pub enum Failure {
    /// Our fault: exit code 1.
    Internal(anyhow::Error),
    /// The input or the config is wrong: exit code 2.
    Input(anyhow::Error),
    /// A servo board, a camera or the recording failed: exit code 3.
    Hardware(anyhow::Error),
    /// The data cannot answer what was asked: exit code 4.
    Data(anyhow::Error),
    /// The rig is held, and nothing may move: exit code 3.
    Held(anyhow::Error),
    /// The user's Ctrl-C or a SIGTERM ended it: exit code [`INTERRUPTED`].
    Interrupted(anyhow::Error),
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        if error.is_input() { Self::input(error) } else { Self::internal(error) }
    }
}

impl Failure {
    /// Exit code where the data cannot answer.
    pub const DATA_EXIT_CODE: u8 = 4;

    /// Classifies an error as wrong input.
    pub fn input(error: impl Into<anyhow::Error>) -> Self {
        Self::Input(error.into())
    }

    /// Classifies what happened while devices were opened or used: a hold, the config's fault, or a device's.
    pub fn of_run(error: RunError) -> Self {
        match error {
            error if error.is_hold() => Self::Held(error.into()),
            error if error.is_input() => Self::input(error),
            error => Self::hardware(error),
        }
    }

    /// Classifies an error as our fault.
    pub fn internal(error: impl Into<anyhow::Error>) -> Self {
        Self::Internal(error.into())
    }

    /// Classifies an error as a hardware fault.
    pub fn hardware(error: impl Into<anyhow::Error>) -> Self {
        Self::Hardware(error.into())
    }

    /// Classifies an error as data that cannot answer.
    pub fn data(error: impl Into<anyhow::Error>) -> Self {
        Self::Data(error.into())
    }

    /// Classifies an error as the data's fault where they lack what was asked for, else as the input's.
    pub fn data_if(lacking: bool, error: impl Into<anyhow::Error>) -> Self {
        if lacking { Self::data(error) } else { Self::input(error) }
    }

    /// The process's exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Internal(_) => 1,
            Self::Input(_) => 2,
            Self::Hardware(_) | Self::Held(_) => 3,
            Self::Data(_) => Self::DATA_EXIT_CODE,
            Self::Interrupted(_) => INTERRUPTED,
        }
    }

    /// The class in a word, as `--json` says it.
    pub fn status(&self) -> &'static str {
        match self {
            Self::Internal(_) => "internal-error",
            Self::Input(_) => "input-error",
            Self::Hardware(_) => HARDWARE_FAULT,
            Self::Data(_) => "data-cannot-answer",
            Self::Held(_) => HELD,
            Self::Interrupted(_) => "interrupted",
        }
    }

    /// Of the class that [`Self::status`] calls `status`; ours for any other word.
    pub fn of(status: &str, error: anyhow::Error) -> Self {
        let classes = [Self::Input, Self::Hardware, Self::Data, Self::Held, Self::Interrupted];
        let place = ["input-error", HARDWARE_FAULT, "data-cannot-answer", HELD, "interrupted"]
            .iter()
            .position(|&class| class == status);
        place.map_or(Self::Internal as fn(_) -> _, |place| classes[place])(error)
    }

    /// What happened.
    pub fn error(&self) -> &anyhow::Error {
        match self {
            Self::Internal(e)
            | Self::Input(e)
            | Self::Hardware(e)
            | Self::Data(e)
            | Self::Held(e)
            | Self::Interrupted(e) => e,
        }
    }

    /// The run it happened in.
    pub fn run(&self) -> Option<&PathBuf> {
        self.error().downcast_ref().map(|InRun(run)| run)
    }
}

/// An output that may not be there was given so.
impl From<OutputError> for Failure {
    fn from(error: OutputError) -> Self {
        Self::input(error)
    }
}

impl From<ident::experiment::ExperimentError> for Failure {
    fn from(error: ident::experiment::ExperimentError) -> Self {
        Self::data_if(error.is_lack_of_data(), error)
    }
}

/// Motion without an end is the data's fault, anything else that cannot be simulated the input's.
impl From<sim::RolloutError> for Failure {
    fn from(error: sim::RolloutError) -> Self {
        use sim::RolloutError::{Diverged, Inexact};
        Self::data_if(matches!(error, Diverged { .. } | Inexact { .. }), error)
    }
}

/// Wrong settings are the input's fault, pictures without a mechanism the data's.
impl From<SequenceError> for Failure {
    fn from(error: SequenceError) -> Self {
        use VisionError::{NoBackground, NoImages};
        let lacking = matches!(error, SequenceError::Vision(NoBackground { .. } | NoImages));
        Self::data_if(lacking, error)
    }
}

impl From<ident::fit::FitError> for Failure {
    fn from(error: ident::fit::FitError) -> Self {
        match error {
            ident::fit::FitError::Interrupted => Self::Interrupted(error.into()),
            error => Self::data_if(error.is_lack_of_data(), error),
        }
    }
}

impl From<ident::diagnose::DiagnoseError> for Failure {
    fn from(error: ident::diagnose::DiagnoseError) -> Self {
        match error {
            ident::diagnose::DiagnoseError::Interrupted => Self::Interrupted(error.into()),
            error => Self::data_if(error.is_lack_of_data(), error),
        }
    }
}

/// Context of an error that happened within a run, whose folder stays: put on with [`anyhow::Error::context`].
#[derive(Debug)]
pub struct InRun(
    /// The run folder.
    pub PathBuf,
);

impl std::fmt::Display for InRun {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "run {}", self.0.display())
    }
}
