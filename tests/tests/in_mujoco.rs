//! What a fit found is what MuJoCo itself does with it.

use std::path::{Path, PathBuf};
use std::process::Command;

use system_tests::python::python;
use system_tests::{changed_config, in_real_time, json, only_run, printed, repository, run_rig, set};

#[test]
fn a_fitted_run_has_the_same_errors_in_mujoco() {
    same_errors("chain-driven-pose-1.toml", 4);
}

#[test]
fn an_arm_whose_springs_mjcf_cannot_hold_has_the_same_errors_in_mujoco() {
    same_errors("arm8.toml", 3);
}

#[test]
fn the_page_for_python_users_does_what_it_shows() {
    let Some(python) = python("the page for Python users", &["pandas", "mujoco", "tankrig"]) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let run = filmed("chain-driven-pose-1.toml", folder.path());
    let page = std::fs::read_to_string(repository().join("docs/python.md")).expect("the page");
    let blocks: Vec<&str> = page
        .split("```python\n")
        .skip(1)
        .map(|rest| rest.split("```").next().expect("a block ends"))
        .collect();
    assert!(blocks.len() >= 6, "{} blocks", blocks.len());
    let shown = "20261125T231151Z-5vwmp6";
    let own = run.file_name().expect("a run has a name").to_string_lossy();
    let script = folder.path().join("page.py");
    std::fs::write(&script, blocks.concat().replace(shown, &own)).expect("written");
    let output =
        Command::new(python).arg(&script).current_dir(folder.path()).output().expect("Python starts");
    assert!(output.status.success(), "{}", printed(&output));
    // what it prints at the end is where MuJoCo has the sites
    assert!(printed(&output).contains("'P3': array("), "{}", printed(&output));
    let [experiment, out] = ["mine.toml", "fitted-again"].map(|name| folder.path().join(name));
    let experiment = experiment.as_os_str();
    // the page's run stands beside its own folder
    let text = std::fs::read_to_string(experiment).expect("the page wrote it");
    assert!(text.contains("runs/"), "{text}");
    let output = run_rig(["fit".as_ref(), experiment, "--out".as_ref(), out.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
}

/// A run of the shipped config `shipped`, of one stroke each way, below `folder`.
fn filmed(shipped: &str, folder: &Path) -> PathBuf {
    let _turn = in_real_time();
    let runs = folder.join("runs");
    let config = changed_config(shipped, folder, |config| {
        set(config, "profile", "cycles", 1);
        set(config, "profile", "soft_start_cycles", 0);
        set(config, "run", "diagnose", false);
    });
    let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    only_run(&runs).expect("one run folder")
}

/// Runs the shipped config `shipped` for a stroke or two, and the model that was fitted in MuJoCo.
fn same_errors(shipped: &str, points: usize) {
    let Some(python) = python("a fit in MuJoCo", &["mujoco", "numpy"]) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let run = filmed(shipped, folder.path());
    let script = repository().join("scripts/in-mujoco.py");
    let replayed = Command::new(python).arg(script).arg(&run).output().expect("Python starts");
    let text = printed(&replayed);
    assert!(replayed.status.success(), "{text}");
    let fit = json(&run.join("fit.json"));
    let keypoints = fit["runs"][0]["keypoints"].as_array().expect("keypoints");
    assert_eq!(keypoints.len(), points);
    for keypoint in keypoints {
        let name = keypoint["name"].as_str().expect("a name");
        let line = text.lines().find_map(|line| line.strip_prefix(&format!("{name} ")));
        let theirs: f64 = line.expect("a line for each keypoint").trim().parse().expect("metres");
        let ours = keypoint["rms_error_m"].as_f64().expect("metres");
        // Three digits, as printed: half a unit of the last one at most, and as much for the step; and of the 0.01 mm to which a fit plans
        // its own steps what shows in a mean of squares.
        assert!((theirs - ours).abs() < 6e-3 * ours + 2e-6, "{name}: {ours} m, in MuJoCo {theirs} m");
    }
}
