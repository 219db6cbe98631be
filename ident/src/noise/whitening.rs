//! Whitens residuals: takes out of each what the ones before it predict.
//!
//! An error of a coordinate has two parts. Noise is a first-order autoregression in time: what is correlated by rho from one
//! image to the next is by rho^d over d times the usual time between images. What pictures get wrong with the pose
//! ([`PoseErrors`]) is one in the way that the mechanism has gone: it stays while the mechanism rests. A Kalman filter knows what
//! all errors before say of the next one; what is left, over the root of its variance, is white. That is a linear map, and
//! the same map on derivatives makes least squares the maximum of the likelihood. Times of images scatter ([`super::stamps`]): within an
//! image each coordinate says something of its time, and so of the next one; what that leaves unsure of each coordinate's errors is
//! kept, that it is unsure of all of them together is not.
//!
//! # Source
//! R. E. Kalman, "A new approach to linear filtering and prediction problems", Journal of Basic Engineering 82 (1960) 35-45;
//! innovations as a likelihood: F. C. Schweppe, IEEE Transactions on Information Theory 11 (1965) 61-70.

use std::ops::Range;

use super::pose::PoseErrors;
use crate::loss::Observation;

/// The map for the observations of one run.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Whitening {
    /// For each observation.
    steps: Vec<Step>,
    /// Observations of each image.
    images: Vec<Range<usize>>,
}

/// How one observation is predicted from the one before.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Step {
    /// The observation before of the same coordinate.
    earlier: Option<usize>,
    /// Correlation with that observation, of noise and of the error that follows the pose.
    decay: [f64; 2],
    /// Standard deviation of what follows the pose, over that of noise.
    pose: f64,
    /// By how much of what is new noise and what follows the pose are known better, both in standard deviations.
    gain: [f64; 2],
    /// One over the standard deviation of what is new beside what the image's time makes, as far as that is known by then.
    scale: f64,
    /// How fast the coordinate moves, in standard deviations of its noise per standard deviation of an image's time.
    speed: f64,
    /// By how much of what is new the image's time is known better, in standard deviations.
    time_gain: f64,
}

/// Correlations are limited to this (chosen): with 1, whitening would divide by 0.
const CORRELATION_MAX: f64 = 0.999;

impl Whitening {
    /// For `observations` of images at `time_s` \[s\] with noise of `correlation` over `interval_s` \[s\], weighed by it, and what
    /// follows the pose, where that is known. `speeds`: how far each moves while an image's time is off by its standard deviation, weighed
    /// too; none where times are right.
    pub(crate) fn new(
        observations: &[Observation],
        time_s: &[f64],
        correlation: f64,
        interval_s: f64,
        pose: Option<&PoseErrors>,
        speeds: &[f64],
    ) -> Self {
        let width = observations.iter().map(|o| o.keypoint + 1).max().unwrap_or(0);
        let mut last: Vec<Option<(usize, [[f64; 2]; 2])>> = vec![None; 3 * width];
        let mut steps: Vec<Step> = Vec::with_capacity(observations.len());
        let mut images = Vec::new();
        for image in observations.chunk_by(|one, next| one.instant == next.instant) {
            let first = steps.len();
            images.push(first..first + image.len());
            // what is known of the image's time, and of each coordinate's errors where that is known
            let mut unsure = 1.0;
            let mut known = Vec::with_capacity(image.len());
            for (place, now) in image.iter().enumerate() {
                let row = first + place;
                let series = &last[3 * now.keypoint + now.axis];
                let share = pose.map_or(0.0, |pose| pose.std_m(now) * now.per_m);
                let (earlier, decay, [[a, b], [_, d]]) = match *series {
                    None => (None, [0.0; 2], [[1.0, 0.0], [0.0, 1.0]]),
                    Some((earlier, [[a, b], [_, d]])) => {
                        let before = &observations[earlier];
                        let apart_s = time_s[now.instant] - time_s[before.instant];
                        let noise = correlation.powf(apart_s / interval_s).clamp(0.0, CORRELATION_MAX);
                        let stays = pose.map_or(0.0, |pose| pose.correlation(before, now));
                        let (noise2, stays2) = (noise * noise, stays * stays);
                        let across = noise * stays * b;
                        let after = [[1.0 + noise2 * (a - 1.0), across], [across, 1.0 + stays2 * (d - 1.0)]];
                        (Some(earlier), [noise, stays], after)
                    }
                };
                // what an observation, noise + share * pose, has in common with each
                let shared = [a + share * b, b + share * d];
                let variance = shared[0] + share * shared[1];
                let gain = shared.map(|one| one / variance);
                let left = [
                    [a - gain[0] * shared[0], b - gain[0] * shared[1]],
                    [b - gain[1] * shared[0], d - gain[1] * shared[1]],
                ];
                let speed = speeds.get(row).copied().unwrap_or(0.0);
                let new = variance + speed * speed * unsure;
                let time_gain = speed * unsure / new;
                unsure -= time_gain * speed * unsure;
                known.push((left, gain, speed));
                steps.push(Step {
                    earlier,
                    decay,
                    pose: share,
                    gain,
                    scale: new.sqrt().recip(),
                    speed,
                    time_gain,
                });
            }
            // what is not known of the time is not known of the errors: by each coordinate's own
            for (place, (now, (left, gain, speed))) in image.iter().zip(known).enumerate() {
                let spread = speed * speed * unsure;
                let after = [0, 1].map(|i| [0, 1].map(|j| left[i][j] + spread * gain[i] * gain[j]));
                last[3 * now.keypoint + now.axis] = Some((first + place, after));
            }
        }
        Self { steps, images }
    }

