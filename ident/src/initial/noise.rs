//! Keypoint noise from the images alone.

use sim::Trajectory;

/// Third differences of a smooth motion vanish; those of noise have 1 + 9 + 9 + 1 times its variance.
const VARIANCE: f64 = 20.0;
/// Median of the absolute value of a standard normal number.
const MEDIAN: f64 = 0.674_489_75;
/// No camera sees better than this \[m\]; it keeps exact data from dividing by nothing.
const FLOOR_M: f64 = 1e-6;
/// Instants count as evenly spaced when their steps agree to this share.
const EVEN: f64 = 0.2;

/// Standard deviation of one coordinate \[m\], robustly, from the third differences of `trajectories` over
/// evenly spaced images. It leaves out whatever is slow, hence is a lower limit on what a fit can reach.
pub fn noise_m<'a>(trajectories: impl IntoIterator<Item = &'a Trajectory>) -> f64 {
    let mut differences = Vec::new();
    for trajectory in trajectories {
        let time = &trajectory.time_s;
        for row in 3..time.len() {
            let step = (time[row] - time[row - 3]) / 3.0;
            if (row - 3..row).any(|i| (time[i + 1] - time[i] - step).abs() > EVEN * step) {
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
        return FLOOR_M;
    }
    let middle = differences.len() / 2;
    let (_, median, _) = differences.select_nth_unstable_by(middle, f64::total_cmp);
    (*median / MEDIAN / VARIANCE.sqrt()).max(FLOOR_M)
}
