//! The motion of a calibration: a staircase that is climbed and descended twice, a few wide steps, and small ones to and fro, every move as
//! fast as the channel may. It fits into the 64 segments of the smallest board.

use firmware_protocol::units::{PulseWidthUs, RateUsPerS};

use servo::{PulseProfile, PulseTrack, ServoChannel};

/// Levels of the staircase, and how often it is climbed and descended (chosen).
const STAIRCASE_LEVELS: u16 = 5;
const STAIRCASE_REPEATS: usize = 2;
/// Wide steps to and fro, between the levels with these numbers (chosen).
const WIDE_STEP_LEVELS: [u16; 5] = [3, 1, 3, 1, 2];
/// Small steps about the middle, and their sizes as shares of the travel (chosen): over before a servo reads its pulse twice, they show when
/// it reads.
const SMALL_STEPS: usize = 9;
const SMALL_STEP_TRAVEL_SHARES: [f64; 2] = [0.03, 0.05];
/// Duration of the move to the lowest level, and of each first small move \[µs\] (chosen): slow, as the effect of a pulse is not known yet.
const FIRST_MOVE_DURATION_US: u32 = 1_500_000;
/// Size of the first small moves, as a share of the travel (chosen).
const FIRST_MOVE_TRAVEL_SHARE: f64 = 0.05;
/// Stands are longer by up to this \[µs\] (chosen), in steps of the golden ratio: whatever the servo's refresh period, moves begin in all parts
/// of it.
const STAND_EXTENSION_MAX_US: f64 = 60_000.0;
const GOLDEN_RATIO: f64 = 0.618_033_988_749_894_9;

/// The motion that calibrates `channel`, within its limits of travel and rate; it stands for `stand_s` \[s\] and a little more after each
/// move. A channel that is not marked as calibrated moves a little and slowly first.
pub fn motion(channel: &ServoChannel, stand_s: f64) -> PulseProfile {
    let (min, max) = channel.travel.range().into_inner();
    let at = |share: f64| min + (share * f64::from(max - min)).round() as u16;
    let level = |k: u16| at(f64::from(k) / f64::from(STAIRCASE_LEVELS - 1));
    let middle = level(STAIRCASE_LEVELS / 2);
    let limit = RateUsPerS(channel.travel.max_rate_per_s());
    let mut track = PulseTrack { channel: channel.id, start_pulse: middle, segments: Vec::new() };
    let mut go = |to: u16, least_us: u32| {
        let from = track.segments.last().map_or(middle, |segment| segment.1);
        let shortest = limit.shortest(PulseWidthUs(from), PulseWidthUs(to)).0.max(1);
        track.segments.push((shortest.max(least_us), to));
    };
    if !channel.calibrated {
        for share in [0.5 + FIRST_MOVE_TRAVEL_SHARE, 0.5 - FIRST_MOVE_TRAVEL_SHARE] {
            go(at(share), FIRST_MOVE_DURATION_US);
        }
    }
    go(level(0), FIRST_MOVE_DURATION_US);
    let climb = (1..STAIRCASE_LEVELS).chain((0..STAIRCASE_LEVELS - 1).rev());
    let staircase = std::iter::repeat_n(climb, STAIRCASE_REPEATS).flatten();
    let stand_us = |number: usize| {
        (stand_s * 1e6 + STAND_EXTENSION_MAX_US * f64::fract(number as f64 * GOLDEN_RATIO)) as u32
    };
    go(level(0), stand_us(0));
    // a step that lasts as long as a period is late by the same whenever it begins: not all of them are alike
    let share = |k: usize| SMALL_STEP_TRAVEL_SHARES[k * SMALL_STEP_TRAVEL_SHARES.len() / SMALL_STEPS];
    let side = |k: usize| if k.is_multiple_of(2) { 0.5 } else { -0.5 };
    let small = (0..SMALL_STEPS).map(|k| at(0.5 + side(k) * share(k)));
    for (number, to) in staircase.chain(WIDE_STEP_LEVELS).map(level).chain(small).enumerate() {
        go(to, 0);
        go(to, stand_us(number + 1));
    }
    PulseProfile { tracks: vec![track] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_protocol::units::DurationUs;
    use servo::fixtures::example;

    #[test]
    fn motion_keeps_the_channels_limits_and_fits_into_the_smallest_board() {
        let mut channel = example().channels[0].clone();
        for calibrated in [false, true] {
            channel.calibrated = calibrated;
            let track = &motion(&channel, 0.45).tracks[0];
            assert!(track.segments.len() <= 64, "{}", track.segments.len());
            let limit = RateUsPerS(channel.travel.max_rate_per_s());
            let mut before = PulseWidthUs(track.start_pulse);
            for &(us, pulse) in &track.segments {
                assert!(channel.travel.range().contains(&pulse), "{pulse}");
                assert!(limit.allows(before, PulseWidthUs(pulse), DurationUs(us)), "{pulse} in {us}");
                before = PulseWidthUs(pulse);
            }
            let first = track.segments[0];
            assert_eq!(first.1.abs_diff(track.start_pulse) < 100, !calibrated);
            assert_eq!(first.0, FIRST_MOVE_DURATION_US);
        }
    }
}
