//! Angles that a servo measured itself, added to those from the pictures.

use sim::Model;
use sim::model::{ActuatorKind, POINTER_M, encoded_joint, encoder_mark};

use super::{Experiment, Run};
use crate::table::MeasuredAngles;

/// Rows farther apart than this are not interpolated between \[s\] (chosen): a stroke takes half a second.
const INTERPOLATION_GAP_MAX_S: f64 = 0.1;
/// Nor are rows next to a corner: a second difference greater than this \[rad\] (chosen: 50 rows a second of a stroke that accelerates by
/// 30 rad/s2; a smaller corner errs by half of what bus servos resolve), and, as a coarser servo's differences are its steps, greater than
/// this many times the median one (chosen).
const CORNER_BEND_MIN_RAD: f64 = 12e-3;
const CORNER_BEND_RATIO: f64 = 3.0;

impl Experiment {
    /// Lets the trajectories have what the servos measured ([`Run::measured`]) as the angles of encoders on their joints, at the images' times,
    /// and gives the model an encoder for each hinge whose angles any run has. Angles that a trajectory has already stay.
    pub fn take_in_measured(&mut self) {
        for run in &mut self.runs {
            for angles in std::mem::take(&mut run.measured) {
                run.take_in(&angles, &self.model);
            }
        }
        // a hinge that is not there is found out when the runs are checked
        for joint in
            self.runs.iter().flat_map(|run| &run.trajectory.keypoints).filter_map(|name| encoded_joint(name))
        {
            self.model.add_encoder(joint);
        }
    }
}

impl Run {
    fn take_in(&mut self, angles: &MeasuredAngles, model: &Model) {
        let Some(actuator) = model.actuators.iter().find(|actuator| actuator.name == angles.actuator) else {
            return;
        };
        let mark = encoder_mark(&model.joints[actuator.joint].name);
        if self.trajectory.keypoints.contains(&mark) {
            return;
        }
        // what a motor's gear turns round is its torque, perhaps from amperes; its angle is the joint's
        let gear = if actuator.kind == ActuatorKind::Motor { 1.0 } else { actuator.gear };
        let most_rad = most_bend_rad(&angles.angle_rad);
        let way_m = |time_s: &f64| {
            let angle_rad = between(angles, most_rad, *time_s).unwrap_or(f64::NAN) / gear;
            [POINTER_M * angle_rad, f64::NAN, f64::NAN]
        };
        let ways_m: Vec<[f64; 3]> = self.trajectory.time_s.iter().map(way_m).collect();
        if ways_m.iter().any(|way_m| way_m[0].is_finite()) {
            self.trajectory.add_mark(mark, &ways_m);
        }
    }
}

/// Second difference about `row`, 0 at the ends \[rad\].
fn bend_rad(angle_rad: &[f64], row: usize) -> f64 {
    let about = row.checked_sub(1).and_then(|before| angle_rad.get(before..before + 3));
    about.map_or(0.0, |about| (about[0] - 2.0 * about[1] + about[2]).abs())
}

/// The greatest bend across which rows are interpolated.
fn most_bend_rad(angle_rad: &[f64]) -> f64 {
    let mut bends: Vec<f64> = (0..angle_rad.len()).map(|row| bend_rad(angle_rad, row)).collect();
    bends.sort_by(f64::total_cmp);
    bends.get(bends.len() / 2).map_or(0.0, |usual| CORNER_BEND_RATIO * usual).max(CORNER_BEND_MIN_RAD)
}

