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
mod help;
pub mod import;
pub mod job;
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
pub mod study;
pub mod task;
pub mod verb;

use std::io::Write as _;
use std::path::PathBuf;

use store::job::JobResult;

pub use app::{Failure, InRun};
pub use verb::{Cli, Verb};

/// What a verb has to say on success: lines for people, paths for `--json`.
#[derive(Debug, Default)]
pub struct Outcome {
    /// What was written.
    pub out: Option<PathBuf>,
    /// The run folder.
    pub run: Option<PathBuf>,
    /// The diagnosis's verdict.
    pub verdict: Option<String>,
    /// What was less than it should have been, one sentence each: images that are missing, things that could not be done.
    pub warnings: Vec<String>,
    /// The process's exit code, 0 unless somebody asked for another.
    pub exit_code: u8,
    /// Printed on standard output, unless `--json` asks for one object instead.
    pub text: String,
}

impl Outcome {
    /// The process's exit code; as of data that cannot answer, where `strict` lets no warning pass.
    pub fn exit_code(&self, strict: bool) -> u8 {
        if strict && !self.warnings.is_empty() { Failure::DATA_EXIT_CODE } else { self.exit_code }
    }
}

/// Writes a line to standard error. Where that takes nothing, as a file on a full disk, nobody is told and everything goes on: a panic over it
/// once ended runs while their servo moved.
pub fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// What `--json` prints of a verb that ended so.
pub fn result(ended: &Result<Outcome, Failure>) -> JobResult {
    let text = |path: &PathBuf| path.display().to_string();
    match ended {
        Ok(outcome) => JobResult {
            status: Some("done".into()),
            run: outcome.run.as_ref().map(text),
            out: outcome.out.as_ref().map(text),
            verdict: outcome.verdict.clone(),
            warnings: outcome.warnings.clone(),
            error: None,
        },
        Err(failure) => JobResult {
            status: Some(failure.status().into()),
            run: failure.error().downcast_ref().map(|InRun(run)| text(run)),
            error: Some(format!("{:#}", failure.error())),
            ..JobResult::default()
        },
    }
}
