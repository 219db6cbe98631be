//! Engines: what sees to it that `rig task` is run for each task of a study.
//!
//! An adapter submits, looks and cancels, and does nothing else: placement, lost nodes and queues are the engine's. One more engine is one more
//! file, and one line of [`ENGINES`].

mod hyperqueue;
mod local;
mod slurm;

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, anyhow};
use app::Failure;
use ground::names::nearest;

use crate::folder::{Job, Study, StudyFolder};

/// All engines, by name.
pub static ENGINES: [&dyn Engine; 3] = [&local::Local, &slurm::Slurm, &hyperqueue::HyperQueue];

/// An engine.
pub trait Engine: Sync {
    /// Its name, as `--on` takes it.
    fn name(&self) -> &'static str;
    /// Hands it tasks; gives what it calls them.
    ///
    /// # Errors
    /// [`Failure::Input`] where it is not there or does not take them, with what it says.
    fn submit(&self, batch: &Batch<'_>) -> Result<String, Failure>;
    /// What it still has of the job `id`.
    ///
    /// # Errors
    /// [`Failure::Input`] where it does not answer.
    fn look(&self, folder: &StudyFolder, id: &str) -> Result<AtWork, Failure>;
    /// Cancels the job `id`.
    ///
    /// # Errors
    /// As [`Self::look`].
    fn cancel(&self, folder: &StudyFolder, id: &str) -> Result<(), Failure>;
}

/// What an engine still has of a job: tasks, or parts of several tasks each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AtWork {
    /// Waiting for a place.
    pub waiting: usize,
    /// Under way.
    pub running: usize,
}

impl AtWork {
    /// Whether there is anything left to wait for.
    pub fn is_over(self) -> bool {
        self == Self::default()
    }
}

/// Tasks for an engine.
#[derive(Debug)]
pub struct Batch<'a> {
    /// The study's folder.
    pub folder: &'a StudyFolder,
    /// The study.
    pub study: &'a Study,
    /// Absolute path of a list of the tasks' files, one a line.
    pub list: &'a Path,
    /// How many there are.
    pub count: usize,
    /// Which batch of the study it is, from 1.
    pub number: usize,
    /// How long tasks of this study took, where some were done: in the middle, and the longest \[s\].
    pub measured_s: Option<[f64; 2]>,
    /// Tasks at once, where the engine is this machine.
    pub workers: NonZeroUsize,
    /// This program.
    pub program: PathBuf,
}

/// The longest limit that measured tasks get is their longest time times this (chosen: another node may be slower), and no less than
/// [`LEAST_LIMIT_S`].
const LIMIT_TO_LONGEST: f64 = 5.0;
/// Chosen: what a busy disk may cost.
const LEAST_LIMIT_S: f64 = 60.0;

impl Batch<'_> {
    /// Longest time that a task of it may take \[s\].
    fn limit_s(&self) -> f64 {
        let measured = self.measured_s.map(|[_, longest]| (LIMIT_TO_LONGEST * longest).max(LEAST_LIMIT_S));
        measured.map_or(self.study.limit_s, |limit_s| limit_s.min(self.study.limit_s))
    }

    /// How long a task usually takes \[s\], where that is known.
    fn usual_s(&self) -> Option<f64> {
        self.measured_s.map(|[usual, _]| usual).or(self.study.typical_s)
    }

    /// What an engine calls it.
    fn title(&self) -> String {
        let stem = self.study.study.file_stem().unwrap_or_default().to_string_lossy();
        format!("rig-{stem}-{}", self.number)
    }
}

/// The engine called `name`.
///
/// # Errors
/// [`Failure::Input`] where there is none.
pub fn by_name(name: &str) -> Result<&'static dyn Engine, Failure> {
    let names = || ENGINES.iter().map(|engine| engine.name());
    let found = ENGINES.iter().find(|engine| engine.name() == name);
    found.copied().ok_or_else(|| {
        let meant =
            nearest(name, names()).map_or_else(String::new, |name| format!("; did you mean `{name}`?"));
        Failure::Input(anyhow!(
            "no engine is called `{name}`; there are {}{meant}",
            names().collect::<Vec<_>>().join(", ")
        ))
    })
}

/// The engine of `job`.
///
/// # Errors
/// As [`by_name`].
pub fn of_job(job: &Job) -> Result<&'static dyn Engine, Failure> {
    by_name(&job.engine)
}

/// Runs an engine's command; gives what it printed.
fn told(command: &mut Command, install: &str) -> Result<String, Failure> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = match command.output() {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return Err(Failure::Input(anyhow!("`{name}` is not there: {install}")));
        }
        output => output.with_context(|| format!("running {name}")).map_err(Failure::Input)?,
    };
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned());
    }
    // some say it on one, some on the other
    let said = [output.stderr, output.stdout].map(|said| String::from_utf8_lossy(&said).trim().to_owned());
    Err(Failure::Input(anyhow!("{name} refuses: {}", said.join("\n").trim())))
}
