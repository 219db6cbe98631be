//! What the program does with all of it: one experiment from config to report, runs put together, fits and diagnoses into
//! folders, the last good fit, jobs handed to a daemon.
//!
//! It tells a [`Watcher`] how it goes and answers with results; arguments and printing are the command line's.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

pub mod announce;
pub mod bluesky;
pub mod calibrate;
pub mod campaign;
pub mod compose;
pub mod design;
pub mod diagnose;
pub mod doctor;
pub mod drift;
pub mod exchange;
pub mod experiment;
mod failure;
pub mod firmware;
pub mod fit;
pub mod foxglove;
pub mod hand_in;
mod interrupt;
pub mod last_good;
pub mod latency;
pub mod look;
pub mod recover;
mod results;
pub mod retention;
pub mod servo;
pub mod stop;

pub use failure::{Failure, HARDWARE_FAULT, HELD, INTERRUPTED, InRun};
pub use interrupt::{Interrupt, interruptible};

use std::num::NonZeroUsize;
use std::path::Path;

use anyhow::Context as _;
use sim::Model;

use analysis::Progress;
use ground::urgency::Urgency;

/// Receives messages about what the program does; the command line shows them.
pub trait Watcher: Progress + Send {
    /// Shows what is being done now, in place of the last status.
    fn status(&mut self, text: String);
    /// Something happened: shown on a terminal and in the log of a job.
    fn event(&mut self, text: &str);
    /// Somebody must know of this or act on it: shown wherever the output goes.
    fn alert(&mut self, text: &str);
    /// Removes the status.
    fn clear(&mut self);
}

/// The folder that relative paths in the config at `path` start from.
pub fn base(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The model at `path`.
///
/// # Errors
/// [`Failure::Input`].
pub fn read_model(path: &Path) -> Result<Model, Failure> {
    Model::read_mjcf(path)
        .with_context(|| format!("reading model {}", path.display()))
        .map_err(Failure::Input)
}

/// Worker threads asked for, or one for each core.
pub fn threads(asked: Option<NonZeroUsize>) -> usize {
    asked.or_else(|| std::thread::available_parallelism().ok()).map_or(1, NonZeroUsize::get)
}

/// Carries out `work` on so many threads; in a job of a daemon, whose other rigs may be moving, behind what moves and films.
///
/// # Errors
/// What `work` gives; [`Failure::Internal`] where the system has no threads to give.
pub fn on_threads<T: Send>(
    threads: usize,
    work: impl FnOnce() -> Result<T, Failure> + Send,
) -> Result<T, Failure> {
    let in_job = hand_in::is_job();
    let begin = move |_| {
        if in_job {
            Urgency::Computing.take();
        }
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).start_handler(begin).build();
    pool.map_err(Failure::internal)?.install(work)
}
