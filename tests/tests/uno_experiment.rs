//! A whole experiment with the firmware that is flashed: the Uno's binary in an emulator of its chip is the servo board, and the pulses at
//! its pin drive the servo in the mock tank that the camera looks at.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use system_tests::{
    Background, changed_config, config, in_real_time, json, only_run, printed, repository, rig, set,
    wait_until,
};

const CONFIG: &str = "chain-driven-pose-1.toml";
/// Processor cycles a second.
const CLOCK_HZ: f64 = 16e6;
/// The pin of channel 0.
const PIN: &str = "D2";
/// Without a pulse for so long a channel is detached \[s\]: a frame and a half.
const DETACHED_S: f64 = 0.03;

/// The firmware and its emulator, built into `folder`; none where a tool for it is missing.
fn built(folder: &Path) -> Option<[PathBuf; 2]> {
    let source = repository().join("firmware-protocol/uno");
    let runs = |command: &mut Command| command.status().is_ok_and(|status| status.success());
    let (elf, emulator) = (folder.join("uno.elf"), folder.join("emulator"));
    let is_there = runs(Command::new(source.join("build")).arg(folder).stdout(Stdio::null()))
        && runs(
            Command::new("cc")
                .args(["-O2", "-o"])
                .arg(&emulator)
                .arg(source.join("emulator.c"))
                .args(["-lsimavr", "-lelf", "-lutil"]),
        );
    is_there.then_some([elf, emulator])
}

/// Turns edges at the pin into the tank's log of pulses, as a servo does: a pulse counts when it has ended.
struct Servo {
    edges: PathBuf,
    log: PathBuf,
    /// What of the edges has been read.
    read: usize,
    began_s: Option<f64>,
    rose_s: Option<f64>,
    /// The last pulse: when it ended \[s\], and how long it was.
    last: Option<(f64, u32)>,
}

impl Servo {
    fn follow(&mut self) {
        let text = std::fs::read_to_string(&self.edges).unwrap_or_default();
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        let mut lines = String::new();
        let mut now_s = None;
        // the folder is gone when the test is over
        for line in text.get(self.read..whole).unwrap_or_default().lines() {
            let words: Vec<&str> = line.split(' ').collect();
            let [cycle, what, value] = words[..] else { continue };
            let at_s = cycle.parse::<f64>().expect("a cycle") / CLOCK_HZ;
            if what == "began" {
                self.began_s = Some(value.parse::<f64>().expect("seconds") - at_s);
                continue;
            }
            let at_s = at_s + self.began_s.expect("the emulator says when it began");
            now_s = Some(at_s);
            match (what == PIN, value) {
                (true, "1") => self.rose_s = Some(at_s),
                (true, _) => {
                    let width_us = ((at_s - self.rose_s.take().expect("it rose")) * 1e6).round() as u32;
                    if self.last.is_none_or(|(_, before)| before != width_us) {
                        let _ = writeln!(lines, "{:.0},0,{width_us}", at_s * 1e9);
                    }
                    self.last = Some((at_s, width_us));
                }
                (false, _) => {}
            }
        }
        self.read = whole;
        if let Some((ended_s, _)) =
            self.last.filter(|(ended_s, _)| now_s.is_some_and(|now_s| now_s - ended_s > DETACHED_S))
        {
            let _ = writeln!(lines, "{:.0},0,-", (ended_s + DETACHED_S) * 1e9);
            self.last = None;
        }
        if let Ok(mut log) = std::fs::File::options().append(true).create(true).open(&self.log) {
            std::io::Write::write_all(&mut log, lines.as_bytes()).expect("written");
        }
    }
}

#[test]
#[ignore = "an experiment in wall time beside an emulated chip wants a quiet machine; run it alone, with --ignored --nocapture"]
fn the_flashed_binary_drives_a_whole_experiment() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let Some([elf, emulator]) = built(at) else {
        eprintln!("skipped: apt-get install gcc-avr avr-libc libsimavr-dev libelf-dev");
        return;
    };
    let tank = at.join("tank");
    std::fs::create_dir(&tank).expect("a folder");
    let shipped = config("tanks/chain-driven-pose-1.toml");
    let mut table: toml::Table = std::fs::read_to_string(&shipped).expect("the tank").parse().expect("TOML");
    let model = shipped.with_file_name(table["model"].as_str().expect("a model"));
    table.insert("model".into(), model.to_str().expect("text").into());
    std::fs::write(tank.join("tank.toml"), table.to_string()).expect("a tank");

    let (port, edges) = (at.join("uno"), at.join("edges"));
    let mut board = Command::new(emulator);
    board.arg(elf).arg("--pty").arg(&port).arg("--edges").arg(&edges).stdin(Stdio::null());
    let _board = Background::start(board);
    let _camera = Background::start(rig(["mock-camera".as_ref(), "--tank".as_ref(), tank.as_os_str()]));
    wait_until("board and camera", 10.0, || port.exists() && tank.join("camera.sock").exists());
    let log = tank.join("servo.log");
    let mut servo = Servo { edges, log: log.clone(), read: 0, began_s: None, rose_s: None, last: None };
    std::thread::spawn(move || {
        loop {
            servo.follow();
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
