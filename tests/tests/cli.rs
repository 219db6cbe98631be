//! Verbs that need no run.

use system_tests::{changed_config, config, in_real_time, only_run, printed, repository, run_rig, set};

#[test]
fn doctor_finds_the_mock_rig_healthy() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let path = config("chain-driven-pose-1.toml");
    let output =
        run_rig(["doctor".as_ref(), path.as_os_str(), "--runs-dir".as_ref(), folder.path().as_os_str()]);
    let text = printed(&output);
    assert!(output.status.success(), "{text}");
    for subject in ["disk", "servo board", "board clock", "camera"] {
        assert!(text.contains(subject), "{text}");
    }
}

#[test]
fn doctor_looks_at_the_camera_where_the_board_is_missing() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let path = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
        set(config, "servo", "kind", "serial");
        set(config, "servo", "port", "/dev/serial/by-id/none");
    });
    let output =
        run_rig(["doctor".as_ref(), path.as_os_str(), "--runs-dir".as_ref(), folder.path().as_os_str()]);
    let text = printed(&output);
    assert_eq!(output.status.code(), Some(3), "{text}");
    for line in ["FAIL  servo board", "ok    calibration", "ok    camera"] {
        assert!(text.contains(line), "{text}");
    }
}

#[test]
fn new_mock_rig_is_healthy_at_once_and_nothing_is_written_over() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let rig = folder.path().join("mine");
    let new = |options: &[&str]| {
        let options = options.iter().map(std::ffi::OsStr::new);
        run_rig(["new".as_ref(), rig.as_os_str()].into_iter().chain(options))
    };
    let refused = new(&["--mock", "--length-m", "0.03", "--overlap-m", "0.03"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        printed(&refused).contains("--overlap-m 0.03 must be less") && !rig.exists(),
        "{}",
        printed(&refused)
    );
    let real = new(&["--real", "--overlap-m", "0.03"]);
    assert!(real.status.code() == Some(2) && !rig.exists(), "{}", printed(&real));
    let arm = new(&["--mechanism", "arm"]);
    assert!(arm.status.code() == Some(2) && printed(&arm).contains("configs/arm8.toml"), "{}", printed(&arm));

    let made = new(&["--mock", "--links", "2", "--length-m", "0.04"]);
    assert!(made.status.success() && printed(&made).contains("rig doctor"), "{}", printed(&made));
    let config = rig.join("rig.toml");
    let doctor =
        run_rig(["doctor".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), folder.path().as_os_str()]);
    assert!(doctor.status.success(), "{}", printed(&doctor));

    let before = std::fs::read_to_string(&config).expect("the config");
    let again = new(&["--mock"]);
    assert_eq!(again.status.code(), Some(2));
    assert!(printed(&again).contains("writes over nothing"), "{}", printed(&again));
    assert_eq!(std::fs::read_to_string(&config).expect("the config"), before);
}

#[test]
fn where_nothing_is_plugged_in_a_new_rig_comes_to_its_report_without_an_answer() {
    if printed(&run_rig(["list"])).matches("none found").count() < 2 {
        eprintln!("skipped: a mock rig by default (a board or a camera is plugged in)");
        return;
    }
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let (tank, runs) = (folder.path().join("tank"), folder.path().join("runs"));
    let began = std::time::Instant::now();
    let made = run_rig(["new".as_ref(), tank.as_os_str()]);
    assert!(made.status.success() && printed(&made).contains("so this is a mock rig"), "{}", printed(&made));
    let config = tank.join("rig.toml");
    let run = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    assert!(run.status.success(), "{}", printed(&run));
    assert!(only_run(&runs).expect("one run folder").join("report.html").is_file(), "{}", printed(&run));
    println!("from `rig new` to the first report: {:.1} s", began.elapsed().as_secs_f64());
}

#[test]
fn jog_moves_the_mock_servo_and_refuses_what_the_channel_cannot() {
    let _turn = in_real_time();
    let path = config("chain-driven-pose-1.toml");
    let jog = |angle: &str| {
        let path = path.as_os_str();
        let short = ["--duration-s", "0.3", "--stay-s", "0.1"].map(std::ffi::OsStr::new);
        run_rig(["jog".as_ref(), path, "--angle-rad".as_ref(), angle.as_ref()].into_iter().chain(short))
    };
    let moved = jog("0.2");
    assert!(moved.status.success() && printed(&moved).contains("1627 µs"), "{}", printed(&moved));
    let refused = jog("1.5");
    assert_eq!(refused.status.code(), Some(2));
    assert!(printed(&refused).contains("1000 to 2000 µs"), "{}", printed(&refused));
}

