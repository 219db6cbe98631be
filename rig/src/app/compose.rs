//! Run folders put together into an `experiment.toml`.

use std::path::{Component, Path, PathBuf};

use anyhow::{Context as _, anyhow};
use ident::experiment::{CauseConfig, DesignConfig, DiagnoseConfig, Experiment, FitConfig, RunKind, Use};
use ident::weights::{Mechanism, Water};
use serde::{Deserialize, Serialize};

use super::Failure;
use super::design::limits;
use crate::camera::CameraConfig;
use crate::outputs::OutputFile;
use crate::profile::ProfileConfig;
use crate::record::folder::{RunFolder, file};
use crate::record::start_stop::Start;
use crate::servo::ServoConfig;

/// The file, as `ident` reads it.
#[derive(Serialize)]
struct ExperimentFile {
    #[serde(skip_serializing_if = "Option::is_none")]
    model: Option<PathBuf>,
    fit: FitConfig,
    diagnose: DiagnoseConfig,
    design: DesignConfig,
    mechanism: Mechanism,
    water: Water,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    cause: Vec<CauseConfig>,
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
    diagnose: DiagnoseConfig,
    mechanism: Mechanism,
    water: Water,
    cause: Vec<CauseConfig>,
    camera: CameraConfig,
    servo: Option<ServoConfig>,
    profile: Option<ProfileConfig>,
}

/// Writes the experiment of the run folders `runs` to `out`, with the model they were made with or another, and gives it as a fit
/// reads it. `drops`: whether somebody is there to let go of the mechanism in a next run.
///
/// # Errors
/// [`Failure::Input`] when a folder is no run, [`Failure::Data`] when a run has nothing to fit.
pub fn compose(
    runs: &[(Use, &Path)],
    model: Option<&Path>,
    drops: bool,
    out: &OutputFile,
) -> Result<Experiment, Failure> {
    let home = out.place().parent().unwrap_or(Path::new("/"));
    let mut entries = Vec::new();
    let (mut config, mut design) = (None, None);
    let (mut known, mut suspected) = (FitConfig::default(), DiagnoseConfig::default());
    for &(usage, path) in runs {
        let start = usable(path)?;
        let made_with = run_config(&start, path)?;
        if start.kind == RunKind::Driven {
            made_with.camera.put_clock_into(&mut known);
            if let Some(servo) = &made_with.servo {
                servo.put_measured_into(&mut known, &mut suspected);
            }
        }
        design.get_or_insert(limits(made_with.servo.as_ref(), made_with.profile.as_ref()));
        config.get_or_insert(made_with);
        entries.push(RunEntry { folder: relative(path, home)?, usage });
    }
    let model = model.map(|model| relative(model, home)).transpose()?;
    let RunConfig { mut fit, mut diagnose, mechanism, water, cause, .. } = config.unwrap_or_default();
    for (name, prior) in known.prior {
        fit.prior.entry(name).or_insert(prior);
    }
    for (name, bounds) in known.bounds {
        fit.bounds.entry(name).or_insert(bounds);
    }
    for (name, prior) in suspected.prior {
        diagnose.prior.entry(name).or_insert(prior);
    }
    let design = DesignConfig { drops, ..design.unwrap_or_default() };
    let file = ExperimentFile { model, fit, diagnose, design, mechanism, water, cause, run: entries };
    let text = toml::to_string(&file).map_err(Failure::internal)?;
    out.write(text.as_bytes()).map_err(Failure::input)?;
    // Read back as the fit will read it: what it would refuse is said now.
    Ok(Experiment::read(out.path())?)
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
    let mut config: RunConfig = toml::from_str(&start.config)
        .with_context(|| format!("reading the config inside {}", path.join(file::START).display()))
        .map_err(Failure::Input)?;
    if let Some(servo) = &mut config.servo {
        servo.read_calibrations(path).map_err(Failure::input)?;
    }
    Ok(config)
}

/// `path` as seen from the folder `home`, which is absolute and without links.
fn relative(path: &Path, home: &Path) -> Result<PathBuf, Failure> {
    let reading = || format!("reading {}", path.display());
    Ok(between(home, &path.canonicalize().with_context(reading).map_err(Failure::Input)?))
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
