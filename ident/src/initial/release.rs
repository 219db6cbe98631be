//! When a mechanism at rest was let go.

use sim::Trajectory;

/// The release of a drop, as far as the images show it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Release {
    /// Most probable time \[s\].
    pub start_s: f64,
    /// Time of the first image \[s\]: not before.
    pub earliest_s: f64,
    /// Time of the image in which motion is beyond doubt \[s\]: not after.
    pub latest_s: f64,
}

/// Images at the start over which the pose at rest is averaged, for the threshold (chosen).
const REST_IMAGES: usize = 5;
/// Images in a row that must show motion (chosen): one alone may be a misread keypoint.
const MOVING_IMAGES: usize = 3;
/// Root mean square displacement over all coordinates that counts as motion \[standard deviations\] (chosen).
const MOTION_Z: f64 = 4.0;

/// Finds the release in a drop. The images before it show rest, so their running mean is the reference;
/// motion then starts with constant acceleration, so the root of the displacement is linear in time and its
/// zero is the release. `None`: nothing moves.
pub fn release(trajectory: &Trajectory, noise_m: f64) -> Option<Release> {
    let time = &trajectory.time_s;
    let shown = |instant: &usize| {
        displacement(trajectory, *instant, &vec![[0.0; 3]; trajectory.keypoints.len()]).is_some()
    };
    let observed: Vec<usize> = (0..time.len()).filter(shown).collect();
    let earliest_s = time[*observed.first()?];
    for from in 1..=observed.len().saturating_sub(MOVING_IMAGES) {
        let rest = mean(trajectory, &observed[..from]);
        // The mean over few images is itself uncertain.
        let threshold = MOTION_Z * noise_m * (1.0 + 1.0 / from.min(REST_IMAGES) as f64).sqrt();
        let moved =
            |instant: &usize| displacement(trajectory, *instant, &rest).is_some_and(|d| d > threshold);
        if !observed[from..from + MOVING_IMAGES].iter().all(moved) {
            continue;
        }
        // The images right before already move by less than the noise: take the pose at rest from earlier ones.
        let rest = mean(trajectory, &observed[..from.saturating_sub(MOVING_IMAGES).max(1)]);
        let points: Vec<(f64, f64)> = observed[from..]
            .iter()
            .take(2 * MOVING_IMAGES)
            .filter_map(|&instant| Some((time[instant], displacement(trajectory, instant, &rest)?.sqrt())))
            .collect();
        let latest_s = time[observed[from]];
        let start_s = zero_of_line(&points).unwrap_or(latest_s).clamp(earliest_s, latest_s);
        return Some(Release { start_s, earliest_s, latest_s });
    }
    None
}

/// Root mean square over all observed coordinates of the distance from `rest`.
fn displacement(trajectory: &Trajectory, instant: usize, rest: &[[f64; 3]]) -> Option<f64> {
    let mut squares = Vec::new();
    for (keypoint, rest) in rest.iter().enumerate() {
        let here = trajectory.at(instant, keypoint);
        squares.extend((0..3).map(|axis| (here[axis] - rest[axis]).powi(2)).filter(|d| d.is_finite()));
    }
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

fn mean(trajectory: &Trajectory, instants: &[usize]) -> Vec<[f64; 3]> {
    let keypoint = |keypoint: usize| {
        std::array::from_fn(|axis| {
            let values: Vec<f64> = instants
                .iter()
                .map(|&instant| trajectory.at(instant, keypoint)[axis])
                .filter(|x| x.is_finite())
                .collect();
            // No number at all: NaN, a coordinate without a reference.
            values.iter().sum::<f64>() / values.len() as f64
        })
    };
    (0..trajectory.keypoints.len()).map(keypoint).collect()
}

/// Where the regression line through the points crosses zero, if it rises.
fn zero_of_line(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let (mx, my) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let sxy: f64 = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    let sxx: f64 = points.iter().map(|p| (p.0 - mx).powi(2)).sum();
    (sxy > 0.0).then(|| mx - my * sxx / sxy)
}
