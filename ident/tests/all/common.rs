//! Synthetic runs of the chain, made with another integrator and step than a fit uses.

use ident::experiment::{Experiment, FitConfig, Run, RunKind};
use ident::fit::Fitted;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use sim::{Command, Integrator, Model, RolloutOptions, State, Trajectory, rollout};

pub(crate) const CHAIN: &str = include_str!("../data/chain.xml");
pub(crate) const NOISE_M: f64 = 4e-4;
pub(crate) const FPS: f64 = 100.0;

/// The chain with its true coefficients.
pub(crate) fn chain() -> Model {
    Model::from_mjcf(CHAIN).unwrap()
}

/// The chain with a position servo on its first joint.
pub(crate) fn driven_chain() -> Model {
    let servo =
        "</worldbody><actuator><position name=\"servo\" joint=\"q1\" kp=\"0.05\" kv=\"3e-4\"/></actuator>";
    Model::from_mjcf(&CHAIN.replace("</worldbody>", servo)).unwrap()
}

/// The same model with MuJoCo's default coefficients: what a fit knows beforehand.
pub(crate) fn guess(mut model: Model) -> Model {
    for geom in ["g1", "g2", "g3"] {
        for (name, value) in
            [("blunt", 0.5), ("slender", 0.25), ("angular", 1.5), ("kutta", 1.0), ("magnus", 1.0)]
        {
            model.set_parameter(&format!("{geom}/{name}"), value).unwrap();
        }
    }
    for joint in ["q1", "q2", "q3"] {
        model.set_parameter(&format!("{joint}/damping"), 5e-6).unwrap();
    }
    model
}

/// Films `seconds` of the motion from `state`, which is held until `start_s`: RK4 at 0.5 ms, white noise of
/// [`NOISE_M`] by `seed`.
pub(crate) fn film(
    model: &Model,
    state: &State,
    command: &Command,
    start_s: f64,
    seconds: f64,
    prescribed: bool,
    seed: u64,
) -> Trajectory {
    let mut trajectory = filmed_exactly(model, state, command, start_s, seconds, prescribed);
    add_noise(&mut trajectory, NOISE_M, 0.0, seed);
    trajectory
}

/// Adds noise to x and z: standard deviation `noise_m`, correlation `correlation` from one image to the next.
pub(crate) fn add_noise(trajectory: &mut Trajectory, noise_m: f64, correlation: f64, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let width = trajectory.keypoints.len();
    let mut before = vec![[0.0; 3]; width];
    for (cell, position) in trajectory.position_m.iter_mut().enumerate() {
        let share = if cell < width { 1.0 } else { (1.0 - correlation * correlation).sqrt() };
        for axis in [0, 2] {
            let normal: f64 = StandardNormal.sample(&mut random);
            before[cell % width][axis] = correlation * before[cell % width][axis] + share * normal;
            position[axis] += noise_m * before[cell % width][axis];
        }
    }
}

/// What a camera square to the plane sees without noise.
pub(crate) fn filmed_exactly(
    model: &Model,
    state: &State,
    command: &Command,
    start_s: f64,
    seconds: f64,
    prescribed: bool,
) -> Trajectory {
    let times: Vec<f64> = (0..(seconds * FPS) as usize).map(|i| i as f64 / FPS).collect();
    let options = RolloutOptions {
        integrator: Some(Integrator::Rk4),
        timestep_s: Some(5e-4),
        prescribed,
        start_s,
        ..RolloutOptions::default()
    };
    let mut trajectory = rollout(model, state, command, &times, &options).unwrap().trajectory();
    for position in &mut trajectory.position_m {
        // Depth is not seen.
        position[1] = f64::NAN;
    }
    trajectory
}

pub(crate) fn still(qpos: [f64; 3]) -> State {
    State { qpos: qpos.to_vec(), qvel: vec![0.0; 3] }
}

/// A drop from `qpos`, let go at `release_s`.
pub(crate) fn drop_run(
    id: &str,
    model: &Model,
    qpos: [f64; 3],
    release_s: f64,
    seconds: f64,
    seed: u64,
) -> Run {
    let trajectory = film(model, &still(qpos), &Command::default(), release_s, seconds, false, seed);
    Run { release_s: Some(release_s), ..Run::new(id, RunKind::Drop, trajectory) }
}

/// Sinusoidal strokes after 0.2 s of rest.
pub(crate) fn strokes(amplitude_rad: f64, period_s: f64, seconds: f64) -> Command {
    let times: Vec<f64> = (0..(seconds * FPS) as usize).map(|i| i as f64 / FPS).collect();
    let angle = |t: &f64| amplitude_rad * (std::f64::consts::TAU * (t - 0.2).max(0.0) / period_s).sin();
    Command { actuators: vec!["servo".into()], angle_rad: times.iter().map(angle).collect(), time_s: times }
}

/// A driven run.
pub(crate) fn driven_run(
    id: &str,
    model: &Model,
    command: Command,
    seconds: f64,
    prescribed: bool,
    seed: u64,
) -> Run {
    let trajectory = film(model, &still([0.0; 3]), &command, 0.2, seconds, prescribed, seed);
    Run { command: Some(command), prescribed, ..Run::new(id, RunKind::Driven, trajectory) }
}

/// An experiment with the coefficients fitted that the runs can see best, the others known.
pub(crate) fn experiment(model: Model, runs: Vec<Run>, parameters: &[&str]) -> Experiment {
    let fit = FitConfig {
        parameters: parameters.iter().map(|&name| name.to_owned()).collect(),
        ..FitConfig::default()
    };
    Experiment { noise_m: Some(NOISE_M), ..Experiment::new(model, fit, runs) }
}

/// Deviations from the truth in stated standard deviations: of some ten values, one beyond 3 is a 3 % chance, and
/// the fit's coarser step adds a little.
pub(crate) const MOST_SIGMA: f64 = 3.5;

/// Every parameter that is called determined lies within its deviation of the truth.
pub(crate) fn assert_recovered(fitted: &Fitted, truth: &Model, at_least: usize) {
    let mut determined = 0;
    for parameter in &fitted.fit.parameters {
        let wanted = truth.parameter(&parameter.name).unwrap();
        let sigma = (parameter.value - wanted) / parameter.std;
        println!(
            "{:14} {:11.4e} +- {:8.1e}, truth {wanted:11.4e}, {sigma:5.1} sigma, determined {}",
            parameter.name, parameter.value, parameter.std, parameter.determined
        );
        if parameter.determined {
            determined += 1;
            assert!(sigma.abs() < MOST_SIGMA, "{parameter:?}, truth {wanted}");
        }
    }
    assert!(determined >= at_least, "{determined} determined");
}
