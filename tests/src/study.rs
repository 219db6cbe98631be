//! Studies: recordings of one mechanism, and the engines that fit them.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, Normal};
use sim::{Model, RolloutOptions};

use crate::{Background, repository, wait_until};

/// Keypoint noise of the recordings \[m\].
const NOISE_M: f64 = 1e-4;
/// From one image to the next \[s\].
const INTERVAL_S: f64 = 0.01;

/// Drops of a hanging chain of three links, written as experiments, a folder each.
#[derive(Debug, Clone, Copy)]
pub struct Recordings {
    /// How many experiments.
    pub count: usize,
    /// Runs in each.
    pub runs: usize,
    /// How long each is \[s\].
    pub duration_s: f64,
    /// By how much `q2/damping` grows from one to the next, as a share of what it is in the first.
    pub drift: f64,
    /// The `[fit]` table's lines.
    pub fit: &'static str,
}

impl Default for Recordings {
    fn default() -> Self {
        Self { count: 4, runs: 1, duration_s: 1.0, drift: 0.0, fit: FIT }
    }
}

/// Two coefficients, from the model's values.
pub const FIT: &str = "parameters = [\"q2/damping\", \"q3/damping\"]\nmethod = \"least-squares\"\n";
/// `q2/damping` in the first recording \[N m s/rad\]; the model says another.
pub const DAMPING: f64 = 3e-6;

impl Recordings {
    /// Writes them to `e0`, `e1`, ... in `folder`.
    ///
    /// # Panics
    /// Where the shipped model cannot be read, or the folder not be written.
    pub fn write(&self, folder: &Path) {
        let model = repository().join("configs/models/chain-passive.xml");
        let text = std::fs::read_to_string(&model).expect("a shipped model");
        let normal = Normal::new(0.0, NOISE_M).expect("a deviation");
        for number in 0..self.count {
            let place = folder.join(format!("e{number}"));
            std::fs::create_dir_all(&place).expect("a folder");
            let mut tank = Model::from_mjcf(&text).expect("MJCF");
            let damping = DAMPING * (1.0 + self.drift * number as f64);
            tank.set_parameter("q2/damping", damping).expect("a damping");
            let mut runs = String::new();
            for run in 0..self.runs {
                let mut random = ChaCha8Rng::seed_from_u64(1000 * number as u64 + run as u64);
                let mut state = tank.rest_state();
                state.qpos[0] = 0.6 + 0.1 * run as f64;
                state.qpos[2] = -0.5;
                let times_s: Vec<f64> = (0..(self.duration_s / INTERVAL_S) as u32)
                    .map(|row| f64::from(row) * INTERVAL_S)
                    .collect();
                let options = RolloutOptions { start_s: RELEASE_S, ..RolloutOptions::default() };
                let still = sim::Command::default();
                let rollout = sim::rollout(&tank, &state, &still, &times_s, &options).expect("a rollout");
                let mut trajectory = rollout.trajectory();
                for at in &mut trajectory.position_m {
                    at.iter_mut().step_by(2).for_each(|metres| *metres += normal.sample(&mut random));
                    at[1] = f64::NAN;
                }
                let name = format!("run-{run}.csv");
                std::fs::write(place.join(&name), ident::table::trajectory_text(&trajectory))
                    .expect("written");
                runs += &format!(
                    "[[run]]\nid = \"run-{run}\"\nkind = \"drop\"\nrelease_s = {RELEASE_S}\ntrajectory = \"{name}\"\n"
                );
            }
            let experiment = format!(
                "model = {:?}\nnoise_m = {NOISE_M}\n[fit]\n{}{runs}",
                model.display().to_string(),
                self.fit
            );
            std::fs::write(place.join("experiment.toml"), experiment).expect("written");
        }
    }
}

/// When the chain is let go \[s\].
const RELEASE_S: f64 = 0.1;

/// An engine that was started for a test, ended with it.
#[derive(Debug)]
pub struct Engine {
    folder: PathBuf,
    /// What its commands need.
    pub environment: Vec<(String, String)>,
}

impl Engine {
    /// `slurm` or `hyperqueue`, by `scripts/study-engines` in `folder`; `None`, with a printed line, where it is not installed and
    /// `RIG_STUDY_ENGINES` does not name it as one that must be.
    ///
    /// # Panics
    /// Where it must be there and is not, or does not start.
    pub fn start(name: &str, folder: &Path, skipped: &str) -> Option<Self> {
        let program = if name == "slurm" { "slurmctld" } else { "hq" };
        let found = Command::new(program).arg("-V").stdout(Stdio::null()).stderr(Stdio::null()).status();
        if let Err(error) = found {
            let must_be = std::env::var("RIG_STUDY_ENGINES").is_ok_and(|names| names.contains(name));
            assert!(!must_be, "{program}: {error}");
            eprintln!("skipped: {skipped} (no {program}: {error}; docs/studies.md says where to get it)");
            return None;
        }
        let output = Command::new(repository().join("scripts/study-engines"))
            .arg(name)
            .arg(folder)
            .stderr(Stdio::inherit())
            .output()
            .expect("the script starts");
        assert!(output.status.success(), "scripts/study-engines {name}");
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        let variable =
            |line: &str| line.strip_prefix("export ")?.split_once('=').map(|(a, b)| (a.into(), b.into()));
        Some(Self { folder: folder.into(), environment: said.lines().filter_map(variable).collect() })
    }

    /// A command with what it needs.
    pub fn command(&self, mut command: Command) -> Command {
        command.envs(self.environment.iter().cloned());
        command
    }

    /// Kills the daemon `name` of it without a word.
    ///
    /// # Panics
    /// Where it is not there.
    pub fn kill(&self, name: &str) {
        let pid = std::fs::read_to_string(self.folder.join(format!("{name}.pid"))).expect("its number");
        let pid = pid.trim().parse().ok().and_then(rustix::process::Pid::from_raw).expect("a number");
        rustix::process::kill_process(pid, rustix::process::Signal::KILL).expect("it is there");
    }

    /// Starts a node daemon of Slurm anew.
    ///
    /// # Panics
    /// Where it does not start.
    pub fn node(&self, name: &str) -> Background {
        let mut command = Command::new("slurmd");
        command.args(["-D", "-N", name]);
        Background::start(self.command(command))
    }

    /// Starts a worker of HyperQueue with one processor, in a session of its own.
    ///
    /// # Panics
    /// Where it does not start.
    pub fn worker(&self) -> Child {
        let mut command = Command::new("hq");
        command.args(["worker", "start", "--cpus", "1"]);
        self.command(command).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("a worker")
    }

    /// Starts HyperQueue's server anew, from its journal.
    ///
    /// # Panics
    /// Where it does not start.
    pub fn server(&self) -> Background {
        let mut command = Command::new("hq");
        command.args(["server", "start", "--journal"]).arg(self.folder.join("journal"));
        let server = Background::start(self.command(command));
        wait_until("the server", 30.0, || {
            let mut command = Command::new("hq");
            command.args(["server", "info"]).stdout(Stdio::null()).stderr(Stdio::null());
            self.command(command).status().is_ok_and(|status| status.success())
        });
        server
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        let _ =
            Command::new(repository().join("scripts/study-engines")).arg("stop").arg(&self.folder).status();
    }
}
