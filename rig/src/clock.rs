//! The host's monotonic clock, and lines that put other clocks on it.

use serde::{Deserialize, Serialize};

/// An instant on the host's CLOCK_MONOTONIC, in nanoseconds: the clock of V4L2 stamps and of every process
/// on this machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct MonotonicNs(pub u64);

impl MonotonicNs {
    /// Now.
    pub fn now() -> Self {
        let t = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        Self(t.tv_sec.unsigned_abs() * 1_000_000_000 + t.tv_nsec.unsigned_abs())
    }

    /// Seconds from `origin` to this instant; negative before it.
    pub fn seconds_since(self, origin: Self) -> f64 {
        self.0.wrapping_sub(origin.0).cast_signed() as f64 * 1e-9
    }

    /// This instant moved by `seconds`, which may be negative.
    pub fn plus_seconds(self, seconds: f64) -> Self {
        Self(self.0.wrapping_add_signed((seconds * 1e9).round() as i64))
    }
}
