//! `rig experiment`: run folders to an `experiment.toml` for `rig fit`.

use std::path::{Component, Path, PathBuf};

use anyhow::{Context as _, anyhow};
use ident::experiment::{Experiment, FitConfig, Use};
use ident::weights::{Mechanism, Water};
use serde::{Deserialize, Serialize};

use super::{Failure, Outcome};
use crate::record::folder::{RunFolder, Start, file, write_whole};

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

impl Args {
    /// Of one run to fit, as it was made, written to `out`.
    pub(super) fn of_run(run: &Path, out: &Path) -> Self {
        Self { runs: vec![run.into()], holdout: Vec::new(), model: None, out: out.into() }
    }
}

/// The file, as `ident` reads it.
#[derive(Serialize)]
struct ExperimentFile {
    #[serde(skip_serializing_if = "Option::is_none")]
    model: Option<PathBuf>,
    fit: FitConfig,
    mechanism: Mechanism,
    water: Water,
    run: Vec<RunEntry>,
}

#[derive(Serialize)]
struct RunEntry {
    folder: PathBuf,
    #[serde(rename = "use")]
    usage: Use,
}

/// What an experiment takes over from the config its first run was made with.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct RunConfig {
    fit: FitConfig,
    mechanism: Mechanism,
    water: Water,
}

/// Carries out `rig experiment`.
///
/// # Errors
/// [`Failure::Input`] when a folder is no run, [`Failure::Data`] when a run has nothing to fit.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    if args.runs.is_empty() && args.holdout.is_empty() {
        return Err(Failure::Input(anyhow!("no run was named; give at least one run folder")));
    }
    let out = std::path::absolute(&args.out).map_err(Failure::input)?;
    let home = out.parent().unwrap_or(Path::new("/")).to_path_buf();
    std::fs::create_dir_all(&home)
        .with_context(|| format!("creating {}", home.display()))
        .map_err(Failure::Input)?;

    let mut entries = Vec::new();
    let mut config = None;
    for (usage, path) in
        args.runs.iter().map(|p| (Use::Fit, p)).chain(args.holdout.iter().map(|p| (Use::Holdout, p)))
    {
        let start = usable(path)?;
        if config.is_none() {
            config = Some(run_config(&start, path)?);
        }
        entries.push(RunEntry { folder: relative(path, &home)?, usage });
    }
    let model = args.model.as_ref().map(|model| relative(model, &home)).transpose()?;
    let RunConfig { fit, mechanism, water } = config.unwrap_or_default();
    let file = ExperimentFile { model, fit, mechanism, water, run: entries };
    let text = toml::to_string(&file).map_err(Failure::internal)?;
    write_whole(&args.out, text.as_bytes()).map_err(Failure::input)?;
    // Read back as the fit will read it: what it would refuse is said now.
    let experiment = Experiment::read(&args.out).map_err(unfit)?;
    let fitted = experiment.runs.iter().filter(|run| run.usage == Use::Fit).count();
    let text =
        format!("{}: {fitted} to fit, {} held out\n", args.out.display(), experiment.runs.len() - fitted);
    Ok(Outcome { out: Some(args.out.clone()), text, ..Outcome::default() })
}

/// Sorts a refused experiment by whose fault it is.
pub(super) fn unfit(error: ident::experiment::ExperimentError) -> Failure {
    if error.is_lack_of_data() { Failure::data(error) } else { Failure::input(error) }
}

/// Opens a run folder and sees that it holds a trajectory.
fn usable(path: &Path) -> Result<Start, Failure> {
    let folder = RunFolder::open(path).map_err(Failure::input)?;
    if !folder.file(file::TRAJECTORY).is_file() {
        return Err(Failure::Data(anyhow!(
            "run {} has no {}; extract it first with `rig replay`",
            path.display(),
            file::TRAJECTORY
        )));
    }
    if folder.stop().is_none() {
        tracing::warn!("run {} is incomplete: it has no {}", path.display(), file::STOP);
    }
    Ok(folder.start().clone())
}

fn run_config(start: &Start, path: &Path) -> Result<RunConfig, Failure> {
    toml::from_str(&start.config)
        .with_context(|| format!("reading the config inside {}", path.join(file::START).display()))
        .map_err(Failure::Input)
}

/// `path` as seen from the folder `home`, which is absolute.
fn relative(path: &Path, home: &Path) -> Result<PathBuf, Failure> {
    let canonical = |path: &Path| {
        path.canonicalize().with_context(|| format!("reading {}", path.display())).map_err(Failure::Input)
    };
    Ok(between(&canonical(home)?, &canonical(path)?))
}

/// The way from one absolute folder to another path, both without links and dots.
fn between(from: &Path, to: &Path) -> PathBuf {
    let (from, to): (Vec<_>, Vec<_>) = (from.components().collect(), to.components().collect());
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let up = std::iter::repeat_n(Component::ParentDir, from.len() - common);
    up.chain(to[common..].iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn way_between_folders_goes_up_to_the_common_one_and_down_again() {
        let way = |from: &str, to: &str| between(Path::new(from), Path::new(to));
        assert_eq!(way("/a/b", "/a/runs/1"), Path::new("../runs/1"));
        assert_eq!(way("/a", "/a/runs/1"), Path::new("runs/1"));
        assert_eq!(way("/a/b/c", "/d"), Path::new("../../../d"));
    }
}
