//! Run folders: what is known before a run, what happens in it, and how it ended.
//!
//! A run writes `start.json` first, then events to [`journal`] and images, commands and telemetry to
//! [`recording`] as they come, and `stop.json` last. Nothing needs a footer to be read: a run that lacks
//! `stop.json` was cut short, and all that had been written still counts ([`folder`], [`reader`]).

#![allow(clippy::disallowed_methods, reason = "a run's own files, and the handles by which all others write")]

pub mod below;
pub mod files;
pub mod filter;
#[doc(hidden)]
pub mod fixtures;
pub mod folder;
pub mod frames;
pub mod journal;
pub mod losses;
pub mod order;
pub mod outputs;
mod pieces;
pub mod reader;
pub mod recording;
pub mod repair;
pub mod retention;
pub mod run_id;
pub mod simulated;
pub mod stage;
pub mod start_stop;
pub mod sums;
pub mod timing;
pub mod verify;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use ground::clock::MonotonicNs;
use servo::PulseProfile;
use servo::StopOutcome;

/// What went wrong with a run's files.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The system refused an operation on a file.
    #[error("{action} {}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// On which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file was named in place of a run's folder.
    #[error("{} is a file, and a run's folder is wanted: for its recording, report or results, the folder they are in", path.display())]
    NoFolder {
        /// The file.
        path: PathBuf,
    },
    /// The recording's writer refused.
    #[error("writing {}", path.display())]
    Write {
        /// The recording.
        path: PathBuf,
        /// Why.
        source: mcap::McapError,
    },
    /// The disk is nearly full; stopped while the journal and `stop.json` still fit.
    #[error(
        "recording {}: {free_mib} MiB left on the disk, {reserve_mib} MiB are kept free; delete old runs or use another --runs-dir",
        path.display()
    )]
    DiskFull {
        /// The recording.
        path: PathBuf,
        /// What is left.
        free_mib: u64,
        /// What must stay free.
        reserve_mib: u64,
    },
    /// The disk takes data more slowly than they come.
    #[error(
        "recording {}: queue of {queue_mib} MiB full, {dropped} messages lost; use a faster disk (`rig doctor` measures it), fewer or smaller images",
        path.display()
    )]
    Overflow {
        /// The recording.
        path: PathBuf,
        /// The queue's size.
        queue_mib: usize,
        /// Messages lost so far.
        dropped: u64,
    },
    /// The recording has already ended, with an error returned before.
    #[error("recording {}: already ended", path.display())]
    Ended {
        /// The recording.
        path: PathBuf,
    },
    /// The thread that writes the recording panicked.
    #[error("our fault: the recording's thread panicked, {} ends there", path.display())]
    Panicked {
        /// The recording.
        path: PathBuf,
    },
    /// A file does not hold what it should.
    #[error("{}: {why}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do where something can be done.
        why: String,
    },
}

impl RecordError {
    /// Makes the error of an operation on `path`, for `map_err`.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { action, path: path.into(), source }
    }

    /// Makes the error of a file whose content is damaged.
    pub fn damaged(path: &Path, why: impl ToString) -> Self {
        Self::Damaged { path: path.into(), why: why.to_string() }
    }
}

/// A command of the host to the board, as recorded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "command", rename_all = "kebab-case")]
pub enum ServoCommand {
    /// A profile was uploaded and armed.
    Arm {
        /// When it was to start.
        start: MonotonicNs,
        /// The profile.
        profile: PulseProfile,
    },
    /// One channel was moved.
    Jog {
        /// Channel number.
        channel: u8,
        /// Pulse at the end \[µs\].
        pulse_us: u16,
        /// Duration of the move \[s\].
        duration_s: f64,
    },
    /// The board was stopped.
    Stop {
        /// The outcome of the stop.
        outcome: StopOutcome,
    },
}
