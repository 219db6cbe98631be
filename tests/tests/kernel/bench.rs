//! The rig of these tests: board, tank and camera behind drivers, and `rig run` on them.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use camera::{CameraConfig, Encoding};
use ground::clock::MonotonicNs;
use servo::PulseSink as _;
use servo::pulse_log::{Logged, PulseLogReader};
use system_tests::{Background, changed_config, config, json, only_run, rig, set, uno, wait_until};
use tank::Tank;

use crate::feeder::Feeder;
use crate::gadget::{Gadget, PORT};

/// Where the guest has firmware and emulator.
const UNO: &str = "/rig/uno";
const CONFIG: &str = "chain-driven-pose-1.toml";
/// Small and slow enough for an emulated processor.
const SIZE_PX: [u32; 2] = [320, 240];
pub(crate) const FPS: u32 = 25;
/// Half of the shipped config's picture in each direction.
const METRES_PER_PIXEL: f64 = 0.0005;
const ORIGIN_PX: [f64; 2] = [160.0, 210.0];

/// Runs a program of the guest, which must succeed; what it printed.
pub(crate) fn must(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output().expect("the guest has it");
    assert!(output.status.success(), "{program} {arguments:?}: {output:?}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

pub(crate) fn write(path: &Path, text: &str) {
    std::fs::write(path, text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

/// A process, or this thread, goes before all others of the guest: what stands for hardware of its own has a processor of its own.
pub(crate) fn comes_first(process: Option<rustix::process::Pid>) {
    rustix::process::setpriority_process(process, -20).expect("tests are root here");
}

/// Board, pin and servo: what is left of the rig when its camera is another one.
pub(crate) struct Board {
    pub folder: tempfile::TempDir,
    pub gadget: Gadget,
    pulses: Pulses,
    pub tank: Tank,
    _process: Background,
}

type Pulses = Arc<Mutex<Vec<(MonotonicNs, Option<u16>)>>>;

/// One cycle of the profile, at its full size: for runs that are only filmed.
pub(crate) fn one_cycle(config: &mut toml::Table) {
    set(config, "profile", "cycles", 1);
    set(config, "profile", "soft_start_cycles", 0);
}

impl Board {
    /// `rig mock-board` behind the gadget.
    pub(crate) fn mock() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let process =
            Background::start(rig(["mock-board".as_ref(), "--tank".as_ref(), folder.path().as_os_str()]));
        let port = folder.path().join("board");
        wait_until("the mock board", 10.0, || port.exists());
        let mut log = PulseLogReader::new(&folder.path().join("servo.log"));
        let changes = move || {
            let pulse = |(at, logged)| match logged {
                Logged::Pulse { pulse_us, .. } => Some((at, pulse_us)),
                Logged::SyncLed { .. } => None,
            };
            log.poll().into_iter().filter_map(pulse).collect::<Vec<_>>()
        };
        Self::plugged_in(folder, &port, process, changes)
    }

    /// The Uno's firmware behind the gadget, in the emulator of its chip.
    pub(crate) fn uno() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let (port, edges) = (folder.path().join("uno"), folder.path().join("edges"));
        let mut process = uno::start(Path::new(UNO), &port, &edges);
        comes_first(Some(rustix::process::Pid::from_child(process.child())));
        wait_until("the emulated board", 10.0, || port.exists());
        let (mut servo, mut told) = (uno::Servo::default(), std::fs::File::open(edges).expect("edges"));
        let changes = move || {
            let mut text = String::new();
            told.read_to_string(&mut text).expect("text");
            servo.hear(&text)
        };
        Self::plugged_in(folder, &port, process, changes)
    }

    fn plugged_in(
        folder: tempfile::TempDir,
        port: &Path,
        process: Background,
        mut changes: impl FnMut() -> Vec<(MonotonicNs, Option<u16>)> + Send + 'static,
    ) -> Self {
        let gadget = Gadget::plugged_in(port);
        let shipped = config("tanks/chain-driven-pose-1.toml");
        let text = std::fs::read_to_string(&shipped).expect("the shipped tank");
        let mut table: toml::Table = text.parse().expect("TOML");
        set(&mut table, "view", "metres_per_pixel", METRES_PER_PIXEL);
        set(&mut table, "view", "origin_px", ORIGIN_PX.to_vec());
        let table = toml::from_str(&table.to_string()).expect("a tank");
        let tank = Tank::new(&table, shipped.parent().expect("a folder")).expect("a tank");

        let (pulses, mut moved) = (Pulses::default(), tank.clone());
        let kept = Arc::downgrade(&pulses);
        std::thread::spawn(move || {
            while let Some(kept) = kept.upgrade() {
                for (at, pulse_us) in changes() {
                    moved.pulse(0, pulse_us, at);
                    kept.lock().expect("no panic").push((at, pulse_us));
                }
                std::thread::sleep(Duration::from_millis(5));
            }
        });
        Self { folder, gadget, pulses, tank, _process: process }
    }

    /// The config of a run on this board with the camera at `device`, changed by `change`.
    pub(crate) fn config(
        &self,
        device: &str,
        encoding: Encoding,
        change: impl FnOnce(&mut toml::Table),
    ) -> PathBuf {
        changed_config(CONFIG, self.folder.path(), |config| {
            config.remove("mock");
            set(config, "run", "settle_s", 0.5);
            set(config, "run", "diagnose", false);
            set(config, "servo", "kind", "serial");
            set(config, "servo", "port", PORT);
            set(config, "servo", "dead_man_ms", DEAD_MAN_MS);
            set(config, "camera", "kind", "v4l");
            set(config, "camera", "device", device);
            set(config, "camera", "width_px", SIZE_PX[0]);
            set(config, "camera", "height_px", SIZE_PX[1]);
            set(config, "camera", "fps", f64::from(FPS));
            set(config, "camera", "format", toml::Value::try_from(encoding).expect("a name"));
            set(config, "camera", "stall_s", STALL_S);
            set(config, "calibration", "metres_per_pixel", METRES_PER_PIXEL);
            set(config, "calibration", "origin_px", ORIGIN_PX.to_vec());
            change(config);
        })
    }

    pub(crate) fn runs(&self) -> PathBuf {
        self.folder.path().join("runs")
    }

    /// The pulse at the pin \[us\]; none: detached.
    pub(crate) fn pulse_us(&self) -> Option<u16> {
        self.pulses.lock().expect("no panic").last().and_then(|(_, pulse_us)| *pulse_us)
    }

    /// All changes of the pulses at the pin so far: when, and how long they are from then on \[us\]; none: detached.
    pub(crate) fn pulses(&self) -> Vec<(MonotonicNs, Option<u16>)> {
        self.pulses.lock().expect("no panic").clone()
    }
}

/// How long the board bears silence: an emulated computer may keep it waiting longer than a real one does.
pub(crate) const DEAD_MAN_MS: i64 = 1000;
pub(crate) const STALL_S: f64 = 1.5;

/// The camera that [`Board::config`] means, showing the board's tank.
pub(crate) fn feeder(board: &Board, encoding: Encoding) -> Feeder {
    let fps = ground::strict::Positive::new(f64::from(FPS));
    let camera = CameraConfig {
        width_px: SIZE_PX[0],
        height_px: SIZE_PX[1],
        fps,
        format: encoding,
        ..Default::default()
    };
    Feeder::start(&board.tank, &camera)
}

pub(crate) use crate::feeder::CAMERA as FED;

/// A `rig run` under way.
pub(crate) struct Running {
    process: Background,
    runs: PathBuf,
    said: PathBuf,
}

/// How a `rig run` ended.
pub(crate) struct Ended {
    pub code: Option<i32>,
    pub run: PathBuf,
    pub stop: serde_json::Value,
    pub said: String,
}

impl Running {
    /// Starts it on `config`, its run alone in a folder of its own.
    pub(crate) fn start(board: &Board, config: &Path, arguments: &[&str]) -> Self {
        let runs = board.runs();
        let _ = std::fs::remove_dir_all(&runs);
        let said = board.folder.path().join("said");
        let file = std::fs::File::create(&said).expect("a file");
        let mut command = rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
        command.args(arguments);
        Self { process: Background::with_output(command, file), runs, said }
    }

    pub(crate) fn journal_holds(&self, event: &str) -> bool {
        only_run(&self.runs)
            .and_then(|run| std::fs::read_to_string(run.join("journal.jsonl")).ok())
            .is_some_and(|journal| journal.contains(event))
    }

    /// Waits until the profile plays, and a moment longer.
    pub(crate) fn wait_for_motion(&mut self) {
        let mut ended = false;
        wait_until("the profile's start", 60.0, || {
            ended = self.process.child().try_wait().expect("its status").is_some();
            ended || self.journal_holds("profile-started")
        });
        assert!(!ended, "rig run has ended: {}", std::fs::read_to_string(&self.said).unwrap_or_default());
        std::thread::sleep(Duration::from_millis(500));
    }

    pub(crate) fn ended_within(mut self, seconds: f64) -> Ended {
        let deadline = Instant::now() + ground::strict::duration(seconds);
        let status = loop {
            if let Some(status) = self.process.child().try_wait().expect("its status") {
                break status;
            }
            let said = || std::fs::read_to_string(&self.said).unwrap_or_default();
            assert!(Instant::now() < deadline, "rig run goes on after {seconds} s: {}", said());
            std::thread::sleep(Duration::from_millis(20));
        };
        let said = std::fs::read_to_string(&self.said).expect("what it said");
        let run = only_run(&self.runs).unwrap_or_else(|| panic!("no run: {said}"));
        let stop = json(&run.join("stop.json"));
        Ended { code: status.code(), run, stop, said }
    }
}

impl Ended {
    /// The run failed with `reason`, by itself and in order.
    pub(crate) fn assert_failed(&self, reason: &str) {
        self.assert_failed_with_images(reason, FPS as usize);
    }

    /// The same, with so many images recorded at least.
    pub(crate) fn assert_failed_with_images(&self, reason: &str, least: usize) {
        assert_eq!(self.code, Some(3), "{}", self.said);
        assert!(!self.said.contains("panicked"), "{}", self.said);
        assert_eq!(self.stop["status"], "fail", "{}", self.stop);
        let told = self.stop["reason"].as_str().unwrap_or_default();
        assert!(told.contains(reason), "{told:?} does not say {reason:?}");
        assert!(self.said.contains(reason), "{}", self.said);
        let recording = record::reader::Recording::open(&self.run.join("recording.mcap"));
        let images = recording
            .expect("a recording")
            .filter(|item| matches!(item, Ok((_, record::reader::Item::Image(_)))))
            .count();
        assert!(images >= least, "{images} images");
        eprintln!("    {told}");
    }

    /// The servo was stopped by a board that said so.
    pub(crate) fn assert_stopped(&self, board: &Board) {
        assert_eq!(self.stop["servo"], "acknowledged", "{}", self.stop);
        wait_until("the servo's release", 2.0, || board.pulse_us().is_none());
    }
}
