use std::path::Path;

use super::*;
use crate::fixtures::example;
use proptest::prelude::*;

const PAPER_PROFILE_TOML: &str = "amplitude_rad = 0.3\nccw_s = 1.0\ncw_s = 0.5\ncycles = 3\n";

fn config(text: &str) -> ProfileConfig {
    ground::strict::parse(text, Path::new("rig.toml")).unwrap()
}

fn profile(text: &str) -> Profile {
    Profile::new(&config(text)).unwrap()
}

/// The stroke of the MuJoCo bench, written independently of `Profile`: 0 at t = 0, rising.
fn bench_stroke(t: f64, amplitude: f64, ccw_s: f64, cw_s: f64) -> f64 {
    let p = (t + ccw_s / 2.0) % (ccw_s + cw_s);
    if p < ccw_s {
        -amplitude + 2.0 * amplitude * p / ccw_s
    } else {
        amplitude - 2.0 * amplitude * (p - ccw_s) / cw_s
    }
}

#[test]
fn angle_is_the_benchs_stroke_and_rests_at_the_centre_around_it() {
    let profile = profile(PAPER_PROFILE_TOML);
    for k in 0..4500 {
        let t = f64::from(k) * 1e-3;
        let difference = profile.angle_rad(t) - bench_stroke(t, 0.3, 1.0, 0.5);
        assert!(difference.abs() < 1e-12, "{difference} at {t}");
    }
    assert_eq!(profile.duration_s(), 4.5);
    assert_eq!([profile.angle_rad(-1.0), profile.angle_rad(4.5), profile.angle_rad(9.0)], [0.0; 3]);
}

#[test]
fn counter_clockwise_stroke_lasts_exactly_twice_the_other_whatever_the_decimals() {
    for cw_s in [0.5, 1.0 / 3.0, 0.123_456_7, 2.0 / 7.0] {
        let text = format!("amplitude_rad = 0.1\nccw_s = {}\ncw_s = {cw_s}\ncycles = 100", 2.0 * cw_s);
        let track = &profile(&text).pulses(&example()).unwrap().tracks[0];
        let (mut up, mut down, mut before) = (0u64, 0u64, track.start_pulse);
        for &(duration, pulse) in &track.segments {
            *(if pulse > before { &mut up } else { &mut down }) += u64::from(duration);
            before = pulse;
        }
        assert_eq!(up, 2 * down, "cw_s = {cw_s}");
        assert_eq!(up + down, track.duration_us());
    }
}

#[test]
fn commanded_angles_are_those_of_the_rounded_pulses() {
    let servo = example();
    for mirrored in [false, true] {
        let profile = profile(&format!("{PAPER_PROFILE_TOML}centre_rad = 0.1\nmirrored = {mirrored}\n"));
        let pulses = profile.pulses(&servo).unwrap();
        let command = pulses.command(&servo, mirrored, 2.0).unwrap();
        assert_eq!(command.actuators, ["servo"]);
        assert_eq!(command.first_motion_s(), Some(2.0));
        // Half a microsecond of rounding at this gain.
        let channel = &servo.channels[0];
        let rounding_rad = 0.5 / (channel.setpoint(1.0, false) - channel.setpoint(0.0, false));
        for k in 0..4500 {
            let t = f64::from(k) * 1e-3;
            let difference = command.at(0, 2.0 + t) - profile.angle_rad(t);
            assert!(difference.abs() <= rounding_rad + 1e-9, "{difference} at {t}");
        }
        let rising = pulses.tracks[0].segments[0].1 > pulses.tracks[0].start_pulse;
        assert_eq!(rising, !mirrored);
    }
}

