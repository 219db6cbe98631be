//! The mock board and the mock camera as processes of their own, and a config that uses them.

use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::{Background, changed_config, only_run, rig, set, wait_until};

/// A rig whose mock board and mock camera are other processes.
#[derive(Debug)]
pub struct Outside {
    /// `rig mock-board`.
    pub board: Background,
    /// `rig mock-camera`.
    pub camera: Background,
    /// The rig's config.
    pub config: PathBuf,
    /// Where its run folders go.
    pub runs: PathBuf,
    tank: PathBuf,
}

impl Outside {
    /// Starts both for the shipped config of this name, on the shipped tank of the same name.
    pub fn new(name: &str, folder: &Path) -> Self {
        let tank = folder.join("tank");
        std::fs::create_dir(&tank).expect("a folder");
        let shipped = crate::config("tanks").join(name);
        let mut table: toml::Table =
            std::fs::read_to_string(&shipped).expect("the shipped tank").parse().expect("TOML");
        let model = shipped.with_file_name(table["model"].as_str().expect("a model"));
        table.insert("model".into(), model.to_str().expect("a readable path").into());
        std::fs::write(tank.join("tank.toml"), table.to_string()).expect("a tank");
        let board = Background::start(rig(["mock-board".as_ref(), "--tank".as_ref(), tank.as_os_str()]));
        let camera = Background::start(rig(["mock-camera".as_ref(), "--tank".as_ref(), tank.as_os_str()]));
        wait_until("both mocks", 10.0, || tank.join("board").exists() && tank.join("camera.sock").exists());
        let config = changed_config(name, folder, |config| {
            let path = tank.to_str().expect("a readable path");
            config.remove("mock");
            set(config, "servo", "kind", "serial");
            set(config, "servo", "port", format!("{path}/board"));
            set(config, "camera", "kind", "socket");
            set(config, "camera", "tank", path);
            set(config, "profile", "cycles", 3);
            // nobody's hand is in it
            let motion = config.entry("motion").or_insert_with(|| toml::Table::new().into());
            motion.as_table_mut().expect("a table").insert("announce_s".into(), 0.0.into());
        });
        Self { board, camera, config, runs: folder.join("runs"), tank }
    }

    /// Plugs in a board again that was killed.
    pub fn plug_in(&mut self) {
        self.board =
            Background::start(rig(["mock-board".as_ref(), "--tank".as_ref(), self.tank.as_os_str()]));
    }

    /// Starts `rig run`.
    pub fn start(&self) -> Background {
        self.start_verb("run")
    }

    /// Starts a verb that runs experiments.
    pub fn start_verb(&self, verb: &str) -> Background {
        let args = [verb.as_ref(), self.config.as_os_str(), "--runs-dir".as_ref(), self.runs.as_os_str()];
        Background::start(rig(args))
    }

    /// Waits until the servo moves, and gives the folder of the run.
    pub fn wait_for_motion(&self) -> PathBuf {
        wait_until("the profile's start", 60.0, || {
            only_run(&self.runs).is_some_and(|run| journal_holds(&run, "profile-started"))
        });
        std::thread::sleep(Duration::from_millis(300));
        only_run(&self.runs).expect("one run folder")
    }

    /// How many changes of pulses the board has put out.
    pub fn pulses(&self) -> usize {
        let log = std::fs::read_to_string(self.tank.join("servo.log")).expect("the board's pulses");
        log.lines().filter(|line| line.split(',').nth(1) == Some("0")).count()
    }

    /// The last pulse the board put out on channel 0; none when it is detached.
    pub fn last_pulse(&self) -> Option<String> {
        let log = std::fs::read_to_string(self.tank.join("servo.log")).expect("the board's pulses");
        let last = log.lines().rfind(|line| line.split(',').nth(1) == Some("0"))?;
        last.split(',').nth(2).filter(|pulse| *pulse != "-").map(str::to_owned)
    }
}

/// Whether the journal of `run` has this event.
pub fn journal_holds(run: &Path, event: &str) -> bool {
    std::fs::read_to_string(run.join("journal.jsonl")).is_ok_and(|journal| journal.contains(event))
}
