//! `rig daemon`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use super::progress::Bar;
use super::{Failure, Outcome};
use crate::app::daemon::Daemon;
use crate::app::experiment::{Experiment, Extent};
use crate::app::{base, interruptible, threads};
use crate::config::RigConfig;

/// Arguments of `rig daemon`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig config, with a table `[schedule]`
    pub config: PathBuf,
    /// Folder of run folders, and of the daemon's own journal
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
    /// End after so many runs; 0 for never
    #[arg(long, default_value_t = 0)]
    pub max_runs: u64,
    /// Worker threads; as many as there are cores when left out
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// Runs until a signal comes, or until `--max-runs` runs have ended.
///
/// # Errors
/// As [`Daemon::new`] and [`Daemon::serve`].
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let config = RigConfig::read(&args.config).map_err(Failure::input)?;
    let daemon = Daemon::new(Experiment {
        config: &config,
        base: base(&args.config),
        runs_dir: &args.runs_dir,
        extent: Extent::Report,
        motion: None,
        threads: threads(args.threads),
    })?;
    let runs = interruptible(async |interrupt| {
        daemon.serve(args.max_runs, interrupt, &mut Bar::new(interrupt.flag())).await
    })?;
    Ok(Outcome { out: Some(args.runs_dir.clone()), text: format!("{runs} runs"), ..Outcome::default() })
}
