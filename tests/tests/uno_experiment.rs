//! A whole experiment with the firmware that is flashed: the Uno's binary in an emulator of its chip is the servo board, and the pulses at
//! its pin drive the servo in the mock tank that the camera looks at.

use std::io::Read as _;
use std::time::Duration;

use servo::PulseSink as _;
use servo::pulse_log::PulseLogWriter;
use system_tests::{
    Background, changed_config, config, in_real_time, json, only_run, printed, rig, set, uno, wait_until,
};

const CONFIG: &str = "chain-driven-pose-1.toml";

#[test]
#[ignore = "an experiment in wall time beside an emulated chip wants a quiet machine; run it alone, with --ignored --nocapture"]
fn the_flashed_binary_drives_a_whole_experiment() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let (port, edges) = (at.join("uno"), at.join("edges"));
    if !uno::build(at) {
        eprintln!("skipped: apt-get install gcc-avr avr-libc libsimavr-dev libelf-dev");
        return;
    }
    let _board = uno::start(at, &port, &edges);
    let tank = at.join("tank");
    std::fs::create_dir(&tank).expect("a folder");
    let shipped = config("tanks/chain-driven-pose-1.toml");
    let mut table: toml::Table = std::fs::read_to_string(&shipped).expect("the tank").parse().expect("TOML");
    let model = shipped.with_file_name(table["model"].as_str().expect("a model"));
    table.insert("model".into(), model.to_str().expect("text").into());
    std::fs::write(tank.join("tank.toml"), table.to_string()).expect("a tank");

    let _camera = Background::start(rig(["mock-camera".as_ref(), "--tank".as_ref(), tank.as_os_str()]));
    wait_until("board and camera", 10.0, || port.exists() && tank.join("camera.sock").exists());
    let log = tank.join("servo.log");
    let (mut servo, mut told) = (uno::Servo::default(), std::fs::File::open(edges).expect("edges"));
    let mut pulses = PulseLogWriter::append(&log).expect("a log");
    std::thread::spawn(move || {
        loop {
            let mut text = String::new();
            // the folder may be gone when the test is over
            let _ = told.read_to_string(&mut text);
            for (at, pulse_us) in servo.hear(&text) {
                pulses.pulse(0, pulse_us, at);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    });

    let own = changed_config(CONFIG, at, |config| {
        config.remove("mock");
        set(config, "servo", "kind", "serial");
        set(config, "servo", "port", port.to_str().expect("text"));
        set(config, "camera", "kind", "socket");
        set(config, "camera", "tank", tank.to_str().expect("text"));
        set(config, "profile", "cycles", 3);
    });
    let runs = at.join("runs");
    let output = rig(["run".as_ref(), own.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()])
        .output()
        .expect("rig starts");
    eprintln!("{}", printed(&output));
    assert!(output.status.success());
    let run = only_run(&runs).expect("one run");
    let fit = json(&run.join("fit.json"));
    for keypoint in fit["runs"][0]["keypoints"].as_array().expect("keypoints") {
        // the servo gets a pulse every 20 ms, the model's follows straight lines: 20 mrad and more at the first hinge
        assert!(keypoint["mean_error_m"].as_f64().is_some_and(|error_m| error_m < 3e-3), "{keypoint}");
    }
    // by the end the board has been parked or let go, and says nothing more
    let pulses = std::fs::read_to_string(log).expect("pulses");
    let widths: Vec<u32> = pulses.lines().filter_map(|line| line.rsplit(',').next()?.parse().ok()).collect();
    let ends = [widths.iter().min(), widths.iter().max()].map(|width| *width.expect("a pulse"));
    eprintln!("pulses of {} to {} us, {} changes", ends[0], ends[1], widths.len());
    assert!(ends[1] - ends[0] > 400 && widths.len() > 100, "{ends:?}");
}
