//! A mock rig with a daemon on it.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Command;

use rustix::process::Pid;

use crate::http::{Answer, ask};
use crate::{Background, changed_config, only_run, printed, rig, run_rig, set, wait_until};

/// A schedule whose slots do not come during a test.
const CRON_NEVER: &str = "0 0 1 1 *";

fn short_experiment(config: &mut toml::Table, cron: &str) {
    set(config, "profile", "cycles", 1);
    set(config, "profile", "soft_start_cycles", 0);
    set(config, "fit", "parameters", vec!["q2/damping".to_owned()]);
    set(config, "run", "diagnose", false);
    set(config, "schedule", "cron", cron);
}

/// A rig with a daemon on it.
#[derive(Debug)]
pub struct Bench {
    folder: tempfile::TempDir,
    /// The rig's config.
    pub config: PathBuf,
    /// Its runs.
    pub runs: PathBuf,
}

impl Bench {
    /// A short experiment on the schedule `cron`.
    pub fn new(cron: &str) -> Self {
        Self::changed(cron, |_| {})
    }

    /// The same, changed by `change`.
    fn changed(cron: &str, change: impl FnOnce(&mut toml::Table)) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let runs = folder.path().join("runs");
        let config = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
            short_experiment(config, cron);
            change(config);
        });
        Self { folder, config, runs }
    }

    /// On the rig of `config` in `folder`, with a short experiment; its schedule begins nothing.
    pub fn of(folder: tempfile::TempDir, config: PathBuf, runs: PathBuf) -> Self {
        let bench = Self { folder, config, runs };
        bench.change(|config| short_experiment(config, CRON_NEVER));
        bench
    }

    /// One whose motion goes on long enough for its keypoints to be found meanwhile; its schedule begins nothing.
    pub fn long() -> Self {
        Self::changed(CRON_NEVER, |config| set(config, "profile", "cycles", 4))
    }

    /// One whose camera takes few images a second: a machine that is busy with anything loses none of them by itself.
    pub fn slow() -> Self {
        Self::changed(CRON_NEVER, |config| set(config, "camera", "fps", 25.0))
    }

    /// Gives the rig another model: as before, but for a comment in its file.
    pub fn change_model(&self) {
        let text = std::fs::read_to_string(&self.config).expect("its config");
        let mut config: toml::Table = text.parse().expect("a table");
        let model =
            std::fs::read_to_string(config["run"]["model"].as_str().expect("a path")).expect("a model");
        let path = self.folder.path().join("changed.xml");
        std::fs::write(&path, format!("{model}<!-- changed -->\n")).expect("a file");
        set(&mut config, "run", "model", path.to_str().expect("readable"));
        set(&mut config, "profile", "cycles", 1);
        std::fs::write(&self.config, config.to_string()).expect("its config");
    }

    /// One whose schedule begins nothing.
    pub fn quiet() -> Self {
        Self::new(CRON_NEVER)
    }

    /// Changes its config.
    pub fn change(&self, change: impl FnOnce(&mut toml::Table)) {
        let text = std::fs::read_to_string(&self.config).expect("its config");
        let mut config: toml::Table = text.parse().expect("a config");
        change(&mut config);
        std::fs::write(&self.config, config.to_string()).expect("its config");
    }

    /// The daemon, not started yet.
    pub fn daemon(&self, more: &[&str]) -> Command {
        let mut daemon =
            rig(["daemon".as_ref(), self.config.as_os_str(), "--runs-dir".as_ref(), self.runs.as_os_str()]);
        daemon.args(more);
        daemon
    }

    /// A daemon that has started.
    pub fn start(&self, more: &[&str]) -> Background {
        self.started(self.daemon(more), if more.is_empty() { "\"started\"" } else { "\"serving\"" })
    }

    /// A daemon that has started with process numbers of its own, as a container has them: its session was begun outside. None where the
    /// system lets nobody do that.
    pub fn start_in_a_container(&self) -> Option<Background> {
        let mut container = Command::new("unshare");
        container.args(["--user", "--map-root-user", "--pid", "--fork", "--kill-child", "--mount-proc"]);
        let mut daemon = Command::new(container.get_program());
        daemon.args(container.get_args());
        if !container.arg("true").status().is_ok_and(|status| status.success()) {
            return None;
        }
        let outside = self.daemon(&[]);
        daemon.arg(outside.get_program()).args(outside.get_args());
        Some(self.started(daemon, "\"started\""))
    }

    /// The process of `daemon`, once its journal has one more entry that says `last`.
    fn started(&self, daemon: Command, last: &str) -> Background {
        let log_path = self.folder.path().join("daemon.log");
        let log = std::fs::File::options().create(true).append(true).open(&log_path);
        let before = self.journal().matches(last).count();
        let mut daemon = Background::with_output(daemon, log.expect("a log"));
        wait_until("the daemon's start", 10.0, || {
            let ended = daemon.child().try_wait().expect("its status");
            assert!(ended.is_none(), "{ended:?}: {}", std::fs::read_to_string(&log_path).unwrap_or_default());
            self.journal().matches(last).count() > before
        });
        daemon
    }

    /// The daemon's journal.
    pub fn journal(&self) -> String {
        std::fs::read_to_string(self.runs.join("daemon.jsonl")).unwrap_or_default()
    }

    /// What `rig jobs` says.
    pub fn jobs(&self, args: &[&str]) -> String {
        let output = run_rig([&["jobs", "--runs-dir", self.runs.to_str().expect("readable")], args].concat());
        assert!(output.status.success(), "{}", printed(&output));
        String::from_utf8(output.stdout).expect("text")
    }

    /// Adds a run to the queue.
    pub fn add_run(&self) {
        self.jobs(&["add", "run", self.config.to_str().expect("readable")]);
    }

    /// The line of `rig jobs ls` of the job `id`.
    pub fn job(&self, id: u32) -> String {
        let jobs = self.jobs(&["ls"]);
        let line = jobs.lines().find(|line| line.trim_start().starts_with(&format!("{id} ")));
        line.unwrap_or_default().to_owned()
    }

    /// Waits until the job `id` is in a state that its line names.
    pub fn wait(&self, id: u32, states: &[&str], seconds: f64) -> String {
        let what = format!("job {id}: {states:?}\n{}", self.jobs(&["ls"]));
        wait_until(&what, seconds, || states.iter().any(|state| self.job(id).contains(state)));
        self.job(id)
    }

    /// Waits until the mechanism of the only run moves; gives the run's folder.
    pub fn wait_for_motion(&self) -> PathBuf {
        wait_until("a motion", 30.0, || {
            only_run(&self.runs).is_some_and(|run| has(&run, "\"armed\"") || has(&run, "arming"))
        });
        only_run(&self.runs).expect("a run")
    }

    /// The process that does the newest job that began.
    pub fn job_process(&self) -> Pid {
        let journal = self.journal();
        let began = journal.lines().rfind(|line| line.contains("\"job-began\"")).expect("a job began");
        let began: serde_json::Value = serde_json::from_str(began).expect("a line of the journal");
        Pid::from_raw(began["pid"].as_i64().expect("its process") as i32).expect("a process")
    }
}

