//! How far simulated keypoints are from measured ones.
//!
//! Two figures, used for different ends. The *paper's loss*, the mean over images of the sum over keypoints of
//! squared distances, is what is reported ([`SquaredError`]). The *residuals* in units of their standard
//! deviation are what a fit works with ([`Observation`]): with equal noise everywhere and no gaps both have
//! their minimum at the same parameters. Gaps and axes that were never observed appear in neither.

use serde::{Deserialize, Serialize};
use sim::Trajectory;

/// One measured coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Row of the trajectory.
    pub instant: usize,
    /// Column of the trajectory.
    pub keypoint: usize,
    /// 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Measured coordinate \[m\].
    pub measured_m: f64,
    /// Root of the run's weight over the standard deviation \[1/m\].
    pub per_m: f64,
}

/// How measured coordinates are weighed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weighting {
    /// Standard deviation where the trajectory states none \[m\].
    pub noise_m: f64,
    /// Whether standard deviations stated by the trajectory count.
    pub use_stated: bool,
    /// How often each image of this run counts.
    pub run_weight: f64,
}

/// Every coordinate that was measured at an instant \[s\] for which `within` holds, in the table's order.
pub fn observations(
    trajectory: &Trajectory,
    weighting: Weighting,
    within: impl Fn(f64) -> bool,
) -> Vec<Observation> {
    let width = trajectory.keypoints.len();
    let mut list = Vec::new();
    for (instant, _) in trajectory.time_s.iter().enumerate().filter(|(_, time_s)| within(**time_s)) {
        for keypoint in 0..width {
            let stated = trajectory.std_m.as_ref().map(|std| std[instant * width + keypoint]);
            let std_m =
                stated.filter(|std| weighting.use_stated && std.is_finite()).unwrap_or(weighting.noise_m);
            for (axis, measured_m) in trajectory.at(instant, keypoint).into_iter().enumerate() {
                if measured_m.is_finite() {
                    let per_m = weighting.run_weight.sqrt() / std_m;
                    list.push(Observation { instant, keypoint, axis, measured_m, per_m });
                }
            }
        }
    }
    list
}

/// Residuals, measured - simulated in standard deviations, of `observations` against `simulated_m`, which is
/// laid out as their trajectory is: shape (N, K) with K = `width`.
pub fn residuals(observations: &[Observation], simulated_m: &[[f64; 3]], width: usize) -> Vec<f64> {
    residuals_of_all(observations, &[simulated_m], width).remove(0)
}

/// The same for each of several simulations.
pub fn residuals_of_all(
    observations: &[Observation],
    simulated_m: &[&[[f64; 3]]],
    width: usize,
) -> Vec<Vec<f64>> {
    /// Observations that stay in a processor's nearest cache while all simulations are held against them.
    const OBSERVATIONS_AT_ONCE: usize = 512;
    let mut all: Vec<Vec<f64>> = simulated_m.iter().map(|_| Vec::with_capacity(observations.len())).collect();
    for observations in observations.chunks(OBSERVATIONS_AT_ONCE) {
        for (residuals, simulated_m) in all.iter_mut().zip(simulated_m) {
            let residual = |o: &Observation| {
                (o.measured_m - simulated_m[o.instant * width + o.keypoint][o.axis]) * o.per_m
            };
            residuals.extend(observations.iter().map(residual));
        }
    }
    all
}

/// Squared distances by keypoint, added up over images and runs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SquaredError {
    /// Keypoint name, weighted sum of squares \[m2\], sum of weights.
    sums: Vec<(String, f64, f64)>,
}

impl SquaredError {
    /// Adds the images of one run from `from_s` on, each `weight` times.
    pub fn add(&mut self, measured: &Trajectory, simulated_m: &[[f64; 3]], from_s: f64, weight: f64) {
        for (column, name) in measured.keypoints.iter().enumerate() {
            let place = self.sums.iter().position(|(known, ..)| known == name).unwrap_or_else(|| {
                self.sums.push((name.clone(), 0.0, 0.0));
                self.sums.len() - 1
            });
            for distance in distances_m(measured, simulated_m, column, from_s) {
                self.sums[place].1 += weight * distance * distance;
                self.sums[place].2 += weight;
            }
        }
    }

