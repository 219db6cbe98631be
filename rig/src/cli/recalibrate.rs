//! `rig recalibrate`: the last good fit of a rig, brought up to date with a run.

use std::fmt::Write as _;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use ident::experiment::Use;

use super::progress::Bar;
use super::{Failure, Outcome};
use analysis::Progress as _;
use app::compose::{compose, degraded};
use app::drift::moved;
use app::last_good::{LastGood, Recalibrated, VERDICT, Verdict};
use app::{interruptible, on_threads, threads};
use ground::error_chain::with_causes;
use record::folder::RunFolder;
use record::outputs::{OutputFile, OutputFolder};
use store::Store;

/// What the last good fit is brought up to date with, in the folder of the run.
const EXPERIMENT: &str = "experiment.toml";

/// Brings the last good fit up to date with a run, unless the run contradicts it.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The run folder
    pub run: PathBuf,
    /// Folder of run folders, whose `last-good` it is
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
    /// Worker threads; as many as there are cores when left out
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// Carries out `rig recalibrate`: the verdict is `updated` or `kept`.
///
/// # Errors
/// As [`compose`] and [`LastGood::update`]; the last good fit stays.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let good = LastGood::among(&args.runs_dir);
    let out = OutputFolder::of_run(&RunFolder::open(&args.run).map_err(Failure::input)?);
    let source = args.run.display().to_string();
    let verdict = match degraded(&args.run) {
        Some(why) => good.keep(why),
        None => updated(args, &out.file(EXPERIMENT), &good, &source)?,
    };
    // an index that cannot be read or written hides a slow drift, and nothing else
    let moved = Store::open(&args.runs_dir).and_then(|mut store| moved(&mut store)).unwrap_or_else(|error| {
        tracing::warn!("slow drift was not looked for: {}", with_causes(&error));
        Vec::new()
    });
    let (word, mut text) = match verdict.updated {
        true => ("updated", format!("{} is up to date with {source}", good.folder().display())),
        false => ("kept", format!("{} stays: {}", good.folder().display(), verdict.why.join("; "))),
    };
    for moved in &moved {
        let _ = write!(text, "\n{moved}");
    }
    let warnings = if verdict.degraded { verdict.why.clone() } else { Vec::new() };
    out.write_json(VERDICT, &Recalibrated { verdict, moved }).map_err(Failure::internal)?;
    Ok(Outcome {
        out: Some(good.folder().into()),
        run: Some(args.run.clone()),
        verdict: Some(word.into()),
        warnings,
        text,
        ..Outcome::default()
    })
}

fn updated(args: &Args, file: &OutputFile, good: &LastGood, source: &str) -> Result<Verdict, Failure> {
    let experiment = compose(&[(Use::Fit, &args.run)], None, true, file)?;
    interruptible(async |interrupt| {
        let mut bar = Bar::new(interrupt.flag());
        bar.begin("fit", Some(experiment.fit.max_evaluations));
        tokio::task::block_in_place(|| {
            on_threads(threads(args.threads), || good.update(&experiment, source, &mut bar))
        })
    })
}
