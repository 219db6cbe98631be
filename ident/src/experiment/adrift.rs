//! Runs of a body that floats freely: it drifts before the servo moves, instead of resting.

use sim::model::Joint;
use sim::{JointKind, Model, RolloutOptions, rollout};

use super::{Experiment, Run, RunKind};

/// The drift of a body is estimated from images within this time before the first motion \[s\] (chosen).
const DRIFT_WINDOW_S: f64 = 0.5;
/// Time in which joints held by springs and drives are taken to come to rest \[s\] (chosen), for the first guess.
const SETTLING_TIME_S: f64 = 5.0;
/// Time before the first image at which the simulation of a drifting body starts \[s\] (chosen), so that its joints settle for each
/// candidate.
pub(crate) const DRIFT_LEAD_S: f64 = 0.5;

impl Experiment {
    /// Where the model's body floats, lets each driven run begin in its last images before the servo moves, and with a velocity: until
    /// then the body drifts. Images before these become gaps.
    pub fn set_adrift(&mut self) {
        if floating(&self.model).next().is_none() {
            return;
        }
        for run in self.runs.iter_mut().filter(|run| run.kind == RunKind::Driven) {
            run.set_adrift();
        }
    }
}

impl Run {
    fn set_adrift(&mut self) {
        // a run without any motion is refused when runs are checked
        let Some(from_s) = self.first_motion_s().map(|motion_s| motion_s - DRIFT_WINDOW_S) else { return };
        self.adrift = true;
        let trajectory = &mut self.trajectory;
        let early = trajectory.time_s.partition_point(|time_s| *time_s < from_s);
        trajectory.position_m[..early * trajectory.keypoints.len()].fill([f64::NAN; 3]);
    }
}

/// Whether each velocity at the start of `run` is unknown, shape (nv): all that are not prescribed (`frozen`) in a `free` run, those of what floats in
/// a driven one, as far as images show them.
pub(crate) fn unknown_rates(model: &Model, run: &Run, frozen: &[bool]) -> Vec<bool> {
    let mut unknown = vec![run.kind == RunKind::Free; model.nv()];
    if run.adrift {
        let not_estimated = not_estimated(model, run);
        for dof in floating(model) {
            unknown[dof] = !not_estimated[dof];
        }
    }
    unknown.iter().zip(frozen).map(|(unknown, frozen)| *unknown && !frozen).collect()
}

/// Whether images of an `adrift` run need not say where each degree of freedom begins, shape (nv): springs and drives have their joints at rest
/// by then; and what moves out of the picture's plane changes keypoints by its square only, too little to be told from noise before a body is driven.
pub(crate) fn not_estimated(model: &Model, run: &Run) -> Vec<bool> {
    let mut not_estimated = vec![false; model.nv()];
    if !run.adrift {
        return not_estimated;
    }
    for joint in held(model) {
        not_estimated[joint.dof_address] = true;
    }
    if run.trajectory.position_m.iter().all(|position| position[1].is_nan()) {
        let rotations = model.poses(&model.rest_state().qpos).body_rot;
        for joint in model.joints.iter().filter(|joint| joint.kind == JointKind::Free) {
            // a free joint turns about its body's own axes: in the picture about the one that the camera looks along
            let along: [f64; 3] = std::array::from_fn(|axis| rotations[joint.body].0[1][axis].abs());
            let in_plane = (0..3).max_by(|&a, &b| along[a].total_cmp(&along[b]));
            let turns = (0..3).filter(|axis| Some(*axis) != in_plane).map(|axis| 3 + axis);
            for out_of_plane in std::iter::once(1).chain(turns) {
                not_estimated[joint.dof_address + out_of_plane] = true;
            }
        }
    }
    not_estimated
}

/// The joints that springs or drives hold.
fn held(model: &Model) -> impl Iterator<Item = &Joint<f64>> {
    let is_held = |(place, joint): &(usize, &Joint<f64>)| {
        let driven = model.actuators.iter().any(|actuator| actuator.drives(*place));
        joint.kind.is_axle() && (driven || joint.stiffness[0] > 0.0)
    };
    model.joints.iter().enumerate().filter(is_held).map(|(_, joint)| joint)
}

/// The coordinates to look for those of `run` from, shape (nq): the model's own, or where it comes to rest.
pub(crate) fn resting(model: &Model, run: &Run) -> Vec<f64> {
    let rest = model.rest_state();
    let settled_pose = || {
        let (command, motion_s) = (run.command.as_ref()?, run.first_motion_s()?);
        let options = RolloutOptions { start_s: motion_s - SETTLING_TIME_S, ..RolloutOptions::default() };
        let end = rollout(model, &rest, command, &[motion_s], &options).ok()?;
        let mut qpos = rest.qpos.clone();
        for joint in held(model) {
            qpos[joint.qpos_address] = end.qpos[joint.qpos_address];
        }
        Some(qpos)
    };
    run.adrift.then(settled_pose).flatten().unwrap_or(rest.qpos)
}

/// The degrees of freedom of bodies that nothing holds.
fn floating(model: &Model) -> impl Iterator<Item = usize> + '_ {
    let joints = model.joints.iter().filter(|joint| joint.kind == JointKind::Free);
    joints.flat_map(|joint| joint.dof_address..joint.dof_address + joint.kind.nv())
}
