//! Whole experiments on the mock rig, through the command line.

use std::path::Path;

use system_tests::soft_arm::bend_degrees;
use system_tests::{changed_config, config, in_real_time, json, only_run, printed, run_rig, set};

/// Mean keypoint error that the fit must reach, as a share of the mechanism's length: the paper's own bar.
const MAX_ERROR_SHARE: f64 = 0.05;

fn mean_errors_m(fit: &serde_json::Value) -> Vec<f64> {
    let keypoints = fit["runs"][0]["keypoints"].as_array().expect("keypoints");
    keypoints.iter().map(|keypoint| keypoint["mean_error_m"].as_f64().expect("a number")).collect()
}

fn assert_same_bytes(a: &Path, b: &Path) {
    let bytes =
        |path: &Path| std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert!(bytes(a) == bytes(b), "{} and {} differ", a.display(), b.display());
}

#[test]
fn driven_run_ends_in_a_report_and_replays_to_the_same_bytes() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let runs = folder.path().join("runs");
    let config = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
        // Not one cycle: enough motion to learn the empty tank from is over well before the end, and time left for a fit.
        set(config, "profile", "cycles", 4);
        set(config, "profile", "soft_start_cycles", 0);
        set(config, "fit", "max_evaluations", 300);
        // a search that is cut short ends where the machine had come to; a few causes make one that is soon over
        set(config, "diagnose", "limit_s", 600.0);
        let sought = ["servo_lag", "servo_delay", "camera_delay", "added_mass", "buoyancy"];
        let others = sim::Cause::ALL.iter().map(|cause| cause.name()).filter(|name| !sought.contains(name));
        set(config, "diagnose", "exclude", others.map(str::to_owned).collect::<Vec<_>>());
    });
    let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    let run = only_run(&runs).expect("one run folder");
    for command in printed(&output).lines().filter_map(|line| line.strip_prefix("  rig ")) {
        let mut paths = command.split(' ').filter(|word| word.starts_with('/'));
        assert!(paths.all(|path| Path::new(path).exists()), "a command that cannot be typed: rig {command}");
    }
    for name in [
        "start.json",
        "journal.jsonl",
        "recording.mcap",
        "frames.csv",
        "servo.csv",
        "extraction.jsonl",
        "trajectory.csv",
        "fit.json",
        "model.xml",
        "diagnosis.json",
        "timing.json",
        "report.html",
    ] {
        assert!(run.join(name).exists(), "{name} is missing\n{}", printed(&output));
    }
    let stop = json(&run.join("stop.json"));
    assert_eq!(stop["status"], "success");
    assert!(stop["learn_from"]["end"].is_u64(), "extracted while it was filmed: {stop}");
    // only there if the machine had the time
    let began = run.join("warm-start.json").exists().then_some("warm-start.json");
    println!("began with {began:?}");
    let fit = json(&run.join("fit.json"));
    let errors = mean_errors_m(&fit);
    println!("mean keypoint errors [mm]: {:?}", errors.iter().map(|e| e * 1e3).collect::<Vec<_>>());
    assert!(errors.iter().all(|&error| error < MAX_ERROR_SHARE * 0.08), "{errors:?}");

    let again = folder.path().join("again");
    let output = run_rig([
        "replay".as_ref(),
        run.as_os_str(),
        "--out".as_ref(),
        again.as_os_str(),
        "--threads".as_ref(),
        "1".as_ref(),
    ]);
    assert!(output.status.success(), "{}", printed(&output));
    for name in ["frames.csv", "servo.csv", "trajectory.csv", "fit.json", "model.xml", "diagnosis.json"] {
        assert_same_bytes(&run.join(name), &again.join(name));
    }

    for stage in ["mask", "keypoints", "trajectory"] {
        let redone = folder.path().join(stage);
        let (from, out) =
            (["--from", stage].map(std::ffi::OsStr::new), ["--out".as_ref(), redone.as_os_str()]);
        let output = run_rig(["replay".as_ref(), run.as_os_str()].into_iter().chain(from).chain(out));
        assert!(output.status.success(), "from {stage}: {}", printed(&output));
        for name in ["trajectory.csv", "fit.json", "diagnosis.json"].into_iter().chain(began) {
            assert_same_bytes(&run.join(name), &redone.join(name));
        }
    }

    let experiment = folder.path().join("experiment.toml");
    let output = run_rig(["experiment".as_ref(), run.as_os_str(), "--out".as_ref(), experiment.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    let output = run_rig(["runs", "ls", "--runs-dir", runs.to_str().expect("a readable path")]);
    assert!(printed(&output).contains("success"), "{}", printed(&output));
}

#[test]
fn devices_of_a_recorded_run_make_the_same_run_again() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let film = |runs: &Path, change: &dyn Fn(&mut toml::Table)| {
        let config = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
            set(config, "profile", "cycles", 1);
            set(config, "profile", "soft_start_cycles", 0);
            set(config, "run", "diagnose", false);
            set(config, "fit", "parameters", vec!["q2/damping".to_owned()]);
            // what films of a mock tank are taken by, and nobody knows of a replayed one
            set(config, "vision", "segmenter", "classical");
            change(config);
        });
        run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()])
    };
    let command = |run: &Path| ident::table::read_command(&run.join("servo.csv")).expect("servo.csv");
    let (first, second) = (folder.path().join("first"), folder.path().join("second"));
    let output = film(&first, &|_| {});
    assert!(output.status.success(), "{}", printed(&output));
    let first = only_run(&first).expect("one run folder");
    let replayed = |config: &mut toml::Table| {
        config.remove("mock");
        set(config, "servo", "kind", "replay");
        set(config, "camera", "kind", "replay");
        set(config, "replay", "run", first.to_str().expect("a readable path"));
    };
    let output = film(&second, &replayed);
    assert!(output.status.success(), "{}", printed(&output));
    let second = only_run(&second).expect("one run folder");
    let read =
        |run: &Path| ident::table::read_trajectory(&run.join("trajectory.csv")).expect("trajectory.csv");
    let (then, now) = (read(&first), read(&second));
    let rows = then.time_s.len().min(now.time_s.len());
    // When the last image was wanted is a matter of milliseconds.
    assert!(then.time_s.len().abs_diff(now.time_s.len()) < 20, "{rows} rows in common");
    assert_eq!(then.time_s[..rows], now.time_s[..rows]);
    let keypoints = then.keypoints.len();
    for (then, now) in then.position_m.iter().zip(&now.position_m).take(rows * keypoints) {
        // The empty tank is learned from another sample where the images are one more.
        let near = (then[0] - now[0]).hypot(then[2] - now[2]) < 1e-4;
        assert!(near || then[0].is_nan() && now[0].is_nan(), "{then:?} {now:?}");
    }
    let (then, now) = (command(&first), command(&second));
    assert_eq!((then.actuators, then.angle_rad), (now.actuators, now.angle_rad));
    // The last ping comes or not, as the last image does. One is good to 20 µs and is one of a hundred.
    assert_eq!(then.time_s.len(), now.time_s.len());
    for (then, now) in then.time_s.iter().zip(&now.time_s) {
        assert!((then - now).abs() < 2e-6, "{then} s, {now} s");
    }

    let output = film(&folder.path().join("third"), &|config| {
        replayed(config);
        set(config, "profile", "amplitude_rad", 0.3);
    });
    assert_eq!(output.status.code(), Some(3), "{}", printed(&output));
    assert!(printed(&output).contains("played another profile"), "{}", printed(&output));
}

