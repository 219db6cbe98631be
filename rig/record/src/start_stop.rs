//! The contents of `start.json` and `stop.json`: all that was known before a run, and how it ended.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

pub use ident::experiment::RunKind;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::run_id::RunId;
use camera::CameraInfo;
use ground::clock::MonotonicNs;
use servo::{BoardInfo, StopOutcome};

/// The same instant on both clocks, so that a later jump of the wall clock is visible and does no harm.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClockPair {
    /// CLOCK_MONOTONIC.
    pub monotonic_ns: MonotonicNs,
    /// Wall clock, RFC 3339.
    pub utc: String,
}

impl ClockPair {
    /// Now.
    pub fn now() -> Self {
        Self { monotonic_ns: MonotonicNs::now(), utc: jiff::Timestamp::now().to_string() }
    }
}

/// `start.json`: all that was known before the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// The run's name.
    pub id: RunId,
    /// Its place among the runs of its folder, from 1: given by [`super::folder::RunFolder::create`]. 0 for runs from before 2026-11-27.
    #[serde(default)]
    pub number: u64,
    /// Driven, or let go by hand.
    pub kind: RunKind,
    /// The model's file in this folder.
    pub model: String,
    /// In driven runs the actuated joint follows `servo.csv` exactly.
    pub prescribed: bool,
    /// The run's time origin.
    pub clock: ClockPair,
    /// Version of this program.
    pub version: String,
    /// The servo board, where one takes part.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub board: Option<BoardInfo>,
    /// The camera, as set up.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub camera: Option<CameraInfo>,
    /// The whole configuration as TOML text.
    pub config: String,
    /// What else is known: calibration, water, weights.
    #[serde(flatten)]
    pub details: BTreeMap<String, Value>,
}

impl Start {
    /// Of [`Start::details`]: the config that the run was made with.
    pub const CONFIG_PATH: &str = "config_path";

    /// The config that the run was made with, where it is still there.
    pub fn config_path(&self) -> Option<&Path> {
        let path = Path::new(self.details.get(Self::CONFIG_PATH)?.as_str()?);
        path.is_file().then_some(path)
    }
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// As planned.
    Success,
    /// The user, or a signal, ended it.
    Abort,
    /// A fault ended it.
    Fail,
}

/// `stop.json`: how the run ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stop {
    /// Success, abort or failure.
    pub status: Status,
    /// Why, unless it went as planned.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub reason: Option<String>,
    /// When it ended.
    pub clock: ClockPair,
    /// How the servo was stopped.
    pub servo: StopOutcome,
    /// Images received.
    pub images: u64,
    /// Images that the camera counted and never handed over.
    pub images_lost: u64,
    /// Images received that the driver marked as damaged or that were not whole; none is looked at.
    #[serde(default)]
    pub images_damaged: u64,
    /// Images received whose bytes are those of the one before; several in a row while something moves end a run.
    #[serde(default)]
    pub images_repeated: u64,
    /// Images received whose stamp is not later than all before; none is looked at.
    #[serde(default)]
    pub images_stale: u64,
    /// Messages that did not fit into the recording's queue.
    pub messages_dropped: u64,
    /// Which of the images received, counted from 0, the empty tank was learned from while filming; absent where the motion
    /// was too short for that.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub learn_from: Option<Range<u64>>,
    /// Present where this file was written afterwards, for a run that had ended without one.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub recovered: Option<Recovered>,
}

/// How a run that had ended without a `stop.json` was recovered.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Recovered {
    /// When it was recovered, RFC 3339.
    pub at_utc: String,
    /// Bytes of the recording that cannot be read; they stay in it.
    pub unreadable_bytes: u64,
}
