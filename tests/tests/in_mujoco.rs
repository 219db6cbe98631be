//! What a fit found is what MuJoCo itself does with it.

use std::process::Command;

use system_tests::{changed_config, in_real_time, json, only_run, printed, repository, run_rig, set};

#[test]
fn a_fitted_run_has_the_same_errors_in_mujoco() {
    let Some(python) = std::env::var_os("RIG_PYTHON") else {
        eprintln!("skipped: RIG_PYTHON names no Python with mujoco and numpy");
        return;
    };
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let runs = folder.path().join("runs");
    let config = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
        set(config, "profile", "cycles", 1);
        set(config, "profile", "soft_start_cycles", 0);
        set(config, "run", "diagnose", false);
    });
    let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    let run = only_run(&runs).expect("one run folder");
    let script = repository().join("scripts/in-mujoco.py");
    let replayed = Command::new(python).arg(script).arg(&run).output().expect("Python starts");
    let text = printed(&replayed);
    assert!(replayed.status.success(), "{text}");
    let fit = json(&run.join("fit.json"));
    let keypoints = fit["runs"][0]["keypoints"].as_array().expect("keypoints");
    assert_eq!(keypoints.len(), 4);
    for keypoint in keypoints {
        let name = keypoint["name"].as_str().expect("a name");
        let line = text.lines().find_map(|line| line.strip_prefix(&format!("{name} ")));
        let theirs: f64 = line.expect("a line for each keypoint").trim().parse().expect("metres");
        let ours = keypoint["rms_error_m"].as_f64().expect("metres");
        // Three digits, as printed: half a unit of the last one at most, and as much for the step.
        assert!((theirs / ours - 1.0).abs() < 6e-3, "{name}: {ours} m, in MuJoCo {theirs} m");
    }
}
