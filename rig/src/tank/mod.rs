//! The simulated tank behind mock board and mock camera: the board's pulses move it, the camera looks at it.

pub mod render;

use crate::clock::MonotonicNs;

/// Where a mock board's pulses go.
pub trait PulseSink: Send {
    /// From `at` on, `channel` puts out `pulse_us`, or nothing while detached.
    fn pulse(&mut self, channel: u8, pulse_us: Option<u16>, at: MonotonicNs);
}
