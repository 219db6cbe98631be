//! `rig diagnose`: what the simulation of an experiment gets wrong, why, and what naming it gains.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use ident::experiment::Experiment;

use super::progress::Bar;
use super::{Failure, Outcome};
use app::compose::shortfalls;
use app::diagnose::{FILES, diagnosed};
use app::{INTERRUPTED, interruptible, threads};
use config::paths;
use record::outputs::Outputs;

/// Says what the simulation gets wrong, and why.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// experiment.toml, as written by hand or by `rig experiment`; or one run folder
    #[arg(value_name = "EXPERIMENT")]
    pub experiment: PathBuf,
    /// Folder for diagnosis.json, the extended model.xml, report.html and timing.json
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Threads that simulate; the result is the same for any number [default: all cores]
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Config of the rig: with it, configs of the runs to make next are written to DIR/next [default: the one that a run folder says it was
    /// made with]
    #[arg(long, value_name = "RIG.toml")]
    pub config: Option<PathBuf>,
    /// Exit with 0 where nothing is detectable, 10 where a cause is named, 11 where several would do, 12 where none does
    #[arg(long)]
    pub exit_code: bool,
}

/// Carries out `rig diagnose`.
///
/// # Errors
/// As [`diagnosed`]. After a signal the best so far is written and printed, and the exit code is that of a signal.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let config = args.config.iter().flat_map(|config| paths::files(config));
    let read = Experiment::sources(&args.experiment).into_iter().chain(config);
    let out = Outputs::reading(read).folder(&args.out, &FILES)?;
    interruptible(async |interrupt| {
        let mut bar = Bar::new(interrupt.flag());
        let (experiment, config) = (&args.experiment, args.config.as_deref());
        let (diagnosed, report) = diagnosed(experiment, &out, threads(args.threads), config, &mut bar)?;
        let verdict = diagnosed.diagnosis.verdict;
        let text = format!("{}\n{}\n", report::diagnosis_summary(&diagnosed.diagnosis), report.display());
        Ok(Outcome {
            out: Some(args.out.clone()),
            verdict: Some(verdict.name().into()),
            exit_code: match args.exit_code {
                _ if interrupt.is_raised() => INTERRUPTED,
                true => verdict.exit_code(),
                false => 0,
            },
            warnings: shortfalls(experiment),
            text,
            ..Outcome::default()
        })
    })
}