    /// Whitens `numbers`, one an observation.
    pub(crate) fn apply(&self, numbers: &mut [f64]) {
        let mut known: Vec<[f64; 2]> = Vec::with_capacity(numbers.len());
        for image in &self.images {
            let mut time = 0.0;
            for (number, step) in numbers[image.clone()].iter_mut().zip(&self.steps[image.clone()]) {
                let before = step.earlier.map_or([0.0; 2], |earlier| known[earlier]);
                let [noise, pose] = [step.decay[0] * before[0], step.decay[1] * before[1]];
                let new = *number - noise - step.pose * pose;
                known.push([noise + step.gain[0] * new, pose + step.gain[1] * new]);
                let own = new - step.speed * time;
                time += step.time_gain * own;
                *number = own * step.scale;
            }
            // what the image's time explains is no error of the coordinate
            for (known, step) in known[image.start..].iter_mut().zip(&self.steps[image.clone()]) {
                *known = [0, 1].map(|i| known[i] - step.gain[i] * step.speed * time);
            }
        }
    }

    /// Logarithm of the determinant of the errors' covariance, in units of the noise's.
    pub(crate) fn ln_determinant(&self) -> f64 {
        -2.0 * self.steps.iter().map(|step| step.scale.ln()).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whitened unit columns, and the determinant, against a covariance.
    fn agrees(whitening: &Whitening, covariance: &nalgebra::DMatrix<f64>) {
        let size = covariance.nrows();
        let mut white = nalgebra::DMatrix::<f64>::identity(size, size);
        white.column_iter_mut().for_each(|mut column| whitening.apply(column.as_mut_slice()));
        let unity = &white * covariance * white.transpose();
        assert!((unity - nalgebra::DMatrix::identity(size, size)).amax() < 1e-12);
        assert!((whitening.ln_determinant() - covariance.determinant().ln()).abs() < 1e-12);
    }

    #[test]
    fn whitened_columns_have_the_inverse_covariance_as_their_product() {
        let at = |instant: usize| Observation { instant, keypoint: 0, axis: 0, measured_m: 0.0, per_m: 1e5 };
        let time_s: [f64; 4] = [0.0, 0.01, 0.02, 0.05];
        let (rho, list): (f64, Vec<_>) = (0.6, (0..4).map(at).collect());
        let noise = nalgebra::DMatrix::from_fn(4, 4, |i, j| rho.powf((time_s[i] - time_s[j]).abs() / 0.01));
        agrees(&Whitening::new(&list, &time_s, rho, 0.01, None, &[]), &noise);

        // at rest, on by 0.1 mm, and far away
        let x_m = [0.0, 0.0, 1e-4, 5e-2];
        let trajectory = sim::Trajectory {
            time_s: time_s.to_vec(),
            keypoints: vec!["P1".into()],
            position_m: x_m.iter().map(|&x| [x, f64::NAN, 0.0]).collect(),
            std_m: None,
            pose_std_m: Some(vec![2e-5; 4]),
        };
        let pose = PoseErrors::of(&trajectory).unwrap();
        let stays = |i: usize, j: usize| pose.correlation(&list[i.min(j)], &list[i.max(j)]);
        assert_eq!((stays(0, 1), stays(0, 2) < 1.0, stays(2, 3) < 1e-6), (1.0, true, true));
        let both = nalgebra::DMatrix::from_fn(4, 4, |i, j| noise[(i, j)] + 4.0 * stays(i, j));
        agrees(&Whitening::new(&list, &time_s, rho, 0.01, Some(&pose), &[]), &both);
    }

    #[test]
    fn times_of_images_that_scatter_are_in_the_covariance() {
        let list: Vec<_> = (0..12)
            .map(|place| Observation {
                instant: place / 4,
                keypoint: place % 4 / 2,
                axis: place % 2,
                measured_m: 0.0,
                per_m: 1e5,
            })
            .collect();
        let time_s = [0.0, 0.01, 0.03];
        let speeds: Vec<f64> = (0..12).map(|place| f64::sin(1.3 * place as f64) * 3.0).collect();
        let covariance = nalgebra::DMatrix::from_fn(12, 12, |i, j| {
            let shared = if i / 4 == j / 4 { speeds[i] * speeds[j] } else { 0.0 };
            shared + f64::from(u8::from(i == j))
        });
        agrees(&Whitening::new(&list, &time_s, 0.0, 0.01, None, &speeds), &covariance);

        // beside noise that lasts, what one image leaves unsure of all coordinates together is not carried on: the variances are right
        let (rho, speeds) = (0.5, [2.0; 12]);
        let whitening = Whitening::new(&list, &time_s, rho, 0.01, None, &speeds);
        let covariance = nalgebra::DMatrix::from_fn(12, 12, |i, j| {
            let shared = if i / 4 == j / 4 { 4.0 } else { 0.0 };
            let own = if i % 4 == j % 4 {
                f64::powf(rho, (time_s[i / 4] - time_s[j / 4]).abs() / 0.01)
            } else {
                0.0
            };
            shared + own
        });
        let mut white = nalgebra::DMatrix::<f64>::identity(12, 12);
        white.column_iter_mut().for_each(|mut column| whitening.apply(column.as_mut_slice()));
        let unity = &white * covariance * white.transpose();
        assert!((unity - nalgebra::DMatrix::identity(12, 12)).amax() < 0.1);
    }
}
