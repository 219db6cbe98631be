//! Run folders put together into an `experiment.toml`.

use std::path::{Component, Path, PathBuf};

use anyhow::{Context as _, anyhow};
use ident::experiment::{CauseConfig, DesignConfig, DiagnoseConfig, Experiment, FitConfig, RunKind, Use};
use ident::weights::{Mechanism, Water};
use serde::{Deserialize, Serialize};

use super::design::limits;
use super::{Failure, base};
use crate::camera::CameraConfig;
use crate::profile::ProfileConfig;
use crate::record::files::write_whole;
use crate::record::folder::{RunFolder, file};
use crate::record::losses::{Limits, Losses};
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
    out: &Path,
) -> Result<Experiment, Failure> {
    let whole = std::path::absolute(out).map_err(Failure::input)?;
    let home = whole.parent().unwrap_or(Path::new("/"));
    std::fs::create_dir_all(home)
        .with_context(|| format!("creating {}", home.display()))
        .map_err(Failure::Input)?;

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
    write_whole(out, text.as_bytes()).map_err(Failure::input)?;
    // Read back as the fit will read it: what it would refuse is said now.
    Ok(Experiment::read(out)?)
}

/// Why nothing may be promoted that is made from the run in the folder `path`: it lacks too many images.
pub fn degraded(path: &Path) -> Option<String> {
    // what cannot be opened is told by whoever needs it
    let run = RunFolder::open(path).ok()?;
    Losses::of(&run).degraded(&Limits::of(&run))
}

/// What the runs of the experiment at `path` lack, one sentence each: of those that are run folders.
pub fn shortfalls(path: &Path) -> Vec<String> {
    #[derive(Deserialize)]
    struct Named {
        #[serde(default)]
        run: Vec<Folder>,
    }
    #[derive(Deserialize)]
    struct Folder {
        folder: Option<PathBuf>,
    }
    // what cannot be read is told by the fit
    let named = std::fs::read_to_string(path).ok().and_then(|text| toml::from_str::<Named>(&text).ok());
    let folders = named.into_iter().flat_map(|named| named.run).filter_map(|run| run.folder);
    let runs = folders.filter_map(|folder| RunFolder::open(&base(path).join(folder)).ok());
    runs.filter_map(|run| {
        let losses = Losses::of(&run);
        let missing =
            losses.degraded(&Limits::of(&run)).or_else(|| losses.say().filter(|_| losses.unread > 0));
        let why: Vec<String> = run.incomplete().into_iter().chain(missing).collect();
        (!why.is_empty()).then(|| format!("Run {}: {}.", run.start().id, why.join("; ")))
    })
    .collect()
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
    if let Some(why) = folder.incomplete() {
        tracing::warn!("run {} is incomplete: {why}", path.display());
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
