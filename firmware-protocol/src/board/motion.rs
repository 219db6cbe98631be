//! Straight lines of a pulse over ticks, and the store of a profile's segments.

use crate::command::Segment;
use crate::event::Refusal;
use crate::units::{DurationUs, PulseWidthUs, Ticks};

/// Time between updates of a moving pulse, chosen: finer than any servo's pulse rate.
pub const PULSE_UPDATE_PERIOD: DurationUs = DurationUs(1000);

/// One straight line being followed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    from: PulseWidthUs,
    to: PulseWidthUs,
    start: Ticks,
    duration: DurationUs,
    /// When the pulse is due next.
    pub(super) next: Ticks,
}

impl Line {
    pub(super) fn new(from: PulseWidthUs, to: PulseWidthUs, start: Ticks, duration: DurationUs) -> Self {
        let mut line = Self { from, to, start, duration, next: start };
        line.step(start);
        line
    }

    pub(super) fn end(&self) -> Ticks {
        self.start.plus(self.duration)
    }

    /// The pulse at `now`, to the nearest microsecond, halves away from the start.
    pub(super) fn at(&self, now: Ticks) -> PulseWidthUs {
        let elapsed = now.since(self.start);
        if elapsed <= 0 && self.duration.0 > 0 {
            return self.from;
        }
        if elapsed.unsigned_abs() >= self.duration.0 {
            return self.to;
        }
        let (distance, duration) = (u64::from(self.from.0.abs_diff(self.to.0)), u64::from(self.duration.0));
        let gone = ((distance * u64::from(elapsed.unsigned_abs()) * 2 + duration) / (2 * duration)) as u16;
        PulseWidthUs(if self.to > self.from { self.from.0 + gone } else { self.from.0 - gone })
    }

    /// Sets the next update after the one at `now`.
    pub(super) fn step(&mut self, now: Ticks) {
        let end = self.end();
        let left = end.since(now);
        let still = self.from == self.to;
        self.next =
            if still || left <= PULSE_UPDATE_PERIOD.0 as i32 { end } else { now.plus(PULSE_UPDATE_PERIOD) };
    }
}

/// One channel's part of the uploaded profile: a range of the store.
#[derive(Debug, Clone, Copy)]
pub(super) struct Track {
    pub(super) start_pulse: PulseWidthUs,
    first: usize,
    announced: usize,
    pub(super) received: usize,
    played: usize,
    last_pulse: PulseWidthUs,
    pub(super) duration: DurationUs,
}

impl Track {
    pub(super) fn is_complete(&self) -> bool {
        self.room() == 0
    }

    /// Segments announced and not yet received.
    pub(super) fn room(&self) -> usize {
        self.announced - self.received
    }

    /// The pulse after the segments received so far.
    pub(super) fn last_pulse(&self) -> PulseWidthUs {
        self.last_pulse
    }
}

/// Segments of all tracks, one track after the other.
#[derive(Debug)]
pub(super) struct Store<const N: usize> {
    segments: [Segment; N],
    used: usize,
}

impl<const N: usize> Store<N> {
    pub(super) fn new() -> Self {
        Self { segments: [Segment::default(); N], used: 0 }
    }

    pub(super) fn clear(&mut self) {
        self.used = 0;
    }

    /// Segments announced so far.
    pub(super) fn used(&self) -> usize {
        self.used
    }

    /// Reserves room for a track.
    pub(super) fn track(&mut self, start_pulse: PulseWidthUs, announced: u16) -> Result<Track, Refusal> {
        let (first, announced) = (self.used, usize::from(announced));
        if announced > N - first {
            return Err(Refusal::NoRoom);
        }
        self.used += announced;
        Ok(Track {
            start_pulse,
            first,
            announced,
            received: 0,
            played: 0,
            last_pulse: start_pulse,
            duration: DurationUs(0),
        })
    }

    /// Adds checked segments to a track.
    pub(super) fn extend(&mut self, track: &mut Track, segments: &[Segment]) {
        let from = track.first + track.received;
        self.segments[from..from + segments.len()].copy_from_slice(segments);
        track.received += segments.len();
        for segment in segments {
            track.last_pulse = segment.end_pulse;
            track.duration.0 += segment.duration.0;
        }
    }

    /// The track's next line, begun where and when the last one ended.
    pub(super) fn next_line(&self, track: &mut Track, pulse: PulseWidthUs, start: Ticks) -> Option<Line> {
        if track.played == track.received {
            return None;
        }
        let segment = self.segments[track.first + track.played];
        track.played += 1;
        Some(Line::new(pulse, segment.end_pulse, start, segment.duration))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_meets_both_ends_and_is_symmetric() {
        let up = Line::new(PulseWidthUs(1000), PulseWidthUs(2000), Ticks(u32::MAX - 99), DurationUs(3000));
        let down = Line::new(PulseWidthUs(2000), PulseWidthUs(1000), Ticks(u32::MAX - 99), DurationUs(3000));
        for elapsed in 0..=3000 {
            let now = Ticks(u32::MAX - 99).plus(DurationUs(elapsed));
            assert_eq!(up.at(now).0 + down.at(now).0, 3000);
            assert!((f64::from(up.at(now).0) - 1000.0 - f64::from(elapsed) / 3.0).abs() <= 0.5);
        }
        assert_eq!(up.at(up.end()), PulseWidthUs(2000));
    }
}
