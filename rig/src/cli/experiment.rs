//! `rig experiment`: run folders to an `experiment.toml` for `rig fit`.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use ident::experiment::Use;

use super::{Failure, Outcome};
use app::compose::compose;
use record::outputs::Outputs;

/// Gathers runs into an experiment.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Run folders to fit
    #[arg(value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Run folders that are only scored, never fitted
    #[arg(long, value_name = "RUN", num_args = 1..)]
    holdout: Vec<PathBuf>,
    /// The model to fit; left out: the one the runs were made with
    #[arg(long, value_name = "MODEL.xml")]
    model: Option<PathBuf>,
    /// Where to write the experiment
    #[arg(long, value_name = "E.toml")]
    out: PathBuf,
}

/// Carries out `rig experiment`.
///
/// # Errors
/// As [`compose`].
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let fitted = args.runs.iter().map(|path| (Use::Fit, path.as_path()));
    let held_out = args.holdout.iter().map(|path| (Use::Holdout, path.as_path()));
    let runs: Vec<(Use, &Path)> = fitted.chain(held_out).collect();
    if runs.is_empty() {
        return Err(Failure::Input(anyhow!("no run was named; give at least one run folder")));
    }
    let read = runs.iter().map(|(_, path)| path.to_path_buf()).chain(args.model.clone());
    let out = Outputs::reading(read).file(&args.out)?;
    let experiment = compose(&runs, args.model.as_deref(), true, &out)?;
    let fitted = experiment.runs.iter().filter(|run| run.usage == Use::Fit).count();
    let text =
        format!("{}: {fitted} to fit, {} held out\n", args.out.display(), experiment.runs.len() - fitted);
    Ok(Outcome { out: Some(args.out.clone()), text, ..Outcome::default() })
}