    /// The paper's loss \[m2\]: the sum over keypoints of the mean squared distance. A keypoint's mean is over
    /// the images that show it.
    pub fn loss_m2(&self) -> f64 {
        self.sums.iter().filter(|(.., weight)| *weight > 0.0).map(|(_, sum, weight)| sum / weight).sum()
    }
}

/// Error of one keypoint over the scored images of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct KeypointError {
    /// Keypoint.
    pub name: String,
    /// Mean distance between measured and simulated \[m\].
    pub mean_error_m: f64,
    /// Root of the mean squared distance \[m\].
    pub rms_error_m: f64,
}

/// Errors of each keypoint seen at or after `from_s`; one that is not seen there has none.
pub fn keypoint_errors(measured: &Trajectory, simulated_m: &[[f64; 3]], from_s: f64) -> Vec<KeypointError> {
    let error = |(column, name): (usize, &String)| {
        let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for distance in distances_m(measured, simulated_m, column, from_s) {
            count += 1.0;
            sum += distance;
            squares += distance * distance;
        }
        (count > 0.0).then(|| KeypointError {
            name: name.clone(),
            mean_error_m: sum / count,
            rms_error_m: f64::sqrt(squares / count),
        })
    };
    measured.keypoints.iter().enumerate().filter_map(error).collect()
}

/// The keypoint that a mechanism is held by: where it is says nothing of the model, as in the paper.
pub const REFERENCE_END: &str = "P0";

/// How far off a simulation is, in one number: the root mean square of measured - simulated along one axis, over what is scored of
/// all keypoints but [`REFERENCE_END`]. The keypoints' noise, one standard deviation along one axis, is what would be left of it
/// if nothing were wrong.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct AxisError {
    squares_m2: f64,
    count: f64,
}

impl AxisError {
    /// Adds what a run shows at or after `from_s`.
    pub fn add(&mut self, measured: &Trajectory, simulated_m: &[[f64; 3]], from_s: f64) {
        let width = measured.keypoints.len();
        let scored = (0..width).filter(|&column| measured.keypoints[column] != REFERENCE_END);
        for column in scored {
            for instant in (0..measured.time_s.len()).filter(|&instant| measured.time_s[instant] >= from_s) {
                let (m, s) = (measured.at(instant, column), simulated_m[instant * width + column]);
                for off in (0..3).map(|axis| m[axis] - s[axis]).filter(|off| off.is_finite()) {
                    self.squares_m2 += off * off;
                    self.count += 1.0;
                }
            }
        }
    }

    /// The error \[m\]; none where nothing was scored.
    pub fn rms_m(self) -> Option<f64> {
        (self.count > 0.0).then(|| (self.squares_m2 / self.count).sqrt())
    }
}

