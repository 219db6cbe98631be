//! Runs that could be made: drops from several poses, for which a hand is needed, and strokes of the servo.

use serde::{Deserialize, Serialize};
use sim::{Command, State, Trajectory};

use crate::experiment::{Experiment, Run, RunKind};
use crate::initial::Start;
use crate::noise::floor::Floor;

/// A run that could be made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Proposal {
    /// Name of the run, used for files.
    pub id: String,
    /// What moves it.
    pub motion: Motion,
    /// How long it is filmed \[s\].
    pub seconds: f64,
    /// Time between images \[s\].
    pub interval_s: f64,
}

/// What moves a proposed run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Motion {
    /// Let go by hand.
    Drop {
        /// Angle of every hinge, base to tip \[rad\].
        pose_rad: Vec<f64>,
    },
    /// Strokes of the servo about the centre.
    Driven {
        /// Half the sweep \[rad\].
        amplitude_rad: f64,
        /// Duration of a counter-clockwise stroke \[s\].
        ccw_s: f64,
        /// Duration of a clockwise stroke \[s\].
        cw_s: f64,
    },
}

/// Rest before anything moves \[s\] (chosen).
const REST_BEFORE_MOTION_S: f64 = 0.3;
/// Angles of the first hinge in drops of the straight mechanism \[rad\] (chosen).
const DROP_FIRST_HINGE_ANGLES_RAD: [f64; 6] = [1.5, -1.5, 0.8, -0.8, 2.5, -2.5];
/// Angle between links in drops from zigzag poses \[rad\] (chosen).
const DROP_BEND_RAD: f64 = 1.2;
/// Amplitudes of strokes, as shares of the largest (chosen).
const STROKE_AMPLITUDE_SHARES: [f64; 3] = [2.0 / 9.0, 2.0 / 3.0, 1.0];
/// Durations of a pair of strokes \[s\] (chosen); the counter-clockwise one takes two thirds.
const STROKE_PERIODS_S: [f64; 3] = [0.6, 1.5, 3.0];

/// What could be run with the mechanism of `experiment`, as its `[design]` says.
pub(crate) fn proposals(experiment: &Experiment, floor: &Floor) -> Vec<Proposal> {
    let interval_s = floor.runs.iter().map(|run| run.interval_s).fold(0.05, f64::min).max(1.0 / 200.0);
    let (model, design) = (&experiment.model, &experiment.design);
    let hinges: Vec<usize> =
        (0..model.joints.len()).filter(|&joint| model.joints[joint].kind == sim::JointKind::Hinge).collect();
    let mut list = Vec::new();
    let mut add = |id: String, motion: Motion| {
        list.push(Proposal { id, motion, seconds: design.run_s.get(), interval_s });
    };
    if design.drops && !hinges.is_empty() {
        let mut poses: Vec<Vec<f64>> = DROP_FIRST_HINGE_ANGLES_RAD
            .iter()
            .map(|&angle| (0..hinges.len()).map(|k| if k == 0 { angle } else { 0.0 }).collect())
            .collect();
        for side in [1.0, -1.0] {
            let zigzag = |k: usize| match k {
                0 => 0.9 * side,
                k if k % 2 == 1 => -DROP_BEND_RAD * side,
                _ => DROP_BEND_RAD * side,
            };
            poses.push((0..hinges.len()).map(zigzag).collect());
        }
        for (number, pose_rad) in poses.into_iter().enumerate() {
            add(format!("drop-{}", number + 1), Motion::Drop { pose_rad });
        }
    }
    if !model.actuators.is_empty() {
        let mut number = 0;
        for amplitude_rad in STROKE_AMPLITUDE_SHARES.map(|share| share * design.amplitude_limit_rad.get()) {
            for period_s in STROKE_PERIODS_S {
                let (ccw_s, cw_s) = (period_s * 2.0 / 3.0, period_s / 3.0);
                if 2.0 * amplitude_rad / cw_s <= design.rate_limit_rad_per_s.get() {
                    number += 1;
                    add(format!("driven-{number}"), Motion::Driven { amplitude_rad, ccw_s, cw_s });
                }
            }
        }
    }
    list
}

