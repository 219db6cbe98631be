//! `rig jobs`: the queue of a rig, with or without a daemon that works on it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::choice::choice;
use super::{Failure, Outcome};
use config::RigConfig;
use record::run_id::RunId;
use record::stage::Stage;
use store::Store;
use store::goal::Target;
use store::job::{Chosen, Job, JobId, NewJob, State, Work};

/// `rig jobs`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Folder of run folders, whose queue it is
    #[arg(long, global = true, default_value = "runs", value_name = "DIR")]
    pub runs_dir: PathBuf,
    /// What to do
    #[command(subcommand)]
    pub action: Action,
}

/// What to do with the queue.
#[derive(clap::Subcommand, Debug)]
pub enum Action {
    /// List jobs: those that run, those that wait in the order of their turns, then the newest that are over
    Ls {
        /// At most so many
        #[arg(long, default_value_t = 30)]
        most: usize,
    },
    /// Add a job
    Add(Add),
    /// Cancel a job; one that moves the rig is stopped, the servo first
    Cancel {
        /// Its number
        job: JobId,
        /// Why, for who looks at it later
        #[arg(long, default_value = "cancelled by hand")]
        why: String,
    },
    /// Do again what a job that is over should have done
    Retry {
        /// Its number
        job: JobId,
        /// Why, for who looks at it later
        #[arg(long)]
        why: Option<String>,
    },
}

/// A job to add.
#[derive(clap::Args, Debug)]
pub struct Add {
    /// What it does
    #[command(subcommand)]
    pub work: AddWork,
    /// Higher ones come first; of equal ones the older
    #[arg(long, global = true, default_value_t = 0, allow_hyphen_values = true)]
    pub priority: i32,
    /// Why, for who looks at it later
    #[arg(long, global = true)]
    pub why: Option<String>,
    /// It waits until then, for example 2026-11-26T03:00:00Z
    #[arg(long, global = true, value_name = "TIME")]
    pub not_before: Option<jiff::Timestamp>,
}

/// What a job does.
#[derive(clap::Subcommand, Debug)]
pub enum AddWork {
    /// One experiment
    Run {
        /// The rig config
        config: PathBuf,
        /// Film only
        #[arg(long)]
        film_only: bool,
    },
    /// The last good fit, brought up to date with a run
    Recalibrate {
        /// Its id
        run: RunId,
    },
    /// A run's analysis again
    Replay {
        /// Its id
        run: RunId,
        /// What to begin with
        #[arg(long, value_parser = choice::<Stage>(), default_value = "frames")]
        from: Stage,
    },
    /// A fit of runs
    Fit(Runs),
    /// What the simulation of runs gets wrong
    Diagnose(Runs),
    /// Which runs would tell more
    Design(Runs),
    /// Runs until what is asked is known
    Campaign {
        /// The rig config
        config: PathBuf,
        /// A fitted parameter and how well it is to be known, as `rig campaign` takes it; left out: until the diagnosis says one thing
        #[arg(long = "goal", value_name = "GOAL")]
        goals: Vec<Target>,
        /// The most runs it may make
        #[arg(long, default_value_t = 8)]
        max_runs: usize,
    },
}

/// Runs by their ids.
#[derive(clap::Args, Debug)]
pub struct Runs {
    /// To fit
    #[arg(required = true)]
    pub runs: Vec<RunId>,
    /// To score only
    #[arg(long, num_args = 1..)]
    pub holdout: Vec<RunId>,
}

/// Carries out `rig jobs`.
///
/// # Errors
/// [`Failure::Input`] where there is no such job, or it is over; [`Failure::Internal`] where the queue cannot be used.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let mut store = Store::open(&args.runs_dir)?;
    let text = match &args.action {
        Action::Ls { most } => table(&store.jobs(*most)?),
        Action::Add(add) => format!("job {}", store.add(&add.job()?)?),
        Action::Cancel { job, why } => match store.cancel(*job, why)? {
            State::Running => format!("job {job} is told to end"),
            state => format!("job {job} is {state}"),
        },
        Action::Retry { job, why } => format!("job {}", store.retry(*job, why.clone())?),
    };
    Ok(Outcome { text, ..Outcome::default() })
}

impl Add {
    fn job(&self) -> Result<NewJob, Failure> {
        let chosen = |runs: &Runs| Chosen { runs: runs.runs.clone(), holdout: runs.holdout.clone() };
        let work = match &self.work {
            AddWork::Run { config, film_only } => {
                Work::Run { config: usable(config)?, film_only: *film_only }
            }
            AddWork::Campaign { config, goals, max_runs } => {
                Work::Campaign { config: usable(config)?, goals: goals.clone(), max_runs: *max_runs }
            }
            AddWork::Recalibrate { run } => Work::Recalibrate { run: run.clone() },
            AddWork::Replay { run, from } => Work::Replay { run: run.clone(), from: *from },
            AddWork::Fit(runs) => Work::Fit(chosen(runs)),
            AddWork::Diagnose(runs) => Work::Diagnose(chosen(runs)),
            AddWork::Design(runs) => Work::Design(chosen(runs)),
        };
        Ok(NewJob {
            priority: self.priority,
            why: self.why.clone(),
            not_before: self.not_before,
            ..NewJob::new(work)
        })
    }
}

/// The config at `path`, from wherever the daemon looks.
fn usable(path: &Path) -> Result<PathBuf, Failure> {
    RigConfig::read(path).map_err(Failure::input)?;
    std::path::absolute(path).map_err(Failure::input)
}

fn table(jobs: &[Job]) -> String {
    if jobs.is_empty() {
        return "no jobs yet\n".into();
    }
    let mut text = format!(
        "{:>5}  {:<11}  {:<9}  {:>8}  {:<20}  what came of it\n",
        "job", "kind", "state", "priority", "added"
    );
    for job in jobs {
        let result = &job.result;
        let came = match (&result.error, &result.verdict, result.run.as_ref().or(result.out.as_ref())) {
            (Some(error), ..) => error.lines().next().unwrap_or_default().to_owned(),
            (None, Some(verdict), Some(folder)) => format!("{verdict}: {folder}"),
            (None, None, Some(folder)) => folder.clone(),
            _ => job.cancel.as_ref().or(job.why.as_ref()).cloned().unwrap_or_default(),
        };
        let added = job.added.split('.').next().unwrap_or_default();
        let _ = writeln!(
            text,
            "{:>5}  {:<11}  {:<9}  {:>8}  {added:<20}  {came}",
            job.id,
            job.work.kind(),
            job.state,
            job.priority
        );
    }
    text
}
