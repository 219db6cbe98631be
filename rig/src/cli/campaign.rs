//! `rig campaign`: runs that are made until what was asked is known.

use std::fmt::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use super::progress::Bar;
use super::{Failure, Outcome};
use app::campaign::record::{Record, Standing};
use app::campaign::{Campaign, FILES};
use app::hand_in::{self, hand_in};
use app::{interruptible, threads};
use config::{RigConfig, paths};
use record::outputs::Outputs;
use store::goal::{Goal, Target};
use store::job::{NewJob, Work};

/// Arguments of `rig campaign`.
#[derive(clap::Args, Debug)]
#[command(group = clap::ArgGroup::new("for").required(true))]
pub struct Args {
    /// The rig config, as of the first run
    pub config: PathBuf,
    /// A fitted parameter and how well it is to be known, one standard deviation: "g3/blunt 5%", or in its SI unit "q2/damping 1e-7"; may
    /// be given again
    #[arg(long = "goal", value_name = "GOAL", group = "for")]
    pub goals: Vec<Target>,
    /// Until the diagnosis says one thing, checked by a run that it was not made from
    #[arg(long, group = "for", conflicts_with = "goals")]
    pub resolve: bool,
    /// The most runs it may make
    #[arg(long, default_value_t = 8)]
    pub max_runs: usize,
    /// Folder of run folders
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
    /// The campaign's folder; where one was interrupted there, it goes on [default: campaign-TIME in the folder of run folders]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Worker threads; as many as there are cores when left out
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// Exit code of a campaign that has ended without reaching its goal.
const GOAL_NOT_REACHED_EXIT_CODE: u8 = 4;

/// Makes runs until the goal is reached, or only a hand can help, or all runs are made; where a daemon holds the rig, that does it.
///
/// # Errors
/// As [`Campaign::carry_out`].
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    RigConfig::read(&args.config).map_err(Failure::input)?;
    if hand_in::daemon(&args.runs_dir).is_some() {
        return handed_in(args);
    }
    let named = || {
        let now = jiff::Timestamp::now().strftime("%Y%m%dT%H%M%SZ");
        args.runs_dir.join(format!("campaign-{now}"))
    };
    let absolute = |path: &Path| std::path::absolute(path).map_err(Failure::input);
    let (config, runs_dir) = (absolute(&args.config)?, absolute(&args.runs_dir)?);
    let out = absolute(&args.out.clone().unwrap_or_else(named))?;
    let folder = Outputs::reading(paths::files(&config)).folder(&out, &FILES)?;
    let campaign = Campaign {
        config: &config,
        runs_dir: &runs_dir,
        out: &folder,
        goal: if args.resolve { Goal::Resolve } else { Goal::Precision(args.goals.clone()) },
        max_runs: args.max_runs,
        threads: threads(args.threads),
    };
    let record = interruptible(async |interrupt| {
        campaign.carry_out(interrupt, &mut Bar::new(interrupt.flag())).await
    })?;
    Ok(Outcome {
        text: text(&record),
        verdict: Some(record.state.name().into()),
        exit_code: if record.state == Standing::Reached { 0 } else { GOAL_NOT_REACHED_EXIT_CODE },
        out: Some(out),
        ..Outcome::default()
    })
}

fn handed_in(args: &Args) -> Result<Outcome, Failure> {
    let config = std::path::absolute(&args.config).map_err(Failure::input)?;
    let why = Some(format!("rig campaign, by process {}", std::process::id()));
    let work = Work::Campaign { config, goals: args.goals.clone(), max_runs: args.max_runs };
    let job = NewJob { why, ..NewJob::new(work) };
    interruptible(async |interrupt| {
        let result = hand_in(&args.runs_dir, &job, interrupt, &mut Bar::new(interrupt.flag())).await?.result;
        let verdict = result.verdict.unwrap_or_default();
        Ok(Outcome {
            exit_code: if verdict == Standing::Reached.name() { 0 } else { GOAL_NOT_REACHED_EXIT_CODE },
            out: result.out.map(PathBuf::from),
            verdict: Some(verdict),
            ..Outcome::default()
        })
    })
}

fn text(record: &Record) -> String {
    let mut text = format!("{}: {}\n", record.state.name(), record.says);
    for (number, made) in record.runs.iter().enumerate() {
        let _ = writeln!(text, "{:>3}  {}  {}", number + 1, made.run, made.why);
    }
    for needed in &record.needs {
        let _ = writeln!(text, "By hand: {needed}");
    }
    if let Some(step) = record.steps.last() {
        let _ = writeln!(text, "{}", step.folder.join(record::folder::file::REPORT).display());
    }
    text
}