#[test]
fn counter_clockwise_command_is_counter_clockwise_in_the_picture() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let runs = folder.path().join("runs");
    let config = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
        set(config, "profile", "cycles", 1);
        set(config, "profile", "soft_start_cycles", 0);
        set(config, "fit", "parameters", vec!["q2/damping".to_owned()]);
        set(config, "run", "diagnose", false);
    });
    let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    let run = only_run(&runs).expect("one run folder");
    let command = ident::table::read_command(&run.join("servo.csv")).expect("servo.csv");
    let trajectory = ident::table::read_trajectory(&run.join("trajectory.csv")).expect("trajectory.csv");
    let (p0, p1) = (trajectory_index(&trajectory, "P0"), trajectory_index(&trajectory, "P1"));
    // z points up and x to the right in the picture, so atan2(z, x) grows counter-clockwise as the camera sees it.
    let direction = |instant: usize| {
        let ([x0, _, z0], [x1, _, z1]) = (trajectory.at(instant, p0), trajectory.at(instant, p1));
        (z1 - z0).atan2(x1 - x0)
    };
    let rest = direction(0);
    let pairs: Vec<(f64, f64)> = (0..trajectory.time_s.len())
        .map(|i| {
            (
                command.at(0, trajectory.time_s[i]),
                (direction(i) - rest + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
                    - std::f64::consts::PI,
            )
        })
        .filter(|(_, seen)| seen.is_finite())
        .collect();
    let (upper, lower) =
        pairs.iter().fold((f64::MIN, f64::MAX), |(u, l), &(_, seen)| (u.max(seen), l.min(seen)));
    let agreement: f64 = pairs.iter().map(|(commanded, seen)| commanded * seen).sum();
    let size: f64 = pairs.iter().map(|(commanded, _)| commanded * commanded).sum();
    let gain = agreement / size;
    println!("picture angle per commanded angle: {gain:.4}; seen from {lower:.3} to {upper:.3} rad");
    assert!((0.95..1.05).contains(&gain), "gain {gain}");

    // The counter-clockwise stroke lasts twice the clockwise one.
    let top = command.time_s[1] - command.time_s[0];
    let down = command.time_s[2] - command.time_s[1];
    assert!((2.0 * top / down - 2.0).abs() < 1e-3, "{:?}", command.time_s);
}

