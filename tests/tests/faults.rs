//! Devices that die, stall or lie in the middle of a run: the servo stops, the run stays readable and says why, and the
//! exit code is 3.

use std::path::{Path, PathBuf};

use rustix::process::Signal;
use system_tests::outside::{Outside, journal_holds};
use system_tests::{
    Background, changed_config, in_real_time, json, only_run, printed, run_rig, set, wait_until,
};

const CONFIG: &str = "chain-driven-pose-1.toml";

fn assert_incomplete(run: &Path, status: &str, reason: &str) {
    let stop = json(&run.join("stop.json"));
    assert_eq!(stop["status"], status, "{stop}");
    assert!(stop["reason"].as_str().expect("a reason").contains(reason), "{stop}");
    // What was recorded before the fault is readable.
    let recording = record::reader::Recording::open(&run.join("recording.mcap")).expect("a recording");
    let images = recording.filter(|item| matches!(item, Ok((_, record::reader::Item::Image(_))))).count();
    assert!(images > 20, "{images} images");
    let shown = run_rig(["runs".as_ref(), "show".as_ref(), run.as_os_str()]);
    assert!(shown.status.success() && printed(&shown).contains(reason), "{}", printed(&shown));
}

/// Plays one fault in process and gives back the run.
fn with_fault(kind: &str, folder: &Path) -> PathBuf {
    let runs = folder.join("runs");
    let config = changed_config(CONFIG, folder, |config| {
        let fault: toml::Table = format!("at_s = 3.5\nkind = \"{kind}\"").parse().expect("a table");
        set(config, "mock", "faults", toml::Value::Array(vec![fault.into()]));
    });
    let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    assert_eq!(output.status.code(), Some(3), "{kind}: {}", printed(&output));
    only_run(&runs).expect("one run folder")
}

#[test]
fn each_fault_in_process_ends_in_the_safe_stop_with_its_reason() {
    let _turn = in_real_time();
    let faults = [
        ("board-off", "lost"),
        ("board-stuck", "lost"),
        ("board-garbage", "lost"),
        ("board-reset", "restarted"),
        ("camera-off", "gone"),
        ("camera-slow", "no image for"),
        ("camera-stuck", "frozen"),
    ];
    for (kind, reason) in faults {
        let folder = tempfile::tempdir().expect("a folder");
        let run = with_fault(kind, folder.path());
        assert_incomplete(&run, "fail", reason);
        assert!(journal_holds(&run, "stopped"));
    }
}

fn exit_code(process: &mut Background) -> Option<i32> {
    let mut code = None;
    wait_until("the end of rig run", 20.0, || {
        code = process.child().try_wait().expect("its status").map(|status| status.code());
        code.is_some()
    });
    code.flatten()
}

#[test]
fn killed_board_process_leaves_a_readable_run_and_exit_code_3() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let outside = Outside::new(CONFIG, folder.path());
    let mut running = outside.start();
    let run = outside.wait_for_motion();
    outside.board.signal(Signal::KILL);
    assert_eq!(exit_code(&mut running), Some(3));
    assert_incomplete(&run, "fail", "lost");
}

#[test]
fn stalled_camera_process_stops_the_servo() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let outside = Outside::new(CONFIG, folder.path());
    let mut running = outside.start();
    let run = outside.wait_for_motion();
    outside.camera.signal(Signal::STOP);
    assert_eq!(exit_code(&mut running), Some(3));
    assert_incomplete(&run, "fail", "no image for");
    assert_eq!(json(&run.join("stop.json"))["servo"], "acknowledged");
    assert_eq!(outside.last_pulse(), None, "the servo still gets pulses");
}

#[test]
fn killed_rig_leaves_the_servo_to_the_dead_man_and_a_run_that_is_readable() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let outside = Outside::new(CONFIG, folder.path());
    let running = outside.start();
    let run = outside.wait_for_motion();
    running.signal(Signal::KILL);
    // The dead-man's time in tests, and a margin.
    wait_until("the dead-man", 4.0, || outside.last_pulse().is_none());
    assert!(!run.join("stop.json").exists());
    let listed = run_rig(["runs".as_ref(), "ls".as_ref(), "--runs-dir".as_ref(), outside.runs.as_os_str()]);
    assert!(printed(&listed).contains("incomplete"), "{}", printed(&listed));
}

#[test]
fn sigterm_stops_the_servo_first_and_marks_the_run_aborted() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let outside = Outside::new(CONFIG, folder.path());
    let mut running = outside.start();
    let run = outside.wait_for_motion();
    let told = std::time::Instant::now();
    running.signal(Signal::TERM);
    wait_until("the servo's stop", 2.0, || outside.last_pulse().is_none());
    println!("servo stopped {:.0} ms after SIGTERM", told.elapsed().as_secs_f64() * 1e3);
    assert_eq!(exit_code(&mut running), Some(130));
    assert_eq!(json(&run.join("stop.json"))["status"], "abort");
    assert_eq!(json(&run.join("stop.json"))["servo"], "acknowledged");
}

#[test]
fn estop_from_beside_a_running_rig_stops_it() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let outside = Outside::new(CONFIG, folder.path());
    let mut running = outside.start();
    outside.wait_for_motion();
    let output = run_rig(["estop".as_ref(), outside.config.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    assert_eq!(outside.last_pulse(), None);
    assert_eq!(exit_code(&mut running), Some(130));
}
