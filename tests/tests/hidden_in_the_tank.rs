//! Causes hidden in the mock tank, filmed by `rig run`, extracted from its pictures and found by `rig diagnose`.
//!
//! Keypoints from the mock's pictures have 6 um of noise, and systematic errors of the same size, which must not count.

use std::path::{Path, PathBuf};

use system_tests::{changed_config, config, in_real_time, json, printed, run_rig, set};

/// The mechanism as it really is: the shipped model with other coefficients and dampings, and the causes at work in it.
fn tank(folder: &Path, shipped: &str, causes: &str) -> PathBuf {
    let text = std::fs::read_to_string(config("tanks").join(shipped)).expect("a shipped tank");
    let mut tank: toml::Table = text.parse().expect("a tank");
    let name = tank["model"].as_str().expect("a model").to_owned();
    let nominal = std::fs::read_to_string(config("models").join(&name)).expect("a shipped model");
    let truth = nominal
        .replace("fluidcoef=\"0.5 0.25 1.5 1 1\"", "fluidcoef=\"0.65 0.2 1.7 0.9 0.8\"")
        .replace("damping=\"1e-06\"", "damping=\"2.4e-06\"");
    assert_ne!(truth, nominal);
    std::fs::write(folder.join(&name), truth).expect("the truth can be written");
    // what is hidden shall be all that the model lacks
    for servo in tank.get_mut("servo").and_then(toml::Value::as_array_mut).into_iter().flatten() {
        let servo = servo.as_table_mut().expect("a servo");
        servo.insert("lag_s".into(), 0.0.into());
        servo.insert("period_s".into(), 0.001.into());
    }
    tank.insert("causes".into(), causes.parse::<toml::Table>().expect("causes").into());
    let path = folder.join(shipped);
    std::fs::write(&path, tank.to_string()).expect("the tank can be written");
    path
}

/// Films one run with `causes` in the tank; its folder.
fn film(folder: &Path, shipped: &str, causes: &str, change: impl FnOnce(&mut toml::Table)) -> PathBuf {
    let runs = folder.join("runs");
    let before = folders(&runs);
    let tank = tank(folder, shipped, causes);
    let config = changed_config(shipped, folder, |config| {
        set(config, "mock", "tank", tank.to_str().expect("a readable path"));
        // what a run says of itself is not asked here
        set(config, "fit", "parameters", vec!["q2/damping".to_owned()]);
        set(config, "run", "diagnose", false);
        change(config);
    });
    let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    let mut new = folders(&runs);
    new.retain(|run| !before.contains(run));
    assert_eq!(new.len(), 1, "{}", printed(&output));
    new.remove(0)
}

fn folders(runs: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(runs).into_iter().flatten();
    entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.join("start.json").exists())
        .collect()
}

/// What is said of these runs.
fn diagnosed(folder: &Path, runs: &[PathBuf], held_out: &Path, parameters: &[&str]) -> serde_json::Value {
    let path = folder.join("experiment.toml");
    let mut arguments: Vec<&std::ffi::OsStr> = vec!["experiment".as_ref()];
    arguments.extend(runs.iter().map(|run| run.as_os_str()));
    arguments.extend(["--holdout".as_ref(), held_out.as_os_str(), "--out".as_ref(), path.as_os_str()]);
    let output = run_rig(arguments);
    assert!(output.status.success(), "{}", printed(&output));
    let text = std::fs::read_to_string(&path).expect("the experiment");
    let mut experiment: toml::Table = text.parse().expect("an experiment");
    let parameters: Vec<String> = parameters.iter().map(|&name| name.to_owned()).collect();
    set(&mut experiment, "fit", "parameters", parameters);
    std::fs::write(&path, experiment.to_string()).expect("the experiment can be written");
    let out = folder.join("diagnosis");
    let output = run_rig(["diagnose".as_ref(), path.as_os_str(), "--out".as_ref(), out.as_os_str()]);
    eprintln!("{}", printed(&output));
    assert!(output.status.success(), "{}", printed(&output));
    json(&out.join("diagnosis.json"))
}

/// The causes named.
fn found(diagnosis: &serde_json::Value) -> Vec<&str> {
    let list = diagnosis["causes"].as_array().into_iter().flatten();
    list.filter_map(|cause| cause["name"].as_str()).collect()
}

/// Two drops and one held out, with `causes` in the tank.
fn drops(causes: &str) -> serde_json::Value {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let film =
        |shipped: &str| film(folder.path(), shipped, causes, |config| set(config, "run", "film_s", 1.5));
    let runs = [film("chain-passive-horizontal.toml"), film("chain-passive-right-angle.toml")];
    let held_out = film("chain-passive-hanging.toml");
    diagnosed(folder.path(), &runs, &held_out, &["fluidcoef", "damping"])
}

/// Two driven runs and one held out, with `causes` in the tank.
fn driven(causes: &str) -> serde_json::Value {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let film = |amplitude_rad: f64, ccw_s: f64| {
        film(folder.path(), "chain-driven-hanging.toml", causes, |config| {
            set(config, "profile", "amplitude_rad", amplitude_rad);
            set(config, "profile", "ccw_s", ccw_s);
            set(config, "profile", "cw_s", ccw_s / 2.0);
            set(config, "profile", "cycles", 2);
        })
    };
    let runs = [film(0.6, 0.8), film(0.4, 0.6)];
    let held_out = film(0.5, 0.7);
    diagnosed(folder.path(), &runs, &held_out, &["fluidcoef", "damping"])
}

#[test]
fn nothing_hidden_in_the_tank() {
    let diagnosis = drops("");
    assert_eq!(diagnosis["verdict"], "nothing-detectable", "{diagnosis:#}");
}

#[test]
fn added_mass_in_the_tank_is_found_in_the_pictures() {
    assert_eq!(found(&drops("added_mass = { scale = 0.8 }")), ["added_mass"]);
}

#[test]
#[ignore = "part of scripts/test --all"]
fn sweep_stiff_joints_in_the_tank_are_found_in_the_pictures() {
    assert_eq!(found(&drops("stiffness = { stiffness = 3e-5 }")), ["stiffness"]);
}

#[test]
#[ignore = "part of scripts/test --all"]
fn sweep_tether_in_the_tank_is_found_in_the_pictures() {
    assert_eq!(found(&drops("tether = { stiffness = 0.003, x = 0.06, z = 0.0 }")), ["tether"]);
}

#[test]
fn turned_camera_at_the_tank_is_found_in_the_pictures() {
    assert_eq!(found(&drops("camera_rotation = { angle = 0.02 }")), ["camera_rotation"]);
}

#[test]
#[ignore = "part of scripts/test --all"]
fn sweep_servo_of_the_tank_that_goes_too_far_is_found_in_the_pictures() {
    assert_eq!(found(&driven("servo_gain = { scale = 0.1 }")), ["servo_gain"]);
}