fn trajectory_index(trajectory: &sim::Trajectory, name: &str) -> usize {
    trajectory
        .keypoints
        .iter()
        .position(|keypoint| keypoint == name)
        .unwrap_or_else(|| panic!("no keypoint {name}"))
}

#[test]
fn drop_waits_for_still_water_asks_for_the_release_and_is_fitted() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let runs = folder.path().join("runs");
    let config = changed_config("chain-passive-horizontal.toml", folder.path(), |config| {
        set(config, "run", "film_s", 2.0);
        set(config, "fit", "max_evaluations", 300);
    });
    let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    assert!(printed(&output).contains("let go"), "{}", printed(&output));
    let run = only_run(&runs).expect("one run folder");
    let errors = mean_errors_m(&json(&run.join("fit.json")));
    println!("mean keypoint errors [mm]: {:?}", errors.iter().map(|e| e * 1e3).collect::<Vec<_>>());
    assert!(errors.iter().all(|&error| error < MAX_ERROR_SHARE * 0.08), "{errors:?}");
}

#[test]
fn soft_arm_runs_in_arc_mode() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let runs = folder.path().join("runs");
    let config = changed_config("arm8.toml", folder.path(), |config| {
        set(config, "profile", "cycles", 1);
        set(config, "profile", "soft_start_cycles", 0);
        set(config, "fit", "max_evaluations", 60);
    });
    let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    let run = only_run(&runs).expect("one run folder");
    let errors = mean_errors_m(&json(&run.join("fit.json")));
    println!("mean keypoint errors [mm]: {:?}", errors.iter().map(|e| e * 1e3).collect::<Vec<_>>());
    // The arm is 160 mm long.
    assert!(errors.iter().all(|&error| error < MAX_ERROR_SHARE * 0.16), "{errors:?}");
    let filmed = ident::table::read_trajectory(&run.join("trajectory.csv")).expect("keypoints");
    let command = ident::table::read_command(&run.join("servo.csv")).expect("a command");
    let [slow, quick] = [true, false].map(|rising| bend_degrees(&filmed, &command, rising));
    println!("bend in the slow stroke {slow:.1}, in the quick one {quick:.1} degrees");
    assert!(slow < -12.0, "{slow}: the slow stroke bends the arm");
    assert!(quick.abs() < 0.4 * slow.abs(), "{quick} of {slow}: the quick one leaves it straighter");
}

#[test]
fn json_mode_prints_exactly_one_object() {
    let output = run_rig(["--json", "run", "no-such-config.toml"]);
    assert_eq!(output.status.code(), Some(2), "{}", printed(&output));
    let object: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(object["status"], "input-error");
    assert!(object["error"].as_str().expect("a text").contains("no-such-config.toml"));
    assert!(config("chain-driven-pose-1.toml").exists());
}
