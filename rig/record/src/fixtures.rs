//! A start and a stop of a run for tests, which change the fields that they need.

use super::folder::file;
use super::start_stop::{ClockPair, RunKind, Start, Status, Stop};
use ground::clock::MonotonicNs;
use servo::StopOutcome;

/// A clock that says `monotonic_ns`, in the morning of 2026-11-20.
pub fn at(monotonic_ns: u64) -> ClockPair {
    ClockPair { monotonic_ns: MonotonicNs(monotonic_ns), utc: "2026-11-20T10:15:03.25Z".into() }
}

/// A driven run called `id`, without devices.
///
/// # Panics
/// Where `id` is none.
pub fn start(id: &str) -> Start {
    Start {
        id: id.parse().unwrap_or_else(|error| panic!("{error}")),
        number: 0,
        kind: RunKind::Driven,
        model: file::MODEL_START.into(),
        prescribed: false,
        clock: at(5),
        version: "0.1.0".into(),
        board: None,
        camera: None,
        config: String::new(),
        details: Default::default(),
    }
}

/// A run that went as planned, without an image.
pub fn stop() -> Stop {
    Stop {
        status: Status::Success,
        reason: None,
        clock: at(3_500_000_005),
        servo: StopOutcome::NotNeeded,
        images: 0,
        images_lost: 0,
        images_damaged: 0,
        images_repeated: 0,
        images_stale: 0,
        messages_dropped: 0,
        learn_from: None,
        recovered: None,
    }
}