#[test]
fn limits_are_named_with_what_to_change() {
    let refuse = |text: &str| profile(text).pulses(&example()).unwrap_err().to_string();
    let wide = refuse("amplitude_rad = 1.0\nccw_s = 2\ncw_s = 1\ncycles = 1");
    assert_eq!(
        wide,
        "profile on channel `base` wants 1.0000 rad, a pulse of 2137 µs, outside its limits 900 to 2100 µs; \
         reduce amplitude_rad or centre_rad, or widen the channel's limits if the mechanism allows"
    );
    let fast = refuse("amplitude_rad = 0.8\nccw_s = 0.4\ncw_s = 0.2\ncycles = 1");
    assert_eq!(
        fast,
        "profile on channel `base` wants 5090 µs/s, above its limit max_rate_us_per_s = 4000; reduce \
         amplitude_rad or lengthen ccw_s"
            .replace("ccw_s", "cw_s")
    );
    let bus = crate::fixtures::parse(crate::fixtures::BUS).unwrap();
    let refuse_bus = |text: &str| profile(text).pulses(&bus).unwrap_err().to_string();
    let wide = refuse_bus("amplitude_rad = 1.2\nccw_s = 4\ncw_s = 2\ncycles = 1");
    assert!(wide.contains("a position of 2830 counts, outside its limits 1400 to 2700 counts"), "{wide}");
    let fast = refuse_bus("amplitude_rad = 0.9\nccw_s = 0.4\ncw_s = 0.2\ncycles = 1");
    assert!(fast.contains("above its limit max_rate_rad_per_s of 3911 counts/s"), "{fast}");
    assert!(refuse(&format!("{PAPER_PROFILE_TOML}actuators = [\"arm\"]")).contains("actuator = \"arm\""));
    assert_eq!(Profile::new(&config(&PAPER_PROFILE_TOML.replace("= 3", "= 0"))), Err(ProfileError::Empty));
    let long = Profile::new(&config(&PAPER_PROFILE_TOML.replace("= 3", "= 2000"))).unwrap_err().to_string();
    assert_eq!(long, "profile lasts 3000 s, longer than 1800 s; reduce cycles or the stroke times");
}

#[test]
fn soft_start_grows_evenly_and_keeps_the_timing() {
    let profile = profile(&format!("{PAPER_PROFILE_TOML}soft_start_cycles = 2\n"));
    let tops: Vec<f64> = (0..5).map(|k| profile.angle_rad(0.5 + 1.5 * f64::from(k))).collect();
    for (top, wanted) in tops.iter().zip([0.1, 0.2, 0.3, 0.3, 0.3]) {
        assert!((top - wanted).abs() < 1e-12, "{tops:?}");
    }
    assert_eq!(profile.duration_s(), 7.5);
}

#[test]
fn cautious_motion_is_a_tenth_of_the_size_and_speed() {
    let small = Profile::new(&config(PAPER_PROFILE_TOML).cautious()).unwrap();
    assert_eq!(small.duration_s(), 1.5);
    assert!((small.angle_rad(0.5) - 0.03).abs() < 1e-12);
}

#[test]
fn nonsense_numbers_are_refused_with_their_line() {
    for bad in ["amplitude_rad = nan", "amplitude_rad = -1", "ccw_s = 0", "cw_s = inf", "cycles = 1.5"] {
        let key = bad.split(' ').next().unwrap();
        let text: String = PAPER_PROFILE_TOML
            .lines()
            .map(|l| if l.starts_with(key) { format!("{bad}\n") } else { format!("{l}\n") })
            .collect();
        let error = ground::strict::parse::<ProfileConfig>(&text, Path::new("rig.toml")).unwrap_err();
        assert!(error.to_string().contains("line ") && error.to_string().contains('^'), "{error}");
    }
}

proptest! {
    #[test]
    fn profiles_that_pass_the_hosts_limits_add_up_exactly_and_stay_within(
        amplitude in 0.001..1.0f64, ccw in 0.05..3.0f64, cw in 0.05..3.0f64, cycles in 1..40u32, soft in 0..5u32,
    ) {
        let text = format!(
            "amplitude_rad = {amplitude}\nccw_s = {ccw}\ncw_s = {cw}\ncycles = {cycles}\nsoft_start_cycles = {soft}"
        );
        let profile = profile(&text);
        if let Ok(pulses) = profile.pulses(&example()) {
            let track = &pulses.tracks[0];
            prop_assert_eq!(track.duration_us(), profile.duration_us());
            prop_assert_eq!(track.segments.last().unwrap().1, track.start_pulse);
            let mut before = PulseWidthUs(track.start_pulse);
            for &(duration, pulse) in &track.segments {
                prop_assert!((900..=2100).contains(&pulse));
                prop_assert!(RateUsPerS(4000).allows(before, PulseWidthUs(pulse), DurationUs(duration)));
                before = PulseWidthUs(pulse);
            }
        }
    }
}
