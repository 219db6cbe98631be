//! Whole experiments with emulated servos on a bus, through the command line.

use std::path::{Path, PathBuf};

use system_tests::{changed_config, in_real_time, json, only_run, printed, run_rig, set};

/// One cycle on the emulated bus, changed by `change`; the exit code and the run.
fn run(folder: &Path, change: impl FnOnce(&mut toml::Table)) -> (Option<i32>, String, PathBuf) {
    let runs = folder.join("runs");
    let config = changed_config("chain-driven-bus.toml", folder, |config| {
        set(config, "profile", "cycles", 1);
        set(config, "profile", "soft_start_cycles", 0);
        set(config, "run", "diagnose", false);
        set(config, "fit", "parameters", vec!["q2/damping".to_owned()]);
        // a test machine may be busy with anything
        set(config, "servo", "max_late_ms", 2000);
        change(config);
    });
    let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    (output.status.code(), printed(&output), only_run(&runs).expect("one run folder"))
}

/// Time, commanded and measured angle of the rows that have one.
fn measured(run: &Path) -> Vec<[f64; 3]> {
    let text = std::fs::read_to_string(run.join("servo.csv")).expect("servo.csv");
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("time_s,servo_rad,servo_measured_rad"));
    let row = |line: &str| {
        let cells: Vec<Option<f64>> = line.split(',').map(|cell| cell.parse().ok()).collect();
        Some([cells[0]?, cells[1]?, cells[2]?])
    };
    lines.filter_map(row).collect()
}

#[test]
fn experiment_on_an_emulated_bus_measures_the_angle_and_replays_to_the_same_bytes() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let (code, text, run) = run(folder.path(), |_| {});
    assert_eq!(code, Some(0), "{text}");
    let measured_angles = measured(&run);
    assert!(measured_angles.len() > 100, "{} angles", measured_angles.len());
    let command = ident::table::read_command(&run.join("servo.csv")).expect("servo.csv");
    let error_rad = |lag_s: f64| {
        let squares = measured_angles.iter().map(|[t, _, angle]| (angle - command.at(0, t - lag_s)).powi(2));
        (squares.sum::<f64>() / measured_angles.len() as f64).sqrt()
    };
    println!(
        "rms behind by 0, 20, 40 ms [rad]: {:.4} {:.4} {:.4}",
        error_rad(0.0),
        error_rad(0.02),
        error_rad(0.04)
    );
    // what the emulated servo is, on a machine that may be late
    assert!(error_rad(0.02) < 0.05 && error_rad(0.02) < error_rad(0.0) && error_rad(0.02) < error_rad(0.06));
    let journal = std::fs::read_to_string(run.join("journal.jsonl")).expect("a journal");
    assert!(journal.contains("servo: stream of ") && journal.contains("least slack"), "{journal}");
    let report = std::fs::read_to_string(run.join("report.html")).expect("a report");
    assert!(report.contains("measured by the servo") && report.contains("servo feedback"));
    assert_eq!(json(&run.join("stop.json"))["servo"], "acknowledged");

    let again = folder.path().join("again");
    let output = run_rig(["replay".as_ref(), run.as_os_str(), "--out".as_ref(), again.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    for name in ["servo.csv", "trajectory.csv", "fit.json"] {
        let bytes = |folder: &Path| std::fs::read(folder.join(name)).expect(name);
        assert!(bytes(&run) == bytes(&again), "{name} differs");
    }
}

#[test]
fn servo_that_gives_up_in_mid_run_ends_it_with_its_own_words() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let (code, text, run) = run(folder.path(), |config| {
        let fault: toml::Table = "at_s = 3.2\nkind = \"servo-overload\"".parse().expect("a table");
        set(config, "mock", "faults", toml::Value::Array(vec![fault.into()]));
    });
    assert_eq!(code, Some(3), "{text}");
    let stop = json(&run.join("stop.json"));
    let reason = stop["reason"].as_str().expect("a reason");
    assert!(reason.contains("servo 1 (`servo`)") && reason.contains("overload"), "{reason}");
    assert_eq!((&stop["status"], &stop["servo"]), (&"fail".into(), &"acknowledged".into()));
}
