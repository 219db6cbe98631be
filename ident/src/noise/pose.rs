//! Measurement errors that depend on the pose.
//!
//! Where a keypoint is found depends a little on how its outline falls on the grid of pixels, and on what of the mechanism's shape is
//! known only by and by: an error that every picture of a pose repeats. It stays while the mechanism rests, and is another
//! one once it has gone on by about a pixel. No average over images takes it out, so it must not count as a cause.

use sim::Trajectory;

use crate::loss::Observation;

/// Path length over which the error decorrelates, over its standard deviation (measured): a few hundredths of a pixel are wrong with the place on
/// the pixel. `cargo run --release -p system-tests --example clips -- --errors FILE.csv` shows it.
const CORRELATION_LENGTH_STDS: f64 = 40.0;
/// A keypoint that has moved by no more than this many standard deviations counts as at rest (chosen).
const REST_MOVEMENT_STDS_MAX: f64 = 1.0;

/// Errors that follow the pose, of one run.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PoseErrors {
    width: usize,
    /// Standard deviation of a coordinate \[m\], shape (N, K); 0 where none is stated.
    std_m: Vec<f64>,
    /// How far the mechanism has gone until each image, by the keypoint that moves farthest \[m\], shape (N).
    way_m: Vec<f64>,
}

impl PoseErrors {
    /// Those that `trajectory` states, if it does.
    pub(crate) fn of(trajectory: &Trajectory) -> Option<Self> {
        let stated = trajectory.pose_std_m.as_ref().filter(|all| all.iter().any(|std| std.is_finite()))?;
        let width = trajectory.keypoints.len();
        let mut last: Vec<Option<[f64; 3]>> = vec![None; width];
        let mut way_m = Vec::with_capacity(trajectory.time_s.len());
        let mut gone_m = 0.0;
        for instant in 0..trajectory.time_s.len() {
            let mut step_m: f64 = 0.0;
            for (keypoint, before) in last.iter_mut().enumerate() {
                let now = trajectory.at(instant, keypoint);
                if now.iter().all(|x| x.is_nan()) {
                    continue;
                }
                let square = |before: [f64; 3]| -> f64 {
                    let axes = now.iter().zip(before).map(|(now, before)| (now - before).powi(2));
                    axes.filter(|square| square.is_finite()).sum()
                };
                let rests_m = REST_MOVEMENT_STDS_MAX * stated[instant * width + keypoint];
                match *before {
                    Some(before) if square(before).sqrt() <= rests_m => continue,
                    Some(before) => step_m = step_m.max(square(before).sqrt()),
                    None => {}
                }
                *before = Some(now);
            }
            gone_m += step_m;
            way_m.push(gone_m);
        }
        let std_m = stated.iter().map(|std| if std.is_finite() { *std } else { 0.0 }).collect();
        Some(Self { width, std_m, way_m })
    }

    /// Root mean square of the standard deviations \[m\].
    pub(crate) fn rms_m(&self) -> f64 {
        (self.std_m.iter().map(|std| std * std).sum::<f64>() / self.std_m.len().max(1) as f64).sqrt()
    }

    /// Standard deviation at an observation \[m\].
    pub(crate) fn std_m(&self, of: &Observation) -> f64 {
        self.std_m[of.instant * self.width + of.keypoint]
    }

    /// Correlation of the error at an observation with that of an earlier one of the same coordinate.
    pub(super) fn correlation(&self, earlier: &Observation, later: &Observation) -> f64 {
        let way_m = self.way_m[later.instant] - self.way_m[earlier.instant];
        let over_m = CORRELATION_LENGTH_STDS * self.std_m(later);
        if over_m > 0.0 { (-way_m / over_m).exp() } else { 0.0 }
    }
}
