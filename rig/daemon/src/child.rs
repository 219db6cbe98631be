//! A job as a process of its own: a crash, a hang or a leak of one job is that job's alone.
//!
//! Its folder `RUNS/jobs/<id>` holds its output: `result.json`, the one object of `--json`, and `log.txt`; and while it runs the socket
//! of its live view. If the daemon is killed, the job goes on without it, and the next daemon adopts the job by these files.

#![allow(clippy::disallowed_methods, reason = "what a job prints")]

use std::fs::File;
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::process::{
    Pid, PidfdFlags, Signal, kill_process, pidfd_open, pidfd_send_signal, setpriority_process,
};

use app::hand_in::{self, Order, file, folder};
use app::{Failure, HELD};
use app::{recover, stop};
use config::RigConfig;
use ground::claim::Claim;
use ground::urgency::Urgency;
use record::below;
use record::files::create_folder;
use record::run_id::RunId;
use store::job::{Job, JobId, JobResult, Lane, State, Work};

/// Time that a job has to end when asked; then its process is killed, and the board's dead-man stops what still moves. Chosen.
const JOB_END_TIMEOUT: Duration = Duration::from_secs(4);
/// Length of the end of the log that is quoted for a job that ended without a result \[bytes\]. Chosen.
const LOG_EXCERPT_BYTES: usize = 600;

/// Starts jobs and clears up after them.
pub(super) trait Jobs {
    /// Begins `job`; `origin` is the job that it repeats first of all, or itself.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be begun.
    fn start(&mut self, job: &Job, origin: JobId) -> Result<Box<dyn Running>, Failure>;

    /// A job that an earlier daemon began and that still goes on.
    fn adopt(&mut self, job: &Job) -> Option<Box<dyn Running>>;

    /// Begins to clear up after a job that was killed: servos in an unknown state, runs without an end. Nothing moves meanwhile.
    fn clear_up(&mut self);

    /// Whether the clearing up is under way.
    fn is_clearing_up(&self) -> bool;

    /// The recovered runs and what became of them, once it is over.
    fn take_recovered_runs(&mut self) -> Vec<(RunId, String)>;
}

/// A job that is running.
pub(super) trait Running {
    /// Its number.
    fn id(&self) -> JobId;

    /// Its process.
    fn pid(&self) -> Pid;

    /// Asks it to end, the servo first; one that has not ended some seconds later is killed.
    fn end(&mut self);

    /// How it ended, once it has; the same however often it is asked.
    ///
    /// # Errors
    /// [`Failure::Internal`] when the system does not say.
    fn ended(&mut self) -> Result<Option<(State, JobResult)>, Failure>;
}

/// Jobs as processes of this program.
pub(super) struct Processes {
    /// The folder of run folders.
    pub(super) runs_dir: PathBuf,
    /// The rig's config.
    pub(super) config: PathBuf,
    /// Worker threads of each.
    pub(super) threads: usize,
    /// The thread that clears up after a killed job.
    pub(super) clearing: Option<JoinHandle<Vec<(RunId, String)>>>,
}

impl Jobs for Processes {
    fn clear_up(&mut self) {
        let (runs_dir, config) = (self.runs_dir.clone(), self.config.clone());
        self.clearing.get_or_insert_with(|| {
            std::thread::spawn(move || {
                if let Ok(config) = RigConfig::read(&config) {
                    stop::settle(&config, &runs_dir);
                }
                recover::unfinished_in(&runs_dir)
            })
        });
    }

    fn is_clearing_up(&self) -> bool {
        self.clearing.is_some()
    }

    fn take_recovered_runs(&mut self) -> Vec<(RunId, String)> {
        let over = self.clearing.take_if(|clearing| clearing.is_finished());
        // a panic prints its own message, and the next run tries again
        over.map(|clearing| clearing.join().unwrap_or_default()).unwrap_or_default()
    }

    fn start(&mut self, job: &Job, origin: JobId) -> Result<Box<dyn Running>, Failure> {
        Ok(Box::new(JobProcess::start((job, origin), &self.runs_dir, &self.config, self.threads)?))
    }

    fn adopt(&mut self, job: &Job) -> Option<Box<dyn Running>> {
        Some(Box::new(JobProcess::adopt(job, &self.runs_dir)?))
    }
}

/// A job's process.
#[derive(Debug)]
struct JobProcess {
    id: JobId,
    folder: PathBuf,
    process: Process,
    end_requested: Option<Instant>,
}

#[derive(Debug)]
enum Process {
    /// Started by this daemon.
    Started(Child),
    /// One that an earlier daemon began, by its number, which may be given out again, and by a handle, which stays.
    Adopted(Pid, OwnedFd),
}

