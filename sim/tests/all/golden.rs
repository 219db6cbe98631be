//! The same models move the same way in MuJoCo: runs written by MuJoCo 4.0.0 (see the file names).

use crate::common::{Table, model, stroke_command};
use sim::{Command, Integrator, RolloutOptions, rollout};

/// Sites over the whole file [m]: rounding alone gives 7e-14; another sine or square root may differ in its last
/// bit, and a swinging chain makes that grow.
const SITE_TOLERANCE_M: f64 = 1e-10;

/// The octopus at 0.25 ms, whose rounding grows a thousand times within its second [m].
const OCTOPUS_SITE_TOLERANCE_M: f64 = 1e-8;

/// Worst site difference \[m\] over the file.
fn worst(name: &str, file: &str, integrator: Integrator, timestep_s: f64, amplitude_rad: f64) -> f64 {
    let model = model(name);
    let table = Table::read(file);
    let mut state = model.rest_state();
    for (q, column) in state.qpos.iter_mut().zip(table.columns("q")) {
        *q = table.rows[0][column];
    }
    let times = table.times();
    let command = if model.actuators.is_empty() {
        Command::default()
    } else {
        stroke_command(&model, amplitude_rad, times[times.len() - 1])
    };
    let options =
        RolloutOptions { integrator: Some(integrator), timestep_s: Some(timestep_s), ..Default::default() };
    let run = rollout(&model, &state, &command, &times, &options).unwrap();
    let mut worst = 0.0_f64;
    let nq = model.nq();
    for (instant, row) in table.rows.iter().enumerate() {
        let poses = model.poses(&run.qpos[instant * nq..(instant + 1) * nq]);
        for (site, at) in model.sites.iter().zip(&poses.site_pos) {
            let columns = table.columns(&format!("{}_", site.name));
            let squared: f64 =
                columns.into_iter().zip(at.0).map(|(column, x)| (row[column] - x).powi(2)).sum();
            worst = worst.max(squared.sqrt());
            if let Some(k) = run.keypoints.iter().position(|keypoint| *keypoint == site.name) {
                assert_eq!(run.position_m[instant * run.keypoints.len() + k], at.0);
            }
        }
    }
    println!("{file}: worst site difference {worst:.2e} m over {} s", times[times.len() - 1]);
    worst
}

fn same_motion(name: &str, file: &str, integrator: Integrator, amplitude_rad: f64) {
    let worst = worst(name, file, integrator, 0.001, amplitude_rad);
    assert!(worst < SITE_TOLERANCE_M, "{file}: {worst:e}");
}

#[test]
fn passive_chain_falls_from_horizontal_as_in_mujoco() {
    same_motion("chain_passive", "chain_passive_horizontal_euler.csv", Integrator::Euler, 0.0);
}

#[test]
fn passive_chain_falls_from_a_right_angle_as_in_mujoco() {
    same_motion("chain_passive", "chain_passive_right_angle_euler.csv", Integrator::Euler, 0.0);
}

#[test]
fn driven_chain_swings_as_in_mujoco() {
    same_motion("chain_active", "chain_active_euler.csv", Integrator::Euler, 0.6);
}

#[test]
fn chain_with_friction_loss_falls_as_in_mujoco() {
    same_motion("chain_friction", "chain_friction_horizontal_euler.csv", Integrator::Euler, 0.0);
}

#[test]
fn soft_arm_swings_as_in_mujoco() {
    same_motion("arm8", "arm8_euler.csv", Integrator::Euler, 0.6);
}

#[test]
fn implicitfast_moves_chains_and_arm_as_in_mujoco() {
    let integrator = Integrator::ImplicitFast;
    same_motion("chain_passive", "chain_passive_horizontal_implicitfast.csv", integrator, 0.0);
    same_motion("chain_active", "chain_active_implicitfast.csv", integrator, 0.6);
    same_motion("arm8", "arm8_implicitfast.csv", integrator, 0.6);
}

#[test]
fn octopus_swims_as_in_mujoco() {
    same_motion("octopus8", "octopus8_implicitfast.csv", Integrator::ImplicitFast, 0.5);
    same_motion("octopus8", "octopus8_euler.csv", Integrator::Euler, 0.5);
    let worst = worst("octopus8", "octopus8_euler_0.25ms.csv", Integrator::Euler, 0.00025, 0.5);
    assert!(worst < OCTOPUS_SITE_TOLERANCE_M, "{worst:e}");
}

/// Why its Euler run at 1 ms is compared over 0.1 s only.
#[test]
fn euler_at_a_millisecond_makes_a_rounding_error_of_the_octopus_a_tenth_of_a_millimetre() {
    let model = model("octopus8");
    let command = stroke_command(&model, 0.5, 1.0);
    let run = |timestep_s: f64, aside: f64| {
        let mut state = model.rest_state();
        state.qvel[8] += aside;
        let options = RolloutOptions {
            integrator: Some(Integrator::Euler),
            timestep_s: Some(timestep_s),
            ..Default::default()
        };
        let run = rollout(&model, &state, &command, &[1.0], &options).unwrap();
        model.poses(&run.qpos).site_pos
    };
    let apart = |timestep_s: f64| {
        let pairs = run(timestep_s, 0.0).into_iter().zip(run(timestep_s, 1e-12));
        pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    };
    let (coarse_m, fine_m) = (apart(0.001), apart(0.00025));
    println!("1e-12 rad/s aside: {coarse_m:.1e} m after 1 s of Euler at 1 ms, {fine_m:.1e} m at 0.25 ms");
    assert!(coarse_m > 1e-4 && fine_m < 1e-9, "{coarse_m:e} {fine_m:e}");
}
