//! `tries/<id>.jsonl`: each time a task was begun, and what it took where it ended: a line each, put to the end of the file in one write, so
//! that tasks begun at once on two machines lose none.

use std::io::Write as _;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context as _;
use app::Failure;
use serde::{Deserialize, Serialize};

use crate::folder::{StudyFolder, TRIES};

/// The tries of one task.
#[derive(Debug)]
pub struct Tries {
    path: PathBuf,
}

/// A line of the file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct Line {
    /// When it was begun, or ended, RFC 3339.
    at_utc: String,
    /// On which machine.
    host: String,
    /// In which process.
    pid: u32,
    /// What it took, where it ended.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    took: Option<Took>,
}

/// What a task took.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Took {
    /// From beginning to end \[s\].
    pub wall_s: f64,
    /// Of processors \[s\].
    pub cpu_s: f64,
    /// The most memory it held \[MiB\].
    pub peak_mib: f64,
}

impl Tries {
    /// Those of the task `id`.
    pub fn of(folder: &StudyFolder, id: &str) -> Self {
        Self { path: folder.path().join(TRIES).join(format!("{id}.jsonl")) }
    }

    fn lines(&self) -> Vec<Line> {
        let text = std::fs::read_to_string(&self.path).unwrap_or_default();
        // one that a full disk cut short says nothing
        text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
    }

    /// How often it was begun without having ended.
    pub fn begun(&self) -> usize {
        self.lines().iter().filter(|line| line.took.is_none()).count()
    }

    /// What it took, where it has ended.
    pub fn took(&self) -> Option<Took> {
        self.lines().iter().find_map(|line| line.took)
    }

    pub(crate) fn begin(&self) -> Result<(), Failure> {
        self.add(None)
    }

    pub(crate) fn end(&self, wall: Duration) -> Result<(), Failure> {
        let cpu = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        let cpu_s = cpu.tv_sec as f64 + 1e-9 * cpu.tv_nsec as f64;
        self.add(Some(Took { wall_s: wall.as_secs_f64(), cpu_s, peak_mib: peak_mib() }))
    }

    /// Forgets them: whoever interrupts a task says nothing against it.
    pub(crate) fn take_back(&self) {
        // what is not there needs no removing
        let _ = std::fs::remove_file(&self.path);
    }

    #[expect(clippy::disallowed_methods, reason = "a line is put to the end, in a study's own folder")]
    fn add(&self, took: Option<Took>) -> Result<(), Failure> {
        let line =
            Line { at_utc: jiff::Timestamp::now().to_string(), host: host(), pid: std::process::id(), took };
        let mut line = serde_json::to_vec(&line).map_err(Failure::internal)?;
        line.push(b'\n');
        let file = std::fs::OpenOptions::new().append(true).create(true).open(&self.path);
        file.and_then(|mut file| file.write_all(&line))
            .with_context(|| format!("writing {}", self.path.display()))
            .map_err(Failure::Input)
    }
}

/// This machine's name; empty where the system does not say.
fn host() -> String {
    std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default().trim().to_owned()
}

/// The most memory that this process has held \[MiB\]; 0 where the system does not say.
fn peak_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    peak.and_then(|peak| peak.trim().strip_suffix("kB")?.trim().parse::<f64>().ok())
        .map_or(0.0, |kib| kib / 1024.0)
}
