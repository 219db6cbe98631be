//! The command line: one file per verb, each a `clap` argument struct and a function that carries it out.

pub mod daemon;
pub mod design;
pub mod diagnose;
pub mod doctor;
pub mod estop;
pub mod experiment;
pub mod export;
pub mod extract;
pub mod fit;
pub mod jog;
pub mod last_good;
pub mod list;
pub mod mock_board;
pub mod mock_camera;
pub mod progress;
pub mod replay;
pub mod run;
pub mod runs;
pub mod signal;
pub mod simulate;
pub mod status;

use std::path::PathBuf;

/// Why a verb ended badly; decides the exit code.
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
    /// The user's Ctrl-C or a SIGTERM ended it: exit code 130.
    Interrupted(anyhow::Error),
}

impl Failure {
    /// Classifies an error as wrong input.
    pub fn input(error: impl Into<anyhow::Error>) -> Self {
        Self::Input(error.into())
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

    /// The process's exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Internal(_) => 1,
            Self::Input(_) => 2,
            Self::Hardware(_) => 3,
            Self::Data(_) => 4,
            Self::Interrupted(_) => 130,
        }
    }

    /// The class in a word, as `--json` says it.
    pub fn status(&self) -> &'static str {
        match self {
            Self::Internal(_) => "internal-error",
            Self::Input(_) => "input-error",
            Self::Hardware(_) => "hardware-fault",
            Self::Data(_) => "data-cannot-answer",
            Self::Interrupted(_) => "interrupted",
        }
    }

    /// What happened.
    pub fn error(&self) -> &anyhow::Error {
        match self {
            Self::Internal(e) | Self::Input(e) | Self::Hardware(e) | Self::Data(e) | Self::Interrupted(e) => {
                e
            }
        }
    }
}

/// What a verb has to say on success: lines for people, paths for `--json`.
#[derive(Debug, Default, serde::Serialize)]
pub struct Outcome {
    /// What was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub out: Option<PathBuf>,
    /// The run folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<PathBuf>,
    /// The diagnosis's verdict.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<String>,
    /// The process's exit code, 0 unless somebody asked for another.
    #[serde(skip)]
    pub exit_code: u8,
    /// Printed on standard output, unless `--json` asks for one object instead.
    #[serde(skip)]
    pub text: String,
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