impl Proposal {
    /// `drop` or `driven`.
    pub fn kind(&self) -> &'static str {
        match self.motion {
            Motion::Drop { .. } => "drop",
            Motion::Driven { .. } => "driven",
        }
    }

    /// Instruction for the person at the rig, as a phrase.
    pub fn words(&self) -> String {
        match &self.motion {
            Motion::Drop { pose_rad } => {
                let angles: Vec<String> = pose_rad.iter().map(|angle| format!("{angle:.1}")).collect();
                format!("drop by hand from {} rad", angles.join(", "))
            }
            Motion::Driven { amplitude_rad, ccw_s, cw_s } => {
                format!("strokes of ±{amplitude_rad:.1} rad, {ccw_s:.1} s there and {cw_s:.1} s back")
            }
        }
    }

    /// Whole pairs of strokes that fit into the run.
    pub fn cycles(&self) -> u32 {
        match self.motion {
            Motion::Drop { .. } => 0,
            Motion::Driven { ccw_s, cw_s, .. } => (self.seconds / (ccw_s + cw_s)).round().max(1.0) as u32,
        }
    }

    /// The run, with the keypoints and axes that the experiment observes, all at the origin: only their times and names matter.
    pub fn run(&self, experiment: &Experiment) -> Run {
        let template = experiment.runs.first();
        let keypoints =
            template.map_or_else(|| experiment.model.keypoints(), |run| run.trajectory.keypoints.clone());
        let is_observed = |axis: usize| {
            template.is_none_or(|run| run.trajectory.position_m.iter().any(|p| p[axis].is_finite()))
        };
        let cell: [f64; 3] = std::array::from_fn(|axis| if is_observed(axis) { 0.0 } else { f64::NAN });
        let images = ((REST_BEFORE_MOTION_S + self.seconds) / self.interval_s) as usize;
        let time_s: Vec<f64> = (0..images).map(|image| image as f64 * self.interval_s).collect();
        let trajectory = Trajectory {
            position_m: vec![cell; time_s.len() * keypoints.len()],
            keypoints,
            time_s,
            std_m: None,
            pose_std_m: None,
        };
        let kind = match self.motion {
            Motion::Drop { .. } => RunKind::Drop,
            Motion::Driven { .. } => RunKind::Driven,
        };
        let mut run = Run::new(self.id.clone(), kind, trajectory);
        run.command = self.command(experiment);
        run.prescribed = template.is_some_and(|run| run.prescribed);
        run.release_s = (kind == RunKind::Drop).then_some(REST_BEFORE_MOTION_S);
        run
    }

    /// Angles commanded to the servo \[rad\]; `None` in a drop.
    pub fn command(&self, experiment: &Experiment) -> Option<Command> {
        let Motion::Driven { amplitude_rad, ccw_s, cw_s } = self.motion else { return None };
        let actuators: Vec<String> =
            experiment.model.actuators.iter().map(|actuator| actuator.name.clone()).collect();
        let centre_rad = experiment.design.centre_rad.get();
        let (mut time_s, mut angles) = (vec![0.0, REST_BEFORE_MOTION_S], vec![centre_rad; 2]);
        let mut t = REST_BEFORE_MOTION_S + ccw_s / 2.0;
        for cycle in 0..self.cycles() {
            time_s.push(t);
            angles.push(centre_rad + amplitude_rad);
            t += cw_s;
            time_s.push(t);
            angles.push(centre_rad - amplitude_rad);
            t += if cycle + 1 == self.cycles() { ccw_s / 2.0 } else { ccw_s };
        }
        time_s.push(t);
        angles.push(centre_rad);
        let angle_rad = angles.iter().flat_map(|angle| vec![*angle; actuators.len()]).collect();
        Some(Command { actuators, time_s, angle_rad })
    }

    /// How the run starts.
    pub(crate) fn start(&self, experiment: &Experiment) -> Start {
        let model = &experiment.model;
        let rest = model.rest_state();
        let mut state = State { qpos: rest.qpos.clone(), qvel: vec![0.0; model.nv()] };
        if let Motion::Drop { pose_rad } = &self.motion {
            let hinges = model.joints.iter().filter(|joint| joint.kind == sim::JointKind::Hinge);
            for (joint, angle) in hinges.zip(pose_rad) {
                state.qpos[joint.qpos_address] = joint.reference + angle;
            }
        }
        Start { state, start_s: REST_BEFORE_MOTION_S }
    }
}
