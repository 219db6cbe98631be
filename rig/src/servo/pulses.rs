//! What a board plays, and where a mock one's pulses go.

use serde::{Deserialize, Serialize};

use crate::clock::MonotonicNs;

/// What a board plays: for each channel, straight lines from pulse to pulse.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PulseProfile {
    /// One track per driven channel.
    pub tracks: Vec<PulseTrack>,
}

/// One channel's part of a profile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PulseTrack {
    /// Channel number.
    pub channel: u8,
    /// Pulse at the start \[µs\]; the channel must be there already.
    pub start_pulse_us: u16,
    /// Duration \[µs\] and pulse at the end \[µs\] of each segment, in order.
    pub segments: Vec<(u32, u16)>,
}

impl PulseTrack {
    /// How long it takes \[µs\].
    pub fn duration_us(&self) -> u64 {
        self.segments.iter().map(|&(duration, _)| u64::from(duration)).sum()
    }

    /// Its corners: time from the start \[µs\] and pulse \[µs\].
    pub fn corners(&self) -> impl Iterator<Item = (u64, u16)> {
        let mut time = 0;
        std::iter::once((0, self.start_pulse_us)).chain(self.segments.iter().map(
            move |&(duration, pulse)| {
                time += u64::from(duration);
                (time, pulse)
            },
        ))
    }
}

impl PulseProfile {
    /// How long it takes \[µs\].
    pub fn duration_us(&self) -> u64 {
        self.tracks.iter().map(PulseTrack::duration_us).max().unwrap_or(0)
    }

    /// This profile and then `next`, which must begin where this one ends: on the same channels, at the same pulses.
    pub fn then(mut self, next: &Self) -> Self {
        for track in &mut self.tracks {
            if let Some(more) = next.tracks.iter().find(|more| more.channel == track.channel) {
                track.segments.extend(&more.segments);
            }
        }
        self
    }
}

/// Where a mock board's pulses go, and its sync LED's light.
pub trait PulseSink: Send {
    /// From `at` on, `channel` puts out `pulse_us`, or nothing while detached.
    fn pulse(&mut self, channel: u8, pulse_us: Option<u16>, at: MonotonicNs);

    /// From `at` on, the sync LED is lit, or dark.
    fn sync_led(&mut self, lit: bool, at: MonotonicNs) {
        let _ = (lit, at);
    }

    /// All of it before `until` is known.
    fn complete(&mut self, until: MonotonicNs) {
        let _ = until;
    }
}
