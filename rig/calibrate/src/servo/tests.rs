//! Servos simulated in small steps of time and filmed with noise: the calibration must find their parameters.

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};

use super::*;
use servo::PulseProfile;
use servo::fixtures::example;

/// Parameters of the simulated servo.
#[derive(Debug, Clone, Copy)]
struct Truth {
    zero_us: f64,
    rad_per_us: f64,
    lag_s: f64,
    rate: f64,
    /// Refresh period \[s\]; 0: it follows its pulse continuously.
    period_s: f64,
    /// Its motor is off this near to its target \[rad\].
    dead: f64,
    /// How fast its motor changes its rate \[rad/s²\].
    acceleration: f64,
    /// Half of the play behind it \[rad\].
    play: f64,
    /// From exposure to stamp \[s\].
    latency_s: f64,
    noise_rad: f64,
}

const TRUTH: Truth = Truth {
    zero_us: 1523.0,
    rad_per_us: -1.0 / 590.0,
    lag_s: 0.03,
    rate: 5.0,
    period_s: 0.02,
    dead: 0.01,
    acceleration: f64::INFINITY,
    play: 0.005,
    latency_s: 0.012,
    noise_rad: 5e-4,
};

const STEP_S: f64 = 1e-4;
const IMAGE_S: f64 = 0.01;

fn film(truth: &Truth, profile: &PulseProfile, seed: u64) -> Film {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let corners: Vec<(f64, f64)> =
        profile.tracks[0].corners().map(|(us, pulse)| (1.0 + us as f64 * 1e-6, f64::from(pulse))).collect();
    let command_rad = |t: f64| {
        let next = corners.partition_point(|corner| corner.0 <= t).clamp(1, corners.len() - 1);
        let ((t0, p0), (t1, p1)) = (corners[next - 1], corners[next]);
        let pulse = p0 + (p1 - p0) * ((t - t0) / (t1 - t0)).clamp(0.0, 1.0);
        (pulse - truth.zero_us) * truth.rad_per_us
    };
    let mut film = Film { command: corners.clone(), ..Film::default() };
    let (mut at, mut target, mut rate) = (command_rad(0.0), command_rad(0.0), 0.0_f64);
    let (mut out, mut next_read, mut next_image) = (at, 0.0037, IMAGE_S);
    let end = corners.last().unwrap().0 + 0.3;
    for step in 0..(end / STEP_S) as u64 {
        let t = step as f64 * STEP_S;
        if t >= next_read {
            target = command_rad(t);
            next_read += truth.period_s.max(STEP_S);
        }
        let gap = target - at;
        let drive = gap.signum() * (gap.abs() - truth.dead).max(0.0);
        let wanted = (drive / truth.lag_s).clamp(-truth.rate, truth.rate);
        let change = truth.acceleration * STEP_S;
        rate += (wanted - rate).clamp(-change, change);
        at += STEP_S * rate;
        out = f64::clamp(out, at - truth.play, at + truth.play);
        if t >= next_image {
            let noise: f64 = StandardNormal.sample(&mut random);
            film.time_s.push(t + truth.latency_s);
            film.angle_rad.push(out + truth.noise_rad * noise);
            next_image += IMAGE_S;
        }
    }
    film
}

fn filmed(truth: &Truth) -> Film {
    film(truth, &motion(&example().channels[0], 0.45), 1)
}

fn found(truth: &Truth) -> Calibrated {
    calibrate(&filmed(truth)).unwrap()
}

/// Deviation that is allowed, in standard errors (chosen).
const SIGMAS: f64 = 4.0;

fn close(name: &str, got: Estimate, wanted: f64) {
    let sigmas = (got.value - wanted) / got.std;
    println!("{name}: {:.6} ± {:.6}, {wanted} went in, {sigmas:.1} standard errors", got.value, got.std);
    assert!(sigmas.abs() < SIGMAS, "{name}: {got:?}, {wanted} went in, {sigmas:.1} standard errors");
}

fn table_and_looks_are_right(truth: &Truth, Calibrated { levels, dynamics }: &Calibrated) {
    close("gain", levels.rad_per_us, truth.rad_per_us);
    close("zero", levels.zero_pulse_us, truth.zero_us);
    close("dead band", levels.deadband_rad, truth.dead + truth.play);
    close("refresh", dynamics.refresh_s.unwrap(), truth.period_s);
    assert!(levels.repeatability_rad < 3.0 * truth.noise_rad.max(1e-3), "{}", levels.repeatability_rad);
}

