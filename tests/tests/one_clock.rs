//! Servo and pictures on one clock: a board whose clock is 200 ppm fast and wraps, a camera whose stamps are 23 ms late and scatter, and
//! after `rig calibrate latency` a run whose pictures and pulses are where the tank's truth has them.

use std::path::Path;

use config::RigConfig;
use ground::clock::MonotonicNs;
use servo::pulse_log::{Logged, PulseLogReader};
use system_tests::{
    Background, changed_config, config, in_real_time, json, only_run, printed, rig, run_rig, set, wait_until,
};
use tank::Tank;

const LATE_S: f64 = 0.0231;
/// What is wanted of pictures against pulses: 1 ms is 0.25 mm at a tip of 0.25 m/s.
const WANTED_S: f64 = 1e-3;

/// How late `seen` is, where it should be `value` and changes by `rate` a second: by least squares.
#[derive(Default)]
struct Late {
    weight: f64,
    sum: f64,
}

impl Late {
    fn add(&mut self, seen: f64, value: f64, rate: f64) {
        self.weight += rate * rate;
        self.sum -= (seen - value) * rate;
    }

    fn seconds(&self) -> f64 {
        assert!(self.weight > 0.0, "nothing moved");
        self.sum / self.weight
    }
}

/// The shipped tank of pose 1 with the sync LED in view and stamps that are late.
fn fill(tank: &Path) {
    std::fs::create_dir(tank).expect("a folder");
    let shipped = config("tanks/chain-driven-pose-1.toml");
    let mut table: toml::Table = std::fs::read_to_string(&shipped).expect("the tank").parse().expect("TOML");
    let model = shipped.with_file_name(table["model"].as_str().expect("a model"));
    table.insert("model".into(), model.to_str().expect("text").into());
    set(&mut table, "view", "sync_led_px", vec![600.0, 440.0]);
    set(&mut table, "view", "stamp_latency_s", LATE_S);
    set(&mut table, "view", "stamp_jitter_s", 0.001);
    std::fs::write(tank.join("tank.toml"), table.to_string()).expect("a tank");
}

#[test]
fn pictures_and_pulses_are_within_a_millisecond_of_each_other() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let tank = folder.path().join("tank");
    fill(&tank);
    // Filled before anything happens, as the camera's is; what happens is told to it afterwards.
    let mut truth = Tank::read(&tank).expect("the tank");
    let mock = |kind: &str, more: &[&str]| {
        let mut command = rig([kind.as_ref(), "--tank".as_ref(), tank.as_os_str()]);
        command.args(more);
        Background::start(command)
    };
    let (_board, _camera) = (mock("mock-board", &["--drift-ppm", "200"]), mock("mock-camera", &[]));
    let port = tank.join("board");
    wait_until("board and camera", 10.0, || port.exists() && tank.join("camera.sock").exists());
    let own = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
        config.remove("mock");
        set(config, "servo", "kind", "serial");
        set(config, "servo", "port", port.to_str().expect("text"));
        set(config, "camera", "kind", "socket");
        set(config, "camera", "tank", tank.to_str().expect("text"));
        set(config, "camera", "exposure_s", 0.004);
        set(config, "profile", "cycles", 2);
        set(config, "profile", "soft_start_cycles", 0);
        set(config, "run", "diagnose", false);
        set(config, "fit", "parameters", vec!["q2/damping"]);
        set(config, "fit", "max_evaluations", 20);
    });

    let own = own.as_os_str();
    let calibrated = run_rig(
        ["calibrate", "latency", "--film-s", "6", "--write"].map(AsRef::as_ref).into_iter().chain([own, own]),
    );
    assert!(calibrated.status.success(), "{}", printed(&calibrated));
    let written: toml::Table = std::fs::read_to_string(own).expect("the config").parse().expect("TOML");
    let number = |key: &str| written["camera"][key].as_float().expect("a number");
    let (off_s, std_s) = (number("latency_s") - LATE_S, number("latency_std_s"));
    println!(
        "{}latency off by {:.3} ms, said to 1 sigma {:.3} ms",
        printed(&calibrated),
        off_s * 1e3,
        std_s * 1e3
    );
    assert!(off_s.abs() < WANTED_S && std_s < 0.5 * WANTED_S && off_s.abs() < 5.0 * std_s, "{off_s} {std_s}");

    let runs = folder.path().join("runs");
    let output = run_rig(["run".as_ref(), own, "--runs-dir".as_ref(), runs.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    let run = only_run(&runs).expect("one run");
    let origin =
        MonotonicNs(json(&run.join("start.json"))["clock"]["monotonic_ns"].as_u64().expect("a time"));

    // What the servo was told, by the recorded command and by the board's own log.
    let command = ident::table::read_command(&run.join("servo.csv")).expect("servo.csv");
    let mut pulses = Late::default();
    let servo = RigConfig::read(Path::new(own)).expect("the config").servo.expect("a servo");
    let ends = [command.time_s[0], *command.time_s.last().expect("rows")];
    for (at, logged) in PulseLogReader::new(&tank.join("servo.log")).poll() {
        logged.send_to(at, &mut truth);
        let time_s = at.seconds_since(origin);
        if let Logged::Pulse { pulse_us: Some(pulse_us), .. } = logged
            && time_s > ends[0]
            && time_s < ends[1]
        {
            let told = |time_s: f64| command.at(0, time_s);
            let rate = (told(time_s + 1e-3) - told(time_s - 1e-3)) / 2e-3;
            pulses.add(told(time_s), servo.channels[0].angle_rad(f64::from(pulse_us), false), rate);
        }
    }
    // Where the mechanism is, by the pictures and by the tank.
    let trajectory = ident::table::read_trajectory(&run.join("trajectory.csv")).expect("trajectory.csv");
    let sites = truth.model().keypoint_sites();
    let place = |time_s: f64| {
        let qpos = truth.qpos(origin.plus_seconds(time_s)).expect("the tank moves");
        let poses = truth.model().poses(&qpos);
        sites.iter().map(|&site| poses.site_pos[site]).collect::<Vec<_>>()
    };
    let mut pictures = Late::default();
    for (row, &time_s) in trajectory.time_s.iter().enumerate() {
        let [before, now, after] = [-2e-3, 0.0, 2e-3].map(|step_s| place(time_s + step_s));
        for keypoint in 0..sites.len() {
            for axis in [0, 2] {
                let seen = trajectory.at(row, keypoint)[axis];
                if seen.is_finite() {
                    let rate = (after[keypoint][axis] - before[keypoint][axis]) / 4e-3;
                    pictures.add(seen, now[keypoint][axis], rate);
                }
            }
        }
    }
    let (pulses_s, pictures_s) = (pulses.seconds(), pictures.seconds());
    // A pulse is logged when it has become a whole microsecond longer or shorter, which takes a millisecond here.
    println!("servo.csv is {:.3} ms late, the pictures {:.3} ms", pulses_s * 1e3, pictures_s * 1e3);
    assert!(pulses_s.abs() < 0.5 * WANTED_S, "{pulses_s}");
    assert!((pictures_s - pulses_s).abs() < WANTED_S, "{pictures_s} {pulses_s}");
}