fn has(run: &Path, event: &str) -> bool {
    std::fs::read_to_string(run.join("journal.jsonl")).is_ok_and(|text| text.contains(event))
}

/// A daemon that serves.
#[derive(Debug)]
pub struct Served {
    /// Its rig.
    pub bench: Bench,
    daemon: Background,
    /// Where it serves.
    pub address: SocketAddr,
    /// What whoever moves the rig must say.
    pub token: String,
}

impl Served {
    /// A daemon of a rig whose schedule begins nothing, which listens at `listen`.
    pub fn start(listen: &str) -> Self {
        Self::on(Bench::quiet(), listen)
    }

    /// A daemon on `bench`, which listens at `listen`.
    pub fn on(bench: Bench, listen: &str) -> Self {
        Self::changed(bench, listen, |daemon| daemon)
    }

    /// The same, started by the command that `change` makes of the usual one.
    pub fn changed(bench: Bench, listen: &str, change: impl FnOnce(Command) -> Command) -> Self {
        let daemon = change(bench.daemon(&["--listen", listen, "--host", "rig.lab"]));
        let daemon = bench.started(daemon, "\"serving\"");
        let journal = bench.journal();
        let serving = journal.lines().rfind(|line| line.contains("\"serving\"")).expect("it serves");
        let serving: serde_json::Value = serde_json::from_str(serving).expect("a line of the journal");
        let address: SocketAddr =
            serving["address"].as_str().expect("its address").parse().expect("an address");
        let token = std::fs::read_to_string(bench.runs.join(".token")).expect("a token");
        Self { bench, daemon, address: ([127, 0, 0, 1], address.port()).into(), token }
    }

    /// The same, its daemon ended.
    pub fn ended(mut self) -> Self {
        self.daemon.signal(rustix::process::Signal::TERM);
        wait_until("the daemon's end", 10.0, || {
            self.daemon.child().try_wait().expect("its status").is_some()
        });
        self
    }

    /// Kills the daemon; its jobs go on.
    pub fn kill_daemon(&self) {
        self.daemon.signal(rustix::process::Signal::KILL);
    }

    /// The daemon's process.
    pub fn process(&self) -> u32 {
        self.daemon.id()
    }

    /// Ends the daemon; the rig stays.
    pub fn into_bench(self) -> Bench {
        self.bench
    }

    /// Reads `path`.
    pub fn get(&self, path: &str) -> Answer {
        ask(self.address, "GET", path, "Host: localhost\r\n", "")
    }

    /// Sends `body` to `path`, with the token.
    pub fn post(&self, path: &str, body: &str) -> Answer {
        let head = format!(
            "Host: localhost\r\nContent-Type: application/json\r\nAuthorization: Bearer {}\r\n",
            self.token
        );
        ask(self.address, "POST", path, &head, body)
    }
}
