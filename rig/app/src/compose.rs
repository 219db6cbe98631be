//! Run folders put together into an `experiment.toml`.

use config::measured;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context as _, anyhow};
use ident::experiment::{CauseConfig, DesignConfig, DiagnoseConfig, Experiment, FitConfig, RunKind, Use};
use ident::weights::{Mechanism, Water};
use serde::{Deserialize, Serialize};

use super::design::limits;
use super::{Failure, base};
use camera::CameraConfig;
use record::folder::{RunFolder, file};
use record::losses::{Limits, Losses};
use record::outputs::OutputFile;
use record::start_stop::Start;
use servo::ServoConfig;
use servo::profile::ProfileConfig;

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

/// An experiment, and what it was read from.
pub struct Given {
    /// As a fit takes it.
    pub experiment: Experiment,
    /// As `experiment.toml` says it.
    pub text: String,
    /// The config of its rig, where that is known.
    pub config: Option<PathBuf>,
}

/// What is at `path`: an `experiment.toml`; or a run folder, which is the experiment of that run alone.
///
/// # Errors
/// [`Failure::Input`] when it is neither, [`Failure::Data`] when the run has nothing to fit.
pub fn given(path: &Path) -> Result<Given, Failure> {
    if path.join(file::START).is_file() {
        let home = path.canonicalize().map_err(Failure::input)?;
        let text = composed(&[(Use::Fit, path)], None, true, &home)?;
        let experiment = Experiment::parse(&text, &home.join(EXPERIMENT))?;
        return Ok(Given { experiment, text, config: config_of(path) });
    }
    if path.is_dir() {
        let found = path.join(EXPERIMENT);
        return Err(Failure::Input(match found.is_file() {
            true => anyhow!("{} is a folder; did you mean {}?", path.display(), found.display()),
            false => anyhow!(
                "{} is a folder, and no run's: an experiment.toml or one run folder is wanted; `rig experiment RUN... --out {EXPERIMENT}` \
                 makes one of several run folders",
                path.display()
            ),
        }));
    }
    let experiment = Experiment::read(path)?;
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("reading {}", path.display()))
        .map_err(Failure::Input)?;
    Ok(Given { experiment, text, config: None })
}

/// The config of the rig that made the run in the folder `path`, where it is one and says so.
pub fn config_of(path: &Path) -> Option<PathBuf> {
    // a folder that cannot be opened is reported by the code that reads it
    RunFolder::open(path).ok()?.start().config_path().map(Path::to_owned)
}

/// The usual name of an experiment's file.
pub const EXPERIMENT: &str = "experiment.toml";

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
    out.write(composed(runs, model, drops, home)?.as_bytes()).map_err(Failure::input)?;
    // Read back as the fit will read it: what it would refuse is said now.
    Ok(Experiment::read(out.path())?)
}

/// The text of the experiment of `runs`, for a file in the folder `home`.
fn composed(
    runs: &[(Use, &Path)],
    model: Option<&Path>,
    drops: bool,
    home: &Path,
) -> Result<String, Failure> {
    let mut entries = Vec::new();
    let (mut config, mut design) = (None, None);
    let (mut known, mut suspected) = (FitConfig::default(), DiagnoseConfig::default());
    for &(usage, path) in runs {
        let start = usable(path)?;
        let made_with = run_config(&start, path)?;
        if start.kind == RunKind::Driven {
            measured::put_into(&made_with.camera, made_with.servo.as_ref(), &mut known, &mut suspected);
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
    toml::to_string(&file).map_err(Failure::internal)
}

/// Why nothing may be promoted that is made from the run in the folder `path`: it lacks too many images.
pub fn degraded(path: &Path) -> Option<String> {
    // a folder that cannot be opened is reported by the code that needs it
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
    // a file that cannot be read is reported by the fit
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
    let here = (common == from.len() && common == to.len()).then_some(Component::CurDir);
    here.into_iter().chain(up).chain(to[common..].iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use record::fixtures;

    #[test]
    fn run_folder_is_an_experiment_of_its_own() {
        let runs = tempfile::tempdir().unwrap();
        let start = Start { kind: RunKind::Free, ..fixtures::start("20261120T101503Z-ab12cd") };
        let run = RunFolder::create(runs.path(), start).unwrap();
        let model = include_bytes!("../../../configs/models/chain-passive.xml");
        run.write(file::MODEL_START, model).unwrap();
        run.write(
            file::TRAJECTORY,
            b"time_s,P1_x_m,P1_z_m\n0,0.01,-0.02\n0.1,0.02,-0.02\n0.2,0.02,-0.01\n0.3,0.01,-0.02\n",
        )
        .unwrap();
        let Given { experiment, text, config } = given(run.path()).unwrap();
        assert_eq!(experiment.runs.len(), 1);
        assert_eq!((experiment.runs[0].id.as_str(), config), ("20261120T101503Z-ab12cd", None));
        assert!(text.contains("folder = \".\""), "{text}");
        assert!(!run.file(EXPERIMENT).exists(), "nothing is written into a run");

        let error = given(runs.path()).err().unwrap();
        assert!(error.error().to_string().contains("rig experiment RUN..."), "{}", error.error());
    }

    #[test]
    fn way_between_folders_goes_up_to_the_common_one_and_down_again() {
        let way = |from: &str, to: &str| between(Path::new(from), Path::new(to));
        assert_eq!(way("/a/b", "/a/runs/1"), Path::new("../runs/1"));
        assert_eq!(way("/a", "/a/runs/1"), Path::new("runs/1"));
        assert_eq!(way("/a/b/c", "/d"), Path::new("../../../d"));
        assert_eq!(way("/a/b", "/a/b"), Path::new("."));
    }
}
