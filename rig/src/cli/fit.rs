//! `rig fit`: an experiment to coefficients, a calibrated model and a report.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use ident::experiment::Experiment;

use super::progress::Bar;
use super::{Failure, Outcome};
use app::fit::{FILES, FitJob};
use app::{interruptible, threads};
use record::outputs::Outputs;

/// Fits the model of an experiment to its runs.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// experiment.toml, as written by hand or by `rig experiment`; or one run folder
    #[arg(value_name = "EXPERIMENT")]
    pub experiment: PathBuf,
    /// Folder for fit.json, model.xml, report.html and timing.json
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Threads that simulate; the result is the same for any number [default: all cores]
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Go on from where an interrupted fit into the same folder stood
    #[arg(long)]
    pub resume: bool,
    /// 95 % intervals from the profile of the likelihood: a few fits per parameter
    #[arg(long)]
    pub profile: bool,
    /// fit.json of an earlier fit of the same mechanism: updated with these runs, unless they contradict it
    #[arg(long, value_name = "FIT.json", conflicts_with = "resume")]
    pub prior: Option<PathBuf>,
}

/// Carries out `rig fit`.
///
/// # Errors
/// As [`FitJob::carry_out`].
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let read = Experiment::sources(&args.experiment).into_iter().chain(args.prior.clone());
    let out = Outputs::reading(read).folder(&args.out, &FILES)?;
    let job = FitJob {
        experiment: &args.experiment,
        out: &out,
        threads: threads(args.threads),
        resume: args.resume,
        profile: args.profile,
        prior: args.prior.as_deref(),
    };
    interruptible(async |interrupt| {
        let (data, report) = job.carry_out(&mut Bar::new(interrupt.flag()))?;
        let text = format!("{}\n{}\n", report::summary(&data), report.display());
        Ok(Outcome { out: Some(args.out.clone()), warnings: data.warnings, text, ..Outcome::default() })
    })
}
