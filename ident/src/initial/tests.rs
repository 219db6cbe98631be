use sim::{RolloutOptions, rollout};

use super::pose::Mark;
use super::*;
use crate::noise::noise_m;

const MODEL: &str = include_str!("../../tests/data/chain.xml");
const NOISE_M: f64 = 4e-4;
const RELEASE_S: f64 = 0.3;

/// The chain let go from a bent pose, or (`Free`) filmed while it moves; `shake` adds reproducible noise.
fn run(kind: RunKind, shake: f64) -> (Model, Run, State) {
    let model = Model::from_mjcf(MODEL).unwrap();
    let state = State { qpos: vec![1.2, -0.7, 2.4], qvel: vec![0.0; 3] };
    let times: Vec<f64> = (0..120).map(|i| 0.01 * f64::from(i)).collect();
    let options = RolloutOptions { start_s: RELEASE_S, ..RolloutOptions::default() };
    let moved = rollout(&model, &state, &sim::Command::default(), &times, &options).unwrap();
    let mut trajectory = moved.trajectory();
    for (i, position) in trajectory.position_m.iter_mut().enumerate() {
        for (axis, x) in position.iter_mut().enumerate() {
            // A hash of the place: uniform, of unit variance.
            let hash = ((i * 3 + axis) as f64 * 12.9898).sin() * 43758.5453;
            *x += shake * 12f64.sqrt() * (hash - hash.floor() - 0.5);
        }
    }
    if kind == RunKind::Free {
        let truth = State { qpos: moved.qpos[180..183].to_vec(), qvel: moved.qvel[180..183].to_vec() };
        trajectory.time_s.drain(..60);
        trajectory.position_m.drain(..60 * 3);
        return (model, Run::new("free", kind, trajectory), truth);
    }
    (model, Run::new("drop", kind, trajectory), state)
}

#[test]
fn noise_is_found_despite_the_motion() {
    let (_, run, _) = run(RunKind::Drop, NOISE_M);
    let found = noise_m([&run.trajectory]);
    // The median of uniform noise differs from that of a normal one by a few percent.
    assert!((found / NOISE_M - 1.0).abs() < 0.2, "{found}");
}

#[test]
fn release_is_found_within_an_image() {
    for shake in [0.0, 0.3 * NOISE_M] {
        let (_, run, _) = run(RunKind::Drop, shake);
        let found = release(&run.trajectory, shake.max(1e-6)).unwrap();
        assert!((found.start_s - RELEASE_S).abs() < 0.01, "{found:?}");
        assert!(found.earliest_s <= RELEASE_S && found.latest_s >= RELEASE_S, "{found:?}");
    }
}

#[test]
fn a_drop_that_never_moves_has_no_release() {
    let (model, mut run, _) = run(RunKind::Drop, NOISE_M);
    run.trajectory.time_s.truncate(30);
    run.trajectory.position_m.truncate(30 * 3);
    assert_eq!(release(&run.trajectory, NOISE_M), None);
    let error = estimate(&model, &run, NOISE_M).unwrap_err().to_string();
    assert_eq!(error, "run `drop`: nothing ever moves in this drop; state `release_s`, or leave the run out");
}

#[test]
fn pose_at_rest_is_found_wherever_the_joints_are() {
    let (model, mut run, truth) = run(RunKind::Drop, NOISE_M);
    run.release_s = Some(RELEASE_S);
    let found = estimate(&model, &run, NOISE_M).unwrap();
    assert_eq!((found.start.start_s, found.release), (RELEASE_S, None));
    for (angle, wanted) in found.start.state.qpos.iter().zip(&truth.qpos) {
        // 31 images of 0.4 mm noise over links of 25 mm: 3 to 6 mrad.
        assert!((angle - wanted).abs() < 0.03, "{:?}", found.start.state.qpos);
    }
}

#[test]
fn hinges_are_not_wound_up() {
    let model = Model::from_mjcf(MODEL).unwrap();
    let angles = [-2.7, -1.7, -1.1, 0.2, 0.9, 1.8, 2.7];
    let all = angles.iter().flat_map(|&a| angles.iter().map(move |&b| (a, b)));
    for (first, second) in all {
        for third in angles {
            let wanted = [first, second, third];
            let sites = model.poses(&wanted).site_pos;
            let targets: Vec<Target> = (0..sites.len())
                .flat_map(|site| {
                    [0, 2].map(|axis| Target { mark: Mark::Site(site), axis, mean_m: sites[site].0[axis] })
                })
                .collect();
            let found = pose(&model, &targets, &[0.0; 3], &[false; 3], NOISE_M);
            for (angle, wanted) in found.iter().zip(wanted) {
                // what the noise allows of a descent that stops early
                assert!((angle - wanted).abs() < 0.1, "{found:?} {first} {second} {third}");
            }
        }
    }
}

#[test]
fn rates_of_a_moving_start_are_found() {
    let (model, run, truth) = run(RunKind::Free, 0.0);
    let found = estimate(&model, &run, 1e-6).unwrap().start;
    assert_eq!(found.start_s, run.trajectory.time_s[0]);
    for (rate, wanted) in found.state.qvel.iter().zip(&truth.qvel) {
        // A parabola over 0.1 s of a motion with periods of some 0.5 s.
        assert!((rate - wanted).abs() < 0.5, "{:?} {:?}", found.state.qvel, truth.qvel);
    }
}

#[test]
fn prescribed_joint_starts_where_its_command_is() {
    let servo = "</worldbody><actuator><position name=\"servo\" joint=\"q1\" kp=\"0.05\"/></actuator>";
    let model = Model::from_mjcf(&MODEL.replace("</worldbody>", servo)).unwrap();
    let (_, mut run, _) = run(RunKind::Drop, 0.0);
    run.kind = RunKind::Driven;
    run.prescribed = true;
    run.command = Some(sim::Command {
        actuators: vec!["servo".into()],
        time_s: vec![0.0, RELEASE_S, 1.0],
        angle_rad: vec![1.2, 1.2, 0.0],
    });
    let found = estimate(&model, &run, 1e-6).unwrap();
    assert_eq!(found.start.state.qpos[0], 1.2);
    assert_eq!(found.start.start_s, RELEASE_S);
    assert_eq!(prescribed_dofs(&model, &run), [true, false, false]);
}
