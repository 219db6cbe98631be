//! Harness of the whole-system tests: the `rig` program as a user runs it, and processes to kill and stall.

pub mod bad_night;
pub mod book;
pub mod browser;
pub mod campaign;
pub mod clips;
pub mod daemon;
pub mod fish;
pub mod hidden;
pub mod http;
pub mod journal;
pub mod many_runs;
pub mod optics;
pub mod ordinary;
pub mod outside;
pub mod planes;
pub mod python;
pub mod soak;
pub mod soft_arm;
pub mod storage;
pub mod study;
pub mod tags;
pub mod three_links;
pub mod uno;
pub mod verbs;
pub mod wall;

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// The repository's root.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ lies in the repository").into()
}

/// A file under `configs/`.
pub fn config(name: &str) -> PathBuf {
    repository().join("configs").join(name)
}

/// The folder of shared measured data, or `None` with a printed line that says what is skipped.
pub fn shared(what_is_skipped: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("RIG_SHARED").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("skipped: {what_is_skipped} (RIG_SHARED is not set)");
    }
    folder
}

/// The `rig` program of this build. A test of the whole workspace has made it; a lone `cargo test -p` makes it once, and
/// after a change wants `cargo build`: asking cargo each time would build everything again with other features.
pub fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let test = std::env::current_exe().expect("a test knows its own path");
        let profile = test.ancestors().nth(2).expect("target/<profile>/deps/<test>");
        let program = profile.join("rig");
        if !program.exists() {
            let mut build = Command::new(env!("CARGO"));
            build.args(["build", "--locked", "-q", "-p", "rig", "--bin", "rig"]).current_dir(repository());
            if profile.ends_with("release") {
                build.arg("--release");
            }
            assert!(build.status().expect("cargo runs").success(), "rig does not build");
        }
        program
    })
}

/// `rig` with `args`, ready to run.
pub fn rig<I: IntoIterator<Item = S>, S: AsRef<std::ffi::OsStr>>(args: I) -> Command {
    let mut command = Command::new(program());
    command.args(args).stdin(Stdio::null());
    command
}

/// Runs `rig` with `args` to its end.
pub fn run_rig<I: IntoIterator<Item = S>, S: AsRef<std::ffi::OsStr>>(args: I) -> Output {
    rig(args).output().expect("rig starts")
}

/// What a finished `rig` printed, for assertion messages.
pub fn printed(output: &Output) -> String {
    format!(
        "exit {:?}\n{}{}",
        output.status.code(),
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// A background process that dies with its owner.
#[derive(Debug)]
pub struct Background(Child);

impl Background {
    /// Starts `command` with its output thrown away.
    pub fn start(mut command: Command) -> Self {
        Self(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the process starts"))
    }

    /// A process that was started already.
    pub fn of(child: Child) -> Self {
        Self(child)
    }

    /// Starts `command` with its output in `file`.
    pub fn with_output(mut command: Command, file: std::fs::File) -> Self {
        let twice = file.try_clone().expect("a file has two handles");
        Self(command.stdout(twice).stderr(file).spawn().expect("the process starts"))
    }

    /// Its number.
    pub fn id(&self) -> u32 {
        self.0.id()
    }

    /// The process.
    pub fn child(&mut self) -> &mut Child {
        &mut self.0
    }

    /// Sends a signal.
    pub fn signal(&self, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_child(&self.0);
        rustix::process::kill_process(pid, signal).expect("the process is there");
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Waits until `condition` holds; fails with `what` after `seconds`.
pub fn wait_until(what: &str, seconds: f64, mut condition: impl FnMut() -> bool) {
    let deadline = Instant::now() + ground::strict::duration(seconds);
    while !condition() {
        assert!(Instant::now() < deadline, "{what} did not happen within {seconds} s");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// The only run folder below `runs`, where there is one.
pub fn only_run(runs: &Path) -> Option<PathBuf> {
    let mut folders: Vec<_> = std::fs::read_dir(runs)
        .ok()?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.join("start.json").exists())
        // one that is being made has another name
        .filter(|path| !path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b".")))
        .collect();
    (folders.len() == 1).then(|| folders.remove(0))
}

/// A JSON file's content.
pub fn json(path: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Held by tests that run in real time: two of them on one machine would make each other's cameras stall.
pub fn in_real_time() -> std::sync::MutexGuard<'static, ()> {
    static TURN: std::sync::Mutex<()> = std::sync::Mutex::new(());
    TURN.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// A copy of a shipped config in `folder`, changed by `change`; its relative paths still lead to the shipped files.
pub fn changed_config(name: &str, folder: &Path, change: impl FnOnce(&mut toml::Table)) -> PathBuf {
    let original = config(name);
    let text = std::fs::read_to_string(&original).unwrap_or_else(|error| panic!("{name}: {error}"));
    let mut table: toml::Table = text.parse().unwrap_or_else(|error| panic!("{name}: {error}"));
    let base = original.parent().expect("configs lie in a folder");
    for (section, key) in
        [("run", "model"), ("mock", "tank"), ("vision", "static_mask"), ("calibration", "file")]
    {
        if let Some(path) = table.get_mut(section).and_then(|section| section.get_mut(key)) {
            let absolute = base.join(path.as_str().expect("a path"));
            *path = absolute.to_str().expect("a readable path").into();
        }
    }
    // A test machine may be busy with anything: what is tested is that a silence ends a run, not how short a one.
    set(&mut table, "servo", "dead_man_ms", 2000);
    set(&mut table, "camera", "stall_s", 2.0);
    if table["run"]["kind"].as_str() != Some("driven") {
        table.remove("servo");
    }
    change(&mut table);
    let copy = folder.join("rig.toml");
    std::fs::write(&copy, table.to_string()).expect("the copy can be written");
    copy
}

/// Sets `table.key = value`, where `table` may be missing.
pub fn set(config: &mut toml::Table, table: &str, key: &str, value: impl Into<toml::Value>) {
    let entry = config.entry(table).or_insert_with(|| toml::Table::new().into());
    entry.as_table_mut().expect("a table").insert(key.into(), value.into());
}