#[test]
fn what_was_put_in_comes_out_of_a_servo_with_every_fault_at_once() {
    for noise_rad in [2e-4, 4e-3] {
        let truth = Truth { noise_rad, ..TRUTH };
        let found = found(&truth);
        println!("noise {noise_rad}: {:?}", found.dynamics);
        table_and_looks_are_right(&truth, &found);
        let dynamics = found.dynamics;
        close("lag", dynamics.lag_s, truth.lag_s);
        close("rate limit", dynamics.rate_limit_rad_per_s.unwrap(), truth.rate);
        close("delay", dynamics.delay_s, truth.latency_s);
        assert!(dynamics.lag_s.std < 0.004, "{:?}", dynamics.lag_s);
    }
}

/// A motor takes time to speed up, which the law does not know: what it is late by in all, and how far it goes, must be right still.
#[test]
fn a_motor_that_has_to_speed_up_is_as_late_in_all_as_it_is() {
    let truth = Truth { acceleration: 300.0, noise_rad: 1e-3, ..TRUTH };
    let found = found(&truth);
    println!("{:?}", found.dynamics);
    table_and_looks_are_right(&truth, &found);
    // a slow ramp is followed late by the lag and the latency, whatever the acceleration
    let Dynamics { lag_s, delay_s, .. } = found.dynamics;
    let late_s = Estimate { value: lag_s.value + delay_s.value, std: lag_s.std.hypot(delay_s.std) };
    close("late", late_s, truth.lag_s + truth.latency_s);
    assert!(late_s.std < 2e-3, "{late_s:?}");
}

#[test]
fn a_quick_servo_that_looks_all_the_time_has_neither_limit_nor_looks() {
    let truth =
        Truth { lag_s: 0.008, rate: 50.0, period_s: 0.0, dead: 0.0, play: 0.0, noise_rad: 1e-3, ..TRUTH };
    let Calibrated { levels, dynamics } = found(&truth);
    assert_eq!((dynamics.rate_limit_rad_per_s, dynamics.refresh_s), (None, None), "{dynamics:?}");
    close("lag", dynamics.lag_s, truth.lag_s);
    close("delay", dynamics.delay_s, truth.latency_s);
    close("dead band", levels.deadband_rad, 0.0);
}

#[test]
fn other_periods_are_told_from_their_halves_and_doubles() {
    for period_s in [0.01, 0.033] {
        let dynamics = found(&Truth { period_s, ..TRUTH }).dynamics;
        close("refresh", dynamics.refresh_s.unwrap(), period_s);
        close("lag", dynamics.lag_s, TRUTH.lag_s);
        // ten milliseconds are over within the shortest move at this servo's greatest rate, and determined less well
        assert!(dynamics.refresh_s.unwrap().std < if period_s < 0.012 { 3e-3 } else { 1e-4 }, "{dynamics:?}");
    }
}

/// What a film shows is the servo and, behind it, the model's own actuator, which gives way under its load.
#[test]
fn what_the_models_own_actuator_does_is_taken_off() {
    let simulated = found(&Truth {
        lag_s: 0.004,
        rate: 50.0,
        period_s: 0.0,
        dead: 0.0,
        play: 0.0,
        rad_per_us: -0.99 / 590.0,
        ..TRUTH
    });
    let mut both = simulated.clone();
    let Dynamics { lag_s, delay_s, .. } = &mut both.dynamics;
    (lag_s.value, delay_s.value) = (0.005, delay_s.value + 0.003);
    let servo = both.without(&simulated);
    assert!((servo.dynamics.lag_s.value - 0.003).abs() < 5e-4, "{:?}", servo.dynamics);
    assert!(
        (servo.dynamics.lag_s.value + servo.dynamics.delay_s.value - 0.004).abs() < 1e-4,
        "{:?}",
        servo.dynamics
    );
}

#[test]
fn a_film_without_a_staircase_is_refused_with_what_is_missing() {
    assert!(matches!(calibrate(&Film::default()), Err(ServoCalibrateError::Levels { rests: 0, .. })));
    let film = filmed(&TRUTH);
    let still = Film { angle_rad: vec![0.1; film.time_s.len()], ..film };
    assert!(matches!(calibrate(&still), Err(ServoCalibrateError::NotMonotone { .. })));
}