/// Distance at each instant that shows the keypoint, over the axes that were observed.
fn distances_m<'a>(
    measured: &'a Trajectory,
    simulated_m: &'a [[f64; 3]],
    column: usize,
    from_s: f64,
) -> impl Iterator<Item = f64> + 'a {
    let width = measured.keypoints.len();
    (0..measured.time_s.len()).filter(move |&instant| measured.time_s[instant] >= from_s).filter_map(
        move |instant| {
            let (m, s) = (measured.at(instant, column), simulated_m[instant * width + column]);
            let mut squares =
                (0..3).map(|axis| (m[axis] - s[axis]).powi(2)).filter(|d| d.is_finite()).peekable();
            squares.peek()?;
            Some(squares.sum::<f64>().sqrt())
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_is_along_one_axis_and_leaves_out_the_reference_end() {
        let measured = Trajectory {
            time_s: vec![0.0, 1.0],
            keypoints: vec!["P0".into(), "P1".into()],
            position_m: vec![[9.0, f64::NAN, 9.0], [3.0, f64::NAN, 4.0], [0.0; 3], [f64::NAN; 3]],
            ..Trajectory::default()
        };
        let mut error = AxisError::default();
        assert_eq!(error.rms_m(), None);
        error.add(&measured, &[[0.0; 3]; 4], 0.0);
        // of 3 and 4 along two axes, whatever P0 does; what was not seen does not count
        assert_eq!(error.rms_m(), Some(12.5_f64.sqrt()));
        error.add(&measured, &[[0.0; 3]; 4], 0.5);
        assert_eq!(error.rms_m(), Some(12.5_f64.sqrt()));
    }

    const GAP: f64 = f64::NAN;

    fn measured() -> Trajectory {
        Trajectory {
            time_s: vec![0.0, 1.0, 2.0],
            keypoints: vec!["P1".into(), "P2".into()],
            position_m: vec![
                [3.0, GAP, 4.0],
                [0.0, GAP, 1.0],
                [GAP, GAP, GAP],
                [0.0, GAP, 2.0],
                [0.0, GAP, 1.0],
                [GAP, GAP, GAP],
            ],
            std_m: Some(vec![0.1, GAP, 0.1, 0.5, 0.1, 0.1]),
            pose_std_m: None,
        }
    }

    #[test]
    fn loss_is_the_mean_over_images_of_the_sum_over_keypoints_of_squared_distances() {
        let mut error = SquaredError::default();
        error.add(&measured(), &[[0.0; 3]; 6], f64::NEG_INFINITY, 1.0);
        // P1: (25 + 1) / 2 images; P2: (1 + 4) / 2.
        assert_eq!(error.loss_m2(), 13.0 + 2.5);
        let mut later = SquaredError::default();
        later.add(&measured(), &[[0.0; 3]; 6], 0.5, 1.0);
        assert_eq!(later.loss_m2(), 1.0 + 4.0);
    }

    #[test]
    fn weights_count_images() {
        let mut twice = SquaredError::default();
        twice.add(&measured(), &[[0.0; 3]; 6], 0.0, 1.0);
        twice.add(&measured(), &[[1.0; 3]; 6], 0.0, 1.0);
        twice.add(&measured(), &[[1.0; 3]; 6], 0.0, 1.0);
        let mut weighted = SquaredError::default();
        weighted.add(&measured(), &[[0.0; 3]; 6], 0.0, 1.0);
        weighted.add(&measured(), &[[1.0; 3]; 6], 0.0, 2.0);
        assert_eq!(twice.loss_m2(), weighted.loss_m2());
    }

    #[test]
    fn residuals_are_measured_minus_simulated_in_stated_deviations() {
        let weighting = Weighting { noise_m: 2.0, use_stated: true, run_weight: 4.0 };
        let list = observations(&measured(), weighting, |_| true);
        assert_eq!(residuals(&list, &[[1.0; 3]; 6], 2), [40.0, 60.0, -1.0, 0.0, -4.0, 4.0, -20.0, 0.0]);
        let uniform = Weighting { use_stated: false, ..weighting };
        let list = observations(&measured(), uniform, |t| t < 0.5);
        assert_eq!(residuals(&list, &[[1.0; 3]; 6], 2), [2.0, 3.0, -1.0, 0.0]);
    }

    #[test]
    fn mean_and_rms_error_are_over_the_images_that_show_the_keypoint() {
        let errors = keypoint_errors(&measured(), &[[0.0; 3]; 6], 0.0);
        assert_eq!(
            errors[0],
            KeypointError { name: "P1".into(), mean_error_m: 3.0, rms_error_m: 13f64.sqrt() }
        );
        assert!(keypoint_errors(&measured(), &[[0.0; 3]; 6], 1.5).iter().all(|error| error.name == "P1"));
    }
}
