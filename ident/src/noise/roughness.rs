//! Noise of the keypoints' paths alone, whatever moves them: how rough they are.

use sim::Trajectory;

/// Median of the absolute value of a standard normal number, and what a quarter of all are below.
const ABS_NORMAL_MEDIAN: f64 = 0.674_489_75;
const ABS_NORMAL_QUARTILE: f64 = 0.318_639_36;
/// Smallest noise that is assumed \[m\] (chosen: no camera resolves better); it keeps exact data from dividing by nothing.
pub(crate) const LEAST_NOISE_M: f64 = 1e-6;
/// Instants count as evenly spaced when their steps agree to this share (chosen).
const EVEN_STEPS_DEVIATION_SHARE_MAX: f64 = 0.2;

/// Variance of third differences of noise whose variance is 1: of white noise 1 + 9 + 9 + 1.
pub(crate) fn third_difference(correlation: f64) -> f64 {
    20.0 - 30.0 * correlation + 12.0 * correlation.powi(2) - 2.0 * correlation.powi(3)
}

/// Standard deviation of one coordinate \[m\], robustly, from the third differences of `trajectories` over
/// evenly spaced images: those of a smooth motion vanish. It leaves out whatever is slow, hence is a lower limit on
/// what a fit can reach.
pub(crate) fn noise_m<'a>(trajectories: impl IntoIterator<Item = &'a Trajectory>) -> f64 {
    roughness_m(trajectories, 0.5, ABS_NORMAL_MEDIAN)
}

/// The same from the calmest quarter of the images alone: where few images are taken of a quick motion, they are rough without any
/// noise.
pub(crate) fn calm_noise_m<'a>(trajectories: impl IntoIterator<Item = &'a Trajectory>) -> f64 {
    roughness_m(trajectories, 0.25, ABS_NORMAL_QUARTILE)
}

/// Noise of whose third differences the given `share` would be as small as those of `trajectories` are; of a standard normal
/// number so many are below `quantile` in size.
fn roughness_m<'a>(trajectories: impl IntoIterator<Item = &'a Trajectory>, share: f64, quantile: f64) -> f64 {
    let mut differences = Vec::new();
    for trajectory in trajectories {
        let time = &trajectory.time_s;
        for row in 3..time.len() {
            let step = (time[row] - time[row - 3]) / 3.0;
            if (row - 3..row)
                .any(|i| (time[i + 1] - time[i] - step).abs() > EVEN_STEPS_DEVIATION_SHARE_MAX * step)
            {
                continue;
            }
            for keypoint in 0..trajectory.keypoints.len() {
                for axis in 0..3 {
                    let at = |back: usize| trajectory.at(row - back, keypoint)[axis];
                    let difference = at(0) - 3.0 * at(1) + 3.0 * at(2) - at(3);
                    if difference.is_finite() {
                        differences.push(difference.abs());
                    }
                }
            }
        }
    }
    if differences.is_empty() {
        return LEAST_NOISE_M;
    }
    let place = (share * differences.len() as f64) as usize;
    let (_, found, _) = differences.select_nth_unstable_by(place, f64::total_cmp);
    (*found / quantile / third_difference(0.0).sqrt()).max(LEAST_NOISE_M)
}
