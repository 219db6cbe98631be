//! The motions of a calibration: a staircase, small steps to and fro, quick steps. Each fits into the 64 segments of the smallest board.

use firmware_protocol::units::{PulseWidthUs, RateUsPerS};

use crate::servo::{PulseProfile, PulseTrack, ServoChannel};

/// Levels of the staircase, and how often it is climbed and descended.
const LEVELS: u16 = 8;
const CLIMBS: usize = 2;
/// Time from one level to the next and on it \[µs\].
const CLIMB_US: u32 = 100_000;
const STAND_US: u32 = 700_000;
/// Small steps lead to so much beside the middle, and further each time, as a share of the travel; how many, and how long each lasts \[µs\].
const SMALL_SHARE: f64 = 1.0 / 500.0;
const SMALL_STEPS: u16 = 13;
const SMALL_STAND_US: u32 = 550_000;
/// Quick steps between two pulses, as shares of the travel, how many of each, and how long each lasts at least \[µs\].
const QUICK: [(f64, u32, u32); 2] = [(1.0 / 16.0, 21, 250_000), (0.5, 8, 420_000)];
/// Their times sweep this long \[µs\], by the golden ratio: whatever the period of the servo's looks, they fall on all of its parts.
const SWEEP_US: f64 = 60_000.0;
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// One motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// What it is called.
    pub name: &'static str,
    /// What the board plays.
    pub profile: PulseProfile,
}

/// The motions that calibrate `channel`, within its limits of travel and rate.
pub fn motions(channel: &ServoChannel) -> [Motion; 3] {
    let (min, travel) = (channel.min_pulse_us, channel.max_pulse_us - channel.min_pulse_us);
    let at = |share: f64| min + (share * f64::from(travel)).round() as u16;
    let level = |k: u16| at(f64::from(k) / f64::from(LEVELS - 1));

    let mut staircase = Track::from(channel, level(0));
    for _ in 0..CLIMBS {
        for k in (1..LEVELS).chain((0..LEVELS - 1).rev()) {
            staircase.go(level(k), CLIMB_US, STAND_US);
        }
    }

    let mut small = Track::from(channel, at(0.25));
    small.go(at(0.5), CLIMB_US, SMALL_STAND_US);
    for k in 1..=SMALL_STEPS {
        let beside = f64::from(k) * SMALL_SHARE;
        small.go(at(if k % 2 == 1 { 0.5 - beside } else { 0.5 + beside }), 0, SMALL_STAND_US);
    }

    let mut quick = Track::from(channel, at(0.5));
    let mut count = 0.0;
    for (share, steps, stand_us) in QUICK {
        for k in 0..steps {
            let side = if k % 2 == 0 { 0.5 } else { -0.5 };
            let swept = SWEEP_US * f64::fract(count * GOLDEN);
            quick.go(at(0.5 + side * share), 0, stand_us + swept as u32);
            count += 1.0;
        }
    }
    quick.go(at(0.5), CLIMB_US, STAND_US);

    let motion = |name, track: Track<'_>| Motion { name, profile: PulseProfile { tracks: vec![track.track] } };
    [motion("staircase", staircase), motion("small steps", small), motion("quick steps", quick)]
}

struct Track<'a> {
    channel: &'a ServoChannel,
    at: u16,
    track: PulseTrack,
}

impl<'a> Track<'a> {
    fn from(channel: &'a ServoChannel, start_pulse_us: u16) -> Self {
        let stand = (STAND_US, start_pulse_us);
        let track = PulseTrack { channel: channel.id, start_pulse_us, segments: vec![stand] };
        Self { channel, at: start_pulse_us, track }
    }

    /// To `pulse_us` within `move_us`, or as fast as the channel may, and stands there.
    fn go(&mut self, pulse_us: u16, move_us: u32, stand_us: u32) {
        let limit = RateUsPerS(self.channel.max_rate_us_per_s);
        let shortest = limit.shortest(PulseWidthUs(self.at), PulseWidthUs(pulse_us)).0.max(1);
        self.track.segments.extend([(move_us.max(shortest), pulse_us), (stand_us, pulse_us)]);
        self.at = pulse_us;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::config::tests::example;

    #[test]
    fn motions_keep_the_channels_limits_and_fit_into_the_smallest_board() {
        let channel = &example().channels[0];
        for Motion { name, profile } in motions(channel) {
            let track = &profile.tracks[0];
            assert!(track.segments.len() <= 64, "{name}: {}", track.segments.len());
            let mut before = PulseWidthUs(track.start_pulse_us);
            for &(us, pulse) in &track.segments {
                assert!((channel.min_pulse_us..=channel.max_pulse_us).contains(&pulse), "{name}: {pulse}");
                let duration = firmware_protocol::units::DurationUs(us);
                let limit = RateUsPerS(channel.max_rate_us_per_s);
                assert!(limit.allows(before, PulseWidthUs(pulse), duration), "{name}: {pulse} in {us}");
                before = PulseWidthUs(pulse);
            }
        }
    }
}