#[test]
fn status_says_that_nothing_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = config("chain-driven-pose-1.toml");
    let output =
        run_rig(["status".as_ref(), path.as_os_str(), "--runs-dir".as_ref(), folder.path().as_os_str()]);
    let text = printed(&output);
    assert!(
        output.status.success() && text.contains("free") && text.contains("none on a serial port"),
        "{text}"
    );
}

#[test]
fn list_and_help_work_without_any_device() {
    for verb in ["list", "--help", "--version"] {
        let output = run_rig([verb]);
        assert!(output.status.success(), "{}", printed(&output));
    }
}

#[test]
fn simulate_is_silent_in_a_pipe_and_writes_what_was_asked() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("o.csv");
    let model = repository().join("configs/models/chain-passive.xml");
    let output = run_rig([
        "simulate".as_ref(),
        model.as_os_str(),
        "--qpos".as_ref(),
        "1.5707963267948966,0,0".as_ref(),
        "--duration-s".as_ref(),
        "0.5".as_ref(),
        "--every-s".as_ref(),
        "0.1".as_ref(),
        "--out".as_ref(),
        out.as_os_str(),
    ]);
    assert!(output.status.success(), "{}", printed(&output));
    assert!(output.stderr.is_empty(), "{}", printed(&output));
    let table = std::fs::read_to_string(out).expect("the table");
    assert!(table.starts_with("time_s,q0,q1,q2,v0,v1,v2,P0_x_m,P0_y_m,P0_z_m,P1_x_m"), "{table}");
    assert_eq!(table.lines().count(), 7, "{table}");
}

#[test]
fn runs_are_listed_in_the_folder_named_either_way() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().as_os_str();
    for arguments in [
        &["runs".as_ref(), "ls".as_ref(), path][..],
        &["runs".as_ref(), "ls".as_ref(), "--runs-dir".as_ref(), path],
    ] {
        let output = run_rig(arguments.iter().copied());
        assert!(output.status.success() && printed(&output).contains("no runs yet"), "{}", printed(&output));
    }
}

#[test]
fn run_that_would_not_see_its_mechanism_is_refused_before_anything_moves() {
    let folder = tempfile::tempdir().expect("a folder");
    let runs = folder.path().join("runs");
    let origin: toml::Value = vec![3200.0, 600.0].into();
    for (key, value, told) in [
        ("metres_per_pixel", 0.25.into(), "px long in a picture of 640 x 480 px"),
        ("origin_px", origin, "begins at (3200, 600) px, so far outside of a picture of 640 x 480 px"),
    ] {
        let config = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
            set(config, "calibration", key, value);
        });
        let run = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
        assert_eq!(run.status.code(), Some(2), "{}", printed(&run));
        assert!(printed(&run).contains(told), "{}", printed(&run));
        assert_eq!(only_run(&runs), None, "nothing was filmed");
        let _turn = in_real_time();
        let doctor =
            run_rig(["doctor".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
        assert!(!doctor.status.success() && printed(&doctor).contains(told), "{}", printed(&doctor));
    }
}

#[test]
fn folder_where_an_experiment_is_wanted_is_told_with_what_makes_one() {
    let (folder, elsewhere) =
        (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let out = elsewhere.path().join("out");
    for verb in ["fit", "diagnose"] {
        let said = run_rig([verb.as_ref(), folder.path().as_os_str(), "--out".as_ref(), out.as_os_str()]);
        let text = printed(&said);
        assert_eq!(said.status.code(), Some(2), "{text}");
        assert!(text.contains("is a folder") && text.contains("rig experiment RUN..."), "{text}");
        assert!(!text.contains("os error"), "{text}");
    }
    let file = folder.path().join("recording.mcap");
    std::fs::write(&file, "").expect("a file");
    let said = run_rig(["replay".as_ref(), file.as_os_str(), "--out".as_ref(), out.as_os_str()]);
    assert!(printed(&said).contains("is a file, and a run's folder is wanted"), "{}", printed(&said));
    let said = run_rig(["doctor".as_ref(), config("").as_os_str()]);
    assert!(
        printed(&said).contains("it is a folder, and a file is wanted (did you mean"),
        "{}",
        printed(&said)
    );
}
