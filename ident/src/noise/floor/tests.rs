use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;

const NOISE_M: f64 = 4e-4;
const CORRELATION: f64 = 0.5;
/// 3000 numbers tell a standard deviation to 2 %, correlated ones a little less well.
const STD_TOLERANCE: f64 = 0.06;
/// Four standard deviations of the estimate.
const CORRELATION_TOLERANCE: f64 = 0.08;

/// Correlated noise on a slow error, with a gap of missing images.
fn run(error_m: f64, seed: u64) -> (Vec<Observation>, Vec<f64>, Vec<f64>) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let time_s: Vec<f64> = (0..300).map(|image| f64::from(image) * 0.01).collect();
    let (mut observations, mut residuals) = (Vec::new(), Vec::new());
    for keypoint in 0..3 {
        for axis in [0, 2] {
            let mut noise: f64 = StandardNormal.sample(&mut random);
            for (instant, t) in time_s.iter().enumerate() {
                let normal: f64 = StandardNormal.sample(&mut random);
                noise = CORRELATION * noise + (1.0 - CORRELATION * CORRELATION).sqrt() * normal;
                if (120..131).contains(&instant) {
                    continue;
                }
                observations.push(Observation { instant, keypoint, axis, measured_m: 0.0, per_m: 1.0 });
                let moving = f64::from(u8::from(*t > 0.3));
                let slow = error_m * (6.0 * t + keypoint as f64).sin() * moving;
                residuals.push(slow + NOISE_M * noise);
            }
        }
    }
    (observations, residuals, time_s)
}

#[test]
fn slow_errors_ten_times_the_noise_leave_the_floor_where_it_is() {
    for (seed, error_m) in [(1, 0.0), (2, 4e-3)] {
        let (observations, residuals, time_s) = run(error_m, seed);
        let seen = Seen {
            id: "run",
            observations: &observations,
            residuals: &residuals,
            time_s: &time_s,
            start_s: 0.3,
            velocities: &[],
            pose_std_m: None,
        };
        let floor = floor(&[seen]);
        assert!((floor.noise_m / NOISE_M - 1.0).abs() < STD_TOLERANCE, "{}", floor.noise_m);
        let correlation = floor.correlation;
        assert!((correlation - CORRELATION).abs() < CORRELATION_TOLERANCE, "{correlation}");
    }
}

/// More splines than images to tell them apart once took whole runs out of the sum, at some correlations.
#[test]
fn every_image_counts_however_few_of_them_show_the_motion() {
    for (still, missing) in (85..=100).flat_map(|still| [0, 3, 6, 9].map(|missing| (still, missing))) {
        let (from, to) = (still + 2, still + 2 + missing);
        let images = (0..100).filter(|image| !(from..to).contains(image));
        let time_s: Vec<f64> = images.map(|image| 0.01 * f64::from(image)).collect();
        let still = time_s.len().min(still as usize);
        let basis = basis(&time_s, still, 0.05);
        let values = DMatrix::from_element(time_s.len(), 1, 1.0);
        let (velocities, unsure) = (DMatrix::zeros(time_s.len(), 1), vec![0.0]);
        let keypoints = vec![0];
        let stretch = Stretch { run: 0, keypoints, time_s, values, velocities, unsure, basis, still };
        for correlation in TRIED_CORRELATIONS {
            let left = stretch.left(correlation, 0.01);
            assert!(left.degrees > 0.0, "{still} {missing} {correlation}");
            assert!(left.squares[0] < 1e-6, "{still} {missing} {correlation}: {:?}", left.squares);
        }
    }
}

#[test]
fn splines_add_up_to_one_everywhere() {
    let time_s: Vec<f64> = (0..80).map(|image| 0.013 * f64::from(image)).collect();
    let basis = basis(&time_s, 10, 0.05);
    for row in basis.row_iter() {
        assert!((row.sum() - 1.0).abs() < 1e-12, "{row}");
    }
}

/// A camera that loses most of its images leaves fewer of them than a spline over the whole motion has functions.
#[test]
fn fewer_images_than_functions_tell_as_many_as_there_are() {
    for still in [0, 2] {
        let time_s: Vec<f64> = (0..4).map(|image| 0.9 * f64::from(image)).collect();
        let basis = basis(&time_s, still, 0.05);
        assert!((1..=4).contains(&basis.ncols()), "{}", basis.ncols());
        assert!(basis.iter().all(|value| value.is_finite()));
    }
}

