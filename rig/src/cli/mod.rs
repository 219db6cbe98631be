//! The command line: one file per verb, each a `clap` argument struct and a function that carries it out.

pub mod calibrate;
pub mod calibrate_servo;
pub mod campaign;
mod choice;
pub mod daemon;
pub mod design;
pub mod diagnose;
pub mod doctor;
pub mod estop;
pub mod experiment;
pub mod export;
pub mod extract;
pub mod firmware;
pub mod fit;
pub mod import;
pub mod jobs;
pub mod jog;
pub mod list;
pub mod mock_board;
pub mod mock_camera;
pub mod new;
pub mod packaging;
pub mod preview;
pub mod progress;
pub mod recalibrate;
pub mod replay;
pub mod run;
pub mod runs;
pub mod simulate;
pub mod status;
pub mod verb;

use std::path::PathBuf;

pub use app::{Failure, InRun};
pub use verb::{Cli, Verb};

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
    /// What was less than it should have been, one sentence each: images that are missing, things that could not be done.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// The process's exit code, 0 unless somebody asked for another.
    #[serde(skip)]
    pub exit_code: u8,
    /// Printed on standard output, unless `--json` asks for one object instead.
    #[serde(skip)]
    pub text: String,
}

impl Outcome {
    /// The process's exit code; as of data that cannot answer, where `strict` lets no warning pass.
    pub fn exit_code(&self, strict: bool) -> u8 {
        if strict && !self.warnings.is_empty() { Failure::DATA_EXIT_CODE } else { self.exit_code }
    }
}
