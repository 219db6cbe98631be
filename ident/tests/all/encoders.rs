//! Angles of encoders, beside keypoints or alone.

use std::path::Path;

use crate::common::{CHAIN, FPS, chain, still};
use ident::diagnose::{Verdict, diagnose};
use ident::experiment::{Experiment, Use};
use ident::fit::fit;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use sim::model::POINTER_M;
use sim::{Command, Integrator, RolloutOptions, rollout};

const START_S: f64 = 0.3;
/// Noise of an encoder of 16,384 steps a turn, about.
const NOISE_RAD: f64 = 2e-4;
const JOINTS: [&str; 3] = ["q1", "q2", "q3"];

/// A drop as encoders read it, whose zeros are off by `zeros`: the text of a table.
fn read(pose: [f64; 3], zeros: [f64; 3], seed: u64) -> String {
    let times: Vec<f64> = (0..(2.5 * FPS) as usize).map(|i| i as f64 / FPS).collect();
    let options = RolloutOptions {
        integrator: Some(Integrator::Rk4),
        timestep_s: Some(5e-4),
        start_s: START_S,
        ..RolloutOptions::default()
    };
    let moved = rollout(&chain(), &still(pose), &Command::default(), &times, &options).unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut text = String::from("time_s,q1_rad,q2_rad,q3_rad\n");
    for (time_s, angles) in times.iter().zip(moved.qpos.chunks(3)) {
        text.push_str(&time_s.to_string());
        for (angle, zero) in angles.iter().zip(zeros) {
            let noise: f64 = StandardNormal.sample(&mut random);
            text.push_str(&format!(",{}", angle + zero + NOISE_RAD * noise));
        }
        text.push('\n');
    }
    text
}

/// Drops in a folder as somebody would have them: the last one is held out.
fn experiment(folder: &Path, zeros: [f64; 3]) -> Experiment {
    let before = ["0.6 0.2 1.6 0.9 0.8", "0.75 0.15 1.2 1.1 0.6", "0.5 0.3 2 0.7 1"];
    let guessed = before.iter().fold(CHAIN.to_owned(), |text, c| text.replace(c, "0.5 0.25 1.5 1 1"));
    std::fs::write(folder.join("chain.xml"), guessed.replace("2e-6", "5e-6")).unwrap();
    let mut text = String::from("model = \"chain.xml\"\n[fit]\nparameters = [\"fluidcoef\", \"damping\"]\n");
    // one goes over the top: encoders count turns
    for (place, pose) in
        [[1.5, 0.0, 0.0], [0.9, -1.2, 1.2], [-1.1, 0.3, -0.9], [3.6, 0.8, -1.3]].iter().enumerate()
    {
        std::fs::write(folder.join(format!("{place}.csv")), read(*pose, zeros, place as u64)).unwrap();
        let usage = if place < 3 { "fit" } else { "holdout" };
        text.push_str(&format!(
            "[[run]]\nid = \"drop-{place}\"\nkind = \"drop\"\ntrajectory = \"{place}.csv\"\nrelease_s = {START_S}\nuse = \"{usage}\"\n"
        ));
    }
    let path = folder.join("experiment.toml");
    std::fs::write(&path, text).unwrap();
    Experiment::read(&path).unwrap()
}

#[test]
fn angles_alone_tell_the_coefficients_and_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let experiment = experiment(folder.path(), [0.0; 3]);
    let fitted = fit(&experiment, &mut ()).unwrap();
    let truth = chain();
    for parameter in fitted.fit.parameters.iter().filter(|parameter| parameter.determined) {
        let off = (parameter.value - truth.parameter(&parameter.name).unwrap()) / parameter.std;
        println!("{} {} {off:+.1}", parameter.name, parameter.value);
        assert!(off.abs() < 4.0, "{parameter:?}");
    }
    let wide = fitted.runs.iter().find(|run| run.id == "drop-3").unwrap();
    assert!((wide.initial.qpos[0] - 3.6).abs() < 3e-3, "{:?}", wide.initial);
    for run in &fitted.fit.runs {
        // the one held out starts near the top, where a little becomes much
        let most = if run.usage == Use::Fit { 1.5 } else { 15.0 };
        for keypoint in &run.keypoints {
            assert!(keypoint.rms_error_m < most * POINTER_M * NOISE_RAD, "{run:?}");
        }
    }
    let text = fitted.to_mjcf("test");
    for joint in JOINTS {
        assert!(!text.contains(&format!("{joint}_rad")), "encoders are no part of a model");
    }
    assert!(text.contains("<key name=\"drop-3\" qpos=\"3."), "{text}");
}

#[test]
fn an_encoder_that_is_askew_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let diagnosed = diagnose(&experiment(folder.path(), [0.0, 0.015, 0.0]), &mut ()).unwrap();
    println!("{}", diagnosed.diagnosis.sentence);
    assert_eq!(diagnosed.diagnosis.verdict, Verdict::Cause, "{:#?}", diagnosed.diagnosis);
    let cause = &diagnosed.diagnosis.causes[0];
    assert_eq!(cause.label(), "joint_zero/q2");
    let [low, high] = cause.parameters[0].ci95.unwrap();
    assert!(low < 0.015 && 0.015 < high, "{cause:?}");
}

#[test]
fn an_encoder_on_no_hinge_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("0.csv");
    experiment(folder.path(), [0.0; 3]);
    let text = std::fs::read_to_string(&table).unwrap().replace("q3_rad", "q4_rad");
    std::fs::write(&table, text).unwrap();
    let error = Experiment::read(&folder.path().join("experiment.toml")).unwrap_err();
    let error = format!("{error:?}");
    assert!(error.contains("angles of `q4`") && error.contains("`q4_rad`"), "{error}");
}
