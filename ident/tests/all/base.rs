//! Runs of a mechanism whose base is moved while they go on.

use std::sync::Arc;

use crate::common::*;
use ident::experiment::{Method, Run, RunKind, Use};
use ident::fit::fit;
use sim::{BasePath, Command, Integrator, RolloutOptions, State, Trajectory, rollout};

/// Heaved, swayed and turned, never at rest.
fn swimming() -> Arc<BasePath> {
    let rows: Vec<f64> = (0..=60).map(|k| 0.05 * f64::from(k)).collect();
    let pose =
        |t: &f64| [-0.2 * t + 0.01 * (5.0 * t).sin(), 0.02 * (6.0 * t).cos(), 1.0 + 0.3 * (4.0 * t).sin()];
    Arc::new(BasePath::new(rows.clone(), rows.iter().map(pose).collect()).unwrap())
}

/// The chain in the middle of its motion, its first joint following `command`.
fn run(id: &str, command: Command, seed: u64) -> Run {
    let model = driven_chain();
    let times: Vec<f64> = (0..250).map(|image| f64::from(image) / FPS).collect();
    let options = RolloutOptions {
        integrator: Some(Integrator::Rk4),
        timestep_s: Some(5e-4),
        prescribed: true,
        base: Some(swimming()),
        ..RolloutOptions::default()
    };
    let start = State { qpos: vec![0.0, 0.4, -0.3], qvel: vec![0.0, 1.0, -2.0] };
    let mut filmed = rollout(&model, &start, &command, &times, &options).unwrap().trajectory();
    add_noise(&mut filmed, NOISE_M, 0.0, seed);
    // the motion is on when filming begins
    let (cut, width) = (30, filmed.keypoints.len());
    let position_m = filmed.position_m.drain(cut * width..).map(|[x, _, z]| [x, f64::NAN, z]).collect();
    let trajectory = Trajectory { time_s: filmed.time_s.split_off(cut), position_m, ..filmed };
    let (command, base) = (Some(command), Some(swimming()));
    Run { command, base, prescribed: true, ..Run::new(id, RunKind::Free, trajectory) }
}

#[test]
fn coefficients_are_recovered_from_a_base_that_swims_and_a_joint_that_is_prescribed() {
    let truth = driven_chain();
    let held_out = Run { usage: Use::Holdout, ..run("held-out", strokes(0.5, 0.7, 3.0), 12) };
    let runs = vec![run("fast", strokes(0.7, 0.5, 3.0), 11), held_out];
    let mut experiment = experiment(driven_chain(), runs, &["g2/blunt", "g3/blunt"]);
    experiment.fit.method = Method::LeastSquares;
    for name in ["g2/blunt", "g3/blunt"] {
        experiment.model.set_parameter(name, 0.2).unwrap();
    }
    let fitted = fit(&experiment, &mut ()).unwrap();
    assert_recovered(&fitted, &truth, 2);
    for parameter in &fitted.fit.parameters {
        assert!(parameter.std < 0.1 * parameter.value, "{parameter:?}");
    }
    // two coordinates of each keypoint at the noise, also where nothing was fitted but the first 0.1 s
    for run in &fitted.fit.runs {
        for keypoint in &run.keypoints {
            let noise_m = 2.0_f64.sqrt() * NOISE_M;
            assert!(keypoint.rms_error_m < 1.25 * noise_m, "{} {keypoint:?}", run.id);
        }
    }
}
