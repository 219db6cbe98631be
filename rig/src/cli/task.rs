//! `rig task`: one task of a study, a pure function from its file to its result; or several, each in a process of its own.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::{Context as _, anyhow};
use ground::claim::Claim;
use study::carry_out::{Ended, carry_out};
use study::supervise::supervise;

use super::{Failure, Outcome};
use app::interruptible;

/// Arguments of `rig task`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// tasks/ID.json in a study's folder
    #[arg(value_name = "TASK")]
    pub tasks: Vec<PathBuf>,
    /// Each in a process of its own, again where it dies, what it prints to logs/ID.txt: what engines are told
    #[arg(long)]
    pub supervise: bool,
    /// A list of tasks, one a line
    #[arg(long, requires = "supervise", value_name = "FILE")]
    pub list: Option<PathBuf>,
    /// Of the list, every so-manieth
    #[arg(long, requires_all = ["list", "part"], value_name = "N")]
    pub parts: Option<NonZeroUsize>,
    /// The first of those, from 0
    #[arg(long, requires_all = ["list", "parts"], value_name = "N")]
    pub part: Option<usize>,
    /// So many at once
    #[arg(long, requires = "supervise", default_value = "1", value_name = "N")]
    pub workers: NonZeroUsize,
    /// A lock that only one process of this machine has
    #[arg(long, requires = "supervise", value_name = "FILE")]
    pub lock: Option<PathBuf>,
}

/// Carries it out.
///
/// # Errors
/// [`Failure::Data`] where a task is set aside, else as [`carry_out`] and [`supervise`].
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let tasks = listed(args)?;
    if args.supervise {
        let _lock = args
            .lock
            .as_ref()
            .map(|lock| Claim::take("this study", lock))
            .transpose()
            .map_err(Failure::input)?;
        interruptible(async |interrupt| supervise(&tasks, args.workers.get(), &interrupt.flag()))?;
        return Ok(Outcome::default());
    }
    interruptible(async |interrupt| {
        for task in &tasks {
            if carry_out(task, &interrupt.flag())? == Ended::SetAside {
                return Err(Failure::Data(anyhow!(
                    "task {} is set aside; set-aside/ beside its folder says why, `rig study resume --again` tries it again",
                    task.display()
                )));
            }
        }
        Ok(Outcome::default())
    })
}

fn listed(args: &Args) -> Result<Vec<PathBuf>, Failure> {
    let mut tasks = args.tasks.clone();
    if let Some(list) = &args.list {
        let text = std::fs::read_to_string(list).with_context(|| format!("reading {}", list.display()));
        let text = text.map_err(Failure::Input)?;
        let (first, every) = (args.part.unwrap_or(0), args.parts.map_or(1, NonZeroUsize::get));
        tasks.extend(text.lines().skip(first).step_by(every).map(PathBuf::from));
    }
    match tasks.is_empty() && args.list.is_none() {
        true => Err(Failure::Input(anyhow!("no task is named: tasks/ID.json in a study's folder"))),
        false => Ok(tasks),
    }
}