impl JobProcess {
    /// Begins `job`, whose rig's config is at `config`, with so many threads; `origin` is the job that it repeats first of all, or
    /// itself.
    ///
    /// # Errors
    /// [`Failure`] when the process cannot be started, or the job names runs that cannot be used.
    fn start(
        (job, origin): (&Job, JobId),
        runs_dir: &Path,
        config: &Path,
        threads: usize,
    ) -> Result<Self, Failure> {
        let folder = folder(runs_dir, job.id);
        create_folder(&folder).map_err(Failure::internal)?;
        // a campaign goes on where it stopped, so it stays in the folder in which it began
        let out = match job.work {
            Work::Campaign { .. } => self::folder(runs_dir, origin),
            _ => folder.clone(),
        };
        let (runs_dir, config) = (runs_dir.to_owned(), config.to_owned());
        Order { work: job.work.clone(), runs_dir, out, config, threads }.write(&folder)?;
        let mut command = Command::new(std::env::current_exe().map_err(Failure::internal)?);
        command.args(["--json", "job"]).arg(&folder);
        command
            .env(hand_in::JOB_VARIABLE, job.id.to_string())
            .env(hand_in::LIVE_VARIABLE, folder.join(file::LIVE));
        // Ctrl-C at a terminal is for the daemon: with its own signal as the second one, the job would end at once
        command.process_group(0);
        // the manager is the daemon's
        command.env_remove("NOTIFY_SOCKET").env_remove("WATCHDOG_USEC");
        let create = |name| File::create(folder.join(name)).map_err(Failure::internal);
        command.stdin(Stdio::null()).stdout(create(file::RESULT)?).stderr(create(file::LOG)?);
        let child = command.spawn().map_err(Failure::internal)?;
        if job.work.lane() == Lane::Analysis {
            // if this fails, the job runs at normal priority
            let _ = setpriority_process(Some(Pid::from_child(&child)), Urgency::Computing.niceness());
        }
        Ok(Self { id: job.id, folder, process: Process::Started(child), end_requested: None })
    }

    /// A job that an earlier daemon began and whose process still lives.
    fn adopt(job: &Job, runs_dir: &Path) -> Option<Self> {
        // a daemon that was killed just after it began the job has not written by which process it is done
        let pid = job.pid.or_else(|| Claim::holder(&recover::lock(runs_dir)));
        let pid = pid.and_then(|pid| Pid::from_raw(i32::try_from(pid).ok()?))?;
        let handle = pidfd_open(pid, PidfdFlags::empty()).ok()?;
        // numbers of processes are given out again: it must say itself that it does this job
        let environment = std::fs::read(format!("/proc/{}/environ", pid.as_raw_nonzero())).ok()?;
        let mark = format!("{}={}", hand_in::JOB_VARIABLE, job.id);
        environment.split(|&byte| byte == 0).find(|&entry| entry == mark.as_bytes())?;
        Some(Self {
            id: job.id,
            folder: folder(runs_dir, job.id),
            process: Process::Adopted(pid, handle),
            end_requested: None,
        })
    }
}

impl Running for JobProcess {
    fn id(&self) -> JobId {
        self.id
    }

    fn pid(&self) -> Pid {
        match &self.process {
            Process::Started(child) => Pid::from_child(child),
            Process::Adopted(pid, _) => *pid,
        }
    }

    fn end(&mut self) {
        let signal = match self.end_requested {
            None => Signal::TERM,
            Some(requested) if requested.elapsed() > JOB_END_TIMEOUT => Signal::KILL,
            Some(_) => return,
        };
        if self.end_requested.is_none() {
            self.end_requested = Some(Instant::now());
        }
        // one that has ended meanwhile needs no signal
        let _ = match &self.process {
            Process::Started(child) => kill_process(Pid::from_child(child), signal),
            Process::Adopted(_, handle) => pidfd_send_signal(handle, signal),
        };
    }

    fn ended(&mut self) -> Result<Option<(State, JobResult)>, Failure> {
        let how = match &mut self.process {
            Process::Started(child) => match child.try_wait().map_err(Failure::internal)? {
                None => return Ok(None),
                Some(status) => status.to_string(),
            },
            // readable once it has ended, also in a container whose first process never asks how others ended
            Process::Adopted(_, handle) => {
                match poll(&mut [PollFd::new(handle, PollFlags::IN)], Some(&Timespec::default())) {
                    Ok(0) | Err(Errno::INTR) => return Ok(None),
                    Ok(_) => "its process is gone".into(),
                    Err(error) => return Err(Failure::internal(error)),
                }
            }
        };
        Ok(Some(result(&self.folder, &how)))
    }
}

/// State and result of the job in `folder`; `how` its process ended is the error if it left no result.
pub(super) fn result(folder: &Path, how: &str) -> (State, JobResult) {
    let output = below::read_at(&folder.join(file::RESULT)).ok();
    let output: Option<JobResult> = output.and_then(|output| serde_json::from_slice(&output).ok());
    let Some(result) = output else {
        let log = below::read_at(&folder.join(file::LOG)).unwrap_or_default();
        let end =
            String::from_utf8_lossy(&log[log.len().saturating_sub(LOG_EXCERPT_BYTES)..]).trim().to_owned();
        let error = if end.is_empty() { how.to_owned() } else { format!("{how}: {end}") };
        return (State::Lost, JobResult { error: Some(error), ..JobResult::default() });
    };
    let state = match result.status.as_deref() {
        Some("done") => State::Done,
        Some("interrupted") => State::Cancelled,
        // nothing of it was begun
        Some(HELD) if result.run.is_none() => State::Queued,
        _ => State::Failed,
    };
    (state, result)
}