/// The angle at `time_s`, on the cubic through the two rows before and after, where neither next to it is a bend of more than `most_rad`; at
/// the ends on a straight line.
fn between(angles: &MeasuredAngles, most_rad: f64, time_s: f64) -> Option<f64> {
    let next = angles.time_s.partition_point(|&row_s| row_s <= time_s);
    let before = next.checked_sub(1)?;
    let [from_s, from] = [angles.time_s[before], angles.angle_rad[before]];
    if from_s == time_s {
        return Some(from);
    }
    let (&to_s, &to) = angles.time_s.get(next).zip(angles.angle_rad.get(next))?;
    let is_straight = [before, next].iter().all(|&row| bend_rad(&angles.angle_rad, row) <= most_rad);
    if !is_straight || to_s - from_s > INTERPOLATION_GAP_MAX_S {
        return None;
    }
    let about = before.saturating_sub(1)..(next + 2).min(angles.time_s.len());
    let (times_s, values) = (&angles.time_s[about.clone()], &angles.angle_rad[about]);
    if times_s.len() < 4 || times_s[3] - times_s[0] > 3.0 * INTERPOLATION_GAP_MAX_S {
        return Some(from + (time_s - from_s) / (to_s - from_s) * (to - from));
    }
    // Lagrange's form
    let share = |of: usize| -> f64 {
        (0..4).filter(|&k| k != of).map(|k| (time_s - times_s[k]) / (times_s[of] - times_s[k])).product()
    };
    Some((0..4).map(|k| share(k) * values[k]).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::{FitConfig, RunKind};
    use sim::Trajectory;

    const MODEL: &str = r#"<mujoco><compiler angle="radian"/><worldbody><body name="link1">
        <joint name="q1" type="hinge" axis="0 -1 0"/><geom type="box" size="0.005 0.003 0.015" density="1200"/>
        <site name="P1" pos="0 0 -0.03"/></body></worldbody>
        <actuator><position name="servo" joint="q1" kp="1" gear="2"/></actuator></mujoco>"#;

    #[test]
    fn measured_angles_become_an_encoder_s_at_the_images_times() {
        let trajectory = Trajectory {
            time_s: vec![0.0, 0.01, 0.02, 0.03, 0.04, 0.08, 0.5],
            keypoints: vec!["P1".into()],
            position_m: vec![[0.0, 0.0, -0.03]; 7],
            std_m: Some(vec![1e-4; 7]),
            pose_std_m: None,
        };
        let angles = |actuator: &str| MeasuredAngles {
            actuator: actuator.into(),
            time_s: vec![0.01, 0.03, 0.05, 0.07, 0.09, 1.0],
            angle_rad: vec![0.2, 0.4, 0.6, 0.6, 0.6, 0.6],
        };
        let run = Run {
            measured: vec![angles("servo"), angles("another")],
            ..Run::new("a", RunKind::Driven, trajectory)
        };
        let mut experiment =
            Experiment::new(Model::from_mjcf(MODEL).unwrap(), FitConfig::default(), vec![run]);
        experiment.take_in_measured();
        let trajectory = &experiment.runs[0].trajectory;
        assert_eq!(trajectory.keypoints, ["P1", "q1_rad"]);
        assert_eq!(experiment.model.marks(), ["P1", "q1_rad"]);
        // gear 2: the joint turns by half of what the servo does; nothing before the first row, next to a bend or over a gap
        let joint: Vec<f64> = (0..7).map(|row| trajectory.at(row, 1)[0] / POINTER_M).collect();
        assert!([0, 4, 6].iter().all(|&row| joint[row].is_nan()), "{joint:?}");
        for (row, angle) in [(1, 0.1), (2, 0.15), (3, 0.2), (5, 0.3)] {
            assert!((joint[row] - angle).abs() < 1e-12, "{joint:?}");
        }
        assert_eq!(trajectory.at(2, 0), [0.0, 0.0, -0.03]);
        let stds = trajectory.std_m.as_ref().unwrap();
        assert!(stds[2] == 1e-4 && stds[3].is_nan());
    }
    #[test]
    fn an_even_speeding_up_is_followed_exactly_and_a_corner_is_left_out() {
        let time_s: Vec<f64> = (0..40).map(|row| 0.02 * f64::from(row)).collect();
        let path = |t: f64| if t < 0.4 { 10.0 * t * t } else { 1.6 - 8.0 * (t - 0.4) };
        let angles = MeasuredAngles {
            actuator: "servo".into(),
            angle_rad: time_s.iter().map(|&t| path(t)).collect(),
            time_s,
        };
        let most_rad = most_bend_rad(&angles.angle_rad);
        for t in [0.025, 0.113, 0.357, 0.551] {
            let found = between(&angles, most_rad, t).unwrap();
            assert!((found - path(t)).abs() < 1e-9, "{t}: {found}");
        }
        assert_eq!(between(&angles, most_rad, 0.395), None);
        assert_eq!(between(&angles, most_rad, 0.405), None);
    }
}
