//! A job handed to the daemon that holds the rig, and watched until it has ended.

use std::io::{Read, Seek, SeekFrom};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use rustix::process::{Pid, Signal, kill_process};

use super::{Failure, Interrupt, Watcher};
use analysis::showing::Showing;
use ground::claim::Claim;
use ground::error_chain::with_causes;
use record::below;
use record::files::write_whole;
use serde::{Deserialize, Serialize};
use store::job::{Job, JobId, NewJob, State, Work};
use store::{Store, StoreError};

/// Environment variable with the number of the job that this process does for a daemon.
pub const JOB_VARIABLE: &str = "RIG_JOB";
/// Environment variable with the path of the socket for its live view.
pub const LIVE_VARIABLE: &str = "RIG_SHOW";
/// Folders of jobs, in the folder of run folders.
const JOBS: &str = "jobs";
/// Interval at which the job and its log are read. Chosen.
const JOB_POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Names of the files in a job's folder.
pub mod file {
    /// The job's order: an [`Order`](super::Order).
    pub const ORDER: &str = "order.json";
    /// Its result: a [`JobResult`](store::job::JobResult), the one object of `--json`.
    pub const RESULT: &str = "result.json";
    /// Its log.
    pub const LOG: &str = "log.txt";
    /// The socket of its live view.
    pub const LIVE: &str = "live.sock";
}

/// What the process of a job is to do.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Order {
    /// The job's work.
    pub work: Work,
    /// The folder of run folders.
    pub runs_dir: PathBuf,
    /// The folder for results.
    pub out: PathBuf,
    /// The rig's config.
    pub config: PathBuf,
    /// Worker threads.
    pub threads: usize,
}

impl Order {
    /// Writes it into the job's folder.
    ///
    /// # Errors
    /// [`Failure::Internal`].
    pub fn write(&self, folder: &Path) -> Result<(), Failure> {
        let text = serde_json::to_vec(self).map_err(Failure::internal)?;
        write_whole(&folder.join(file::ORDER), &text).map_err(Failure::internal)
    }

    /// Reads it from the job's folder.
    ///
    /// # Errors
    /// [`Failure::Input`].
    pub fn read(folder: &Path) -> Result<Self, Failure> {
        let path = folder.join(file::ORDER);
        let text = below::read_at(&path)
            .with_context(|| format!("reading {}", path.display()))
            .map_err(Failure::Input)?;
        serde_json::from_slice(&text).with_context(|| path.display().to_string()).map_err(Failure::Input)
    }
}

/// The lock that a daemon holds on the runs folder `runs_dir`.
pub fn lock(runs_dir: &Path) -> PathBuf {
    runs_dir.join(".daemon.lock")
}

/// The folder of the job `id`.
pub fn folder(runs_dir: &Path, id: JobId) -> PathBuf {
    runs_dir.join(JOBS).join(id.to_string())
}

/// The socket of the live view of the job `id`; links are not followed.
///
/// # Errors
/// As [`below::socket`].
pub fn socket(runs_dir: &Path, id: JobId) -> std::io::Result<OwnedFd> {
    below::socket(runs_dir, &[JOBS, &id.to_string(), file::LIVE])
}

/// The live view of this process: for a job of a daemon on a socket in the job's folder, else none.
pub fn showing() -> Showing {
    let job = std::env::var(JOB_VARIABLE).ok().and_then(|job| job.parse().ok());
    match job.zip(std::env::var_os(LIVE_VARIABLE)) {
        Some((job, path)) => Showing::open(Path::new(&path), job),
        None => Showing::default(),
    }
}

/// Whether this process does a job for a daemon.
pub fn is_job() -> bool {
    std::env::var_os(JOB_VARIABLE).is_some()
}

/// The daemon that holds the runs folder; none where this process does a job for it.
pub fn daemon(runs_dir: &Path) -> Option<u32> {
    Claim::holder(&lock(runs_dir)).filter(|_| !is_job())
}

/// Adds `job` to the queue in `runs_dir` and shows its log until it has ended. A signal cancels it: the daemon stops what
/// moves, and the second signal ends the watching.
///
/// # Errors
/// [`Failure`] by class, as the job ended.
pub async fn hand_in(
    runs_dir: &Path,
    job: &NewJob,
    interrupt: &Interrupt,
    watcher: &mut dyn Watcher,
) -> Result<Job, Failure> {
    let mut store = Store::open(runs_dir).map_err(Failure::input)?;
    let id = store.add(job)?;
    let holder = daemon(runs_dir).map_or_else(String::new, |pid| format!(" (process {pid})"));
    watcher.alert(&format!("rig: the daemon{holder} holds the rig and does this as job {id}"));
    let mut log = Log { path: folder(runs_dir, id).join(file::LOG), read: 0 };
    let mut cancelled = false;
    loop {
        // before the log: what was written until the end is shown
        let job = store.job(id).map_err(Failure::internal)?;
        log.show(watcher);
        if job.state.is_over() {
            return ended(job);
        }
        if interrupt.is_raised() && !cancelled {
            // the job's process is signalled first, without waiting for the database
            if let Some(process) = job.pid.and_then(|pid| Pid::from_raw(i32::try_from(pid).ok()?)) {
                let _ = kill_process(process, Signal::TERM);
            }
            match store.cancel(id, "cancelled where it was handed in") {
                Ok(_) | Err(StoreError::Over { .. }) => cancelled = true,
                Err(error) => watcher.alert(&format!("rig: {}; trying again", with_causes(&error))),
            }
        }
        tokio::select! {
            () = interrupt.raised(), if !cancelled => {}
            () = tokio::time::sleep(JOB_POLL_INTERVAL) => {}
        }
    }
}

fn ended(job: Job) -> Result<Job, Failure> {
    let error = job.result.error.clone().unwrap_or_else(|| format!("job {} is {}", job.id, job.state));
    let error = match &job.result.run {
        Some(run) => anyhow!(error).context(super::InRun(run.into())),
        None => anyhow!(error),
    };
    match job.state {
        State::Done => Ok(job),
        State::Cancelled => Err(Failure::Interrupted(error)),
        _ => Err(Failure::of(job.result.status.as_deref().unwrap_or_default(), error)),
    }
}

/// The log of a job that is written while it is read.
struct Log {
    path: PathBuf,
    read: u64,
}

impl Log {
    /// Shows the new lines.
    fn show(&mut self, watcher: &mut dyn Watcher) {
        // without a log the job's end is still reported
        let Ok(mut log) = below::at(&self.path) else { return };
        let mut text = Vec::new();
        if log.seek(SeekFrom::Start(self.read)).and_then(|_| log.read_to_end(&mut text)).is_err() {
            return;
        }
        let whole = text.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
        self.read += whole as u64;
        for line in String::from_utf8_lossy(&text[..whole]).lines() {
            watcher.alert(line);
        }
    }
}