/// Three keypoints that move as `way` says after a rest (their velocity over time, and what a model gets wrong \[m\]), seen by a camera whose stamps
/// are wrong by `scatter_s`: its scatter and noise as they come out.
fn stamped(scatter_s: f64, way: impl Fn(f64, f64) -> [f64; 2], seed: u64) -> Floor {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let time_s: Vec<f64> = (0..300).map(|image| f64::from(image) * 0.01).collect();
    let (mut observations, mut residuals, mut velocities) = (Vec::new(), Vec::new(), Vec::new());
    for (instant, t) in time_s.iter().enumerate() {
        let late_s = scatter_s * normal();
        for (keypoint, axis) in (0..3).flat_map(|keypoint| [0, 2].map(|axis| (keypoint, axis))) {
            let moving = f64::from(u8::from(*t > 0.3));
            let [velocity, error_m] = way(*t, keypoint as f64 + axis as f64);
            let [velocity, error_m] = [velocity, error_m].map(|x| (1.0 + keypoint as f64) * x * moving);
            observations.push(Observation { instant, keypoint, axis, measured_m: 0.0, per_m: 1.0 });
            velocities.push(velocity);
            residuals.push(error_m + 3e-6 * normal() + late_s * velocity);
        }
    }
    let (start_s, pose_std_m) = (0.3, None);
    let (observations, residuals, velocities) = (&observations[..], &residuals[..], &velocities[..]);
    floor(&[Seen { id: "run", observations, residuals, velocities, time_s: &time_s, start_s, pose_std_m }])
}

/// Swinging, and a model that is wrong by up to `error_m`.
fn swinging(error_m: f64) -> impl Fn(f64, f64) -> [f64; 2] {
    move |t, phase| [0.1 * (5.0 * t + phase).cos(), error_m * (6.0 * t).sin()]
}

#[test]
fn stamps_that_scatter_are_told_from_noise() {
    for (seed, error_m) in [(1, 0.0), (2, 0.0), (3, 3e-4)] {
        let floor = stamped(2e-4, swinging(error_m), seed);
        // 270 images tell it to 4 %
        assert!((floor.stamp_std_s / 2e-4 - 1.0).abs() < 0.15, "{}", floor.stamp_std_s);
        assert!((floor.noise_m / 3e-6 - 1.0).abs() < STD_TOLERANCE, "{}", floor.noise_m);
        // times are known from the images about them as well, which leaves a little
        assert!(floor.correlation.abs() < 0.12, "{}", floor.correlation);
        assert!((floor.stamp_m / (2e-4 * 0.145) - 1.0).abs() < 0.2, "{}", floor.stamp_m);
    }
}

/// A servo that lags by 20 ms where its model has none: each of its strokes begins with an error that no spline of residuals follows. Counted as
/// scatter of the images it once was 7.6 ms, and hid the lag.
#[test]
fn model_that_is_late_at_sharp_turns_is_no_scatter_of_images() {
    for seed in 1..=3 {
        let lag_s = 0.02;
        let strokes = |t: f64, phase: f64| {
            let since_s = t % 0.5;
            let way = if ((t / 0.5) as usize).is_multiple_of(2) { 0.1 } else { -0.1 };
            // the rate as it was seen: it turns round within a lag
            let seen = way * (1.0 - 2.0 * (-since_s / lag_s).exp());
            [seen * phase.cos(), -lag_s * seen * phase.cos()]
        };
        let floor = stamped(2e-4, strokes, seed);
        assert!(floor.stamp_std_s < 4e-4, "{}", floor.stamp_std_s);
        assert!(floor.noise_m < 6e-6, "{}", floor.noise_m);
    }
}

#[test]
fn stamps_that_are_right_do_not_scatter() {
    for seed in 1..=5 {
        let floor = stamped(0.0, swinging(0.0), seed);
        assert_eq!(floor.stamp_std_s, 0.0, "{seed}");
        assert!((floor.noise_m / 3e-6 - 1.0).abs() < STD_TOLERANCE, "{}", floor.noise_m);
    }
}
