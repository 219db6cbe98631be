//! The profile that a board plays, and the receiver of a mock board's pulses.

use serde::{Deserialize, Serialize};

use ground::clock::MonotonicNs;

/// A profile as a board plays it: for each channel, straight lines from pulse to pulse. A pulse is a whole number in the channel's
/// unit: microseconds, or counts of a servo on a bus, which its maker calls pulses too.
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
    /// Pulse at the start \[µs or counts\]; the channel must be there already.
    // Older recordings, from before there were servos on a bus, name it `start_pulse_us`.
    #[serde(alias = "start_pulse_us")]
    pub start_pulse: u16,
    /// Duration \[µs\] and pulse at the end \[µs or counts\] of each segment, in order.
    pub segments: Vec<(u32, u16)>,
}

impl PulseTrack {
    /// How long it takes \[µs\].
    pub fn duration_us(&self) -> u64 {
        self.segments.iter().map(|&(duration, _)| u64::from(duration)).sum()
    }

    /// Its corners: time from the start \[µs\] and pulse \[µs or counts\].
    pub fn corners(&self) -> impl Iterator<Item = (u64, u16)> {
        let mut time = 0;
        std::iter::once((0, self.start_pulse)).chain(self.segments.iter().map(move |&(duration, pulse)| {
            time += u64::from(duration);
            (time, pulse)
        }))
    }

    /// Its corners, and between them where it passes one of the pulses `at`: time from the start \[µs\] and pulse \[µs or counts\].
    pub fn corners_and(&self, at: &[f64]) -> Vec<(f64, f64)> {
        let corners: Vec<(f64, f64)> =
            self.corners().map(|(us, pulse)| (us as f64, f64::from(pulse))).collect();
        let mut all: Vec<(f64, f64)> = corners.first().copied().into_iter().collect();
        for pair in corners.windows(2) {
            let ((t0, p0), (t1, p1)) = (pair[0], pair[1]);
            let passed = at.iter().filter(|pulse| (**pulse - p0) * (**pulse - p1) < 0.0);
            let mut passed: Vec<(f64, f64)> =
                passed.map(|pulse| (t0 + (t1 - t0) * (pulse - p0) / (p1 - p0), *pulse)).collect();
            passed.sort_by(|a, b| a.0.total_cmp(&b.0));
            all.extend(passed);
            all.push((t1, p1));
        }
        all
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

/// Receives a mock board's pulses, the light of its sync LED, and the motion of emulated servos.
pub trait PulseSink: Send {
    /// From `at` on, `channel` puts out `pulse_us`, or nothing while detached.
    fn pulse(&mut self, channel: u8, pulse_us: Option<u16>, at: MonotonicNs);

    /// From `at` on, the sync LED is lit, or dark.
    fn sync_led(&mut self, lit: bool, at: MonotonicNs) {
        let _ = (lit, at);
    }

    /// From `at` on, the servo with the ID `channel` on a bus stands at `position_counts`, or is limp without torque.
    fn position(&mut self, channel: u8, position_counts: Option<f64>, at: MonotonicNs) {
        let _ = (channel, position_counts, at);
    }

    /// Everything before `until` has been reported.
    fn complete(&mut self, until: MonotonicNs) {
        let _ = until;
    }
}
