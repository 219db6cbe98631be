//! `experiment.toml` as text.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;
use sim::{Model, Trajectory};

use super::folder::{Folder, read_text};
use super::{DEFAULT_INIT_S, Experiment, ExperimentError, Run, RunKind, Use};
use crate::config::{DesignConfig, DiagnoseConfig, FitConfig};
use crate::own_cause::CauseConfig;
use crate::table::{MeasuredAngles, ServoTable, read_base, read_servo, read_trajectory};
use crate::weights::{Mechanism, Water};
use ground::names;
use ground::strict::{self, Finite, Positive, StrictError};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    model: Option<PathBuf>,
    prescribed: Option<bool>,
    noise_m: Option<Positive>,
    #[serde(default)]
    fit: FitConfig,
    #[serde(default)]
    diagnose: DiagnoseConfig,
    #[serde(default)]
    design: DesignConfig,
    #[serde(default)]
    mechanism: Mechanism,
    #[serde(default)]
    water: Water,
    #[serde(default)]
    cause: Vec<CauseConfig>,
    #[serde(default)]
    run: Vec<Entry>,
}

/// One `[[run]]`. What is missing or too much is said by run, in [`Entry::load`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    id: Option<String>,
    kind: Option<RunKind>,
    trajectory: Option<PathBuf>,
    servo: Option<PathBuf>,
    base: Option<PathBuf>,
    folder: Option<PathBuf>,
    release_s: Option<Finite>,
    #[serde(default, rename = "use")]
    usage: Use,
    init_s: Option<Positive>,
    weight: Option<Positive>,
    hold: Option<Hold>,
    #[serde(default)]
    times: BTreeMap<String, Positive>,
}

/// What a command is between its rows.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Hold {
    /// Straight from one to the next.
    Straight,
    /// Each until the next.
    Steps,
}

impl Experiment {
    /// The experiment.toml at `path`, and the files and run folders that it names, which [`Self::read`] reads. One that cannot be read names
    /// none: why, says its reader.
    pub fn sources(path: &Path) -> Vec<PathBuf> {
        let file: Option<File> =
            std::fs::read_to_string(path).ok().and_then(|text| toml::from_str(&text).ok());
        let base = path.parent().unwrap_or(Path::new(""));
        let named = file.iter().flat_map(|file| {
            let of_run =
                |run: &'_ Entry| [&run.folder, &run.trajectory, &run.servo, &run.base].map(Clone::clone);
            file.run.iter().flat_map(of_run).chain([file.model.clone()]).flatten()
        });
        std::iter::once(path.to_owned()).chain(named.map(|named| base.join(named))).collect()
    }

    /// Reads `experiment.toml` at `path` and everything it names; relative paths start at the file.
    ///
    /// # Errors
    /// [`ExperimentError`], naming the file, and within it the line or the run.
    pub fn read(path: &Path) -> Result<Self, ExperimentError> {
        let text =
            names::read_text(path).map_err(|source| StrictError::Unreadable { path: path.into(), source })?;
        Self::parse(&text, path)
    }

    /// Reads the experiment from `text`, as [`Experiment::read`] would at `path`.
    ///
    /// # Errors
    /// As [`Experiment::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, ExperimentError> {
        let experiment = load(strict::parse(text, path)?, path).and_then(|experiment| {
            experiment.check()?;
            experiment.check_names()?;
            Ok(experiment)
        });
        experiment.map_err(|error| error.located(path, text))
    }
}

fn load(file: File, path: &Path) -> Result<Experiment, ExperimentError> {
    let base = path.parent().unwrap_or(Path::new(""));
    let mut runs = Vec::new();
    let mut models: Vec<(PathBuf, String)> = Vec::new();
    for (number, entry) in file.run.iter().enumerate() {
        let folder = entry.folder.as_ref().map(|folder| Folder::read(&base.join(folder))).transpose()?;
        if let (Some(folder), None) = (&folder, &file.model) {
            models.push(folder.model()?);
        }
        runs.push(entry.load(number + 1, base, folder, file.prescribed)?);
    }
    let (model_path, text) = match (&file.model, models.split_first()) {
        (Some(model), _) => {
            let path = base.join(model);
            // where it is not there, this knows what may have been meant
            read_text("model", &path)?;
            match sim::mjcf::alone(&path) {
                Ok(text) => (path, text),
                Err(source) => return Err(ExperimentError::Model { path, source: source.into() }),
            }
        }
        (None, Some((first, others))) => {
            if let Some(other) = others.iter().find(|other| other.1 != first.1) {
                return Err(ExperimentError::Models { first: first.0.clone(), second: other.0.clone() });
            }
            first.clone()
        }
        (None, None) if file.run.is_empty() => return Err(ExperimentError::NoRuns),
        (None, None) => return Err(ExperimentError::NoModel { path: path.into() }),
    };
    let mut model = Model::from_mjcf(&text)
        .map_err(|source| ExperimentError::Model { path: model_path, source: source.into() })?;
    let mut fit = file.fit;
    file.mechanism.put_into(&file.water, &mut model, &mut fit)?;
    CauseConfig::define(&file.cause, &mut model)?;
    let mut experiment = Experiment {
        model,
        noise_m: file.noise_m.map(Positive::get),
        fit,
        diagnose: file.diagnose,
        design: file.design,
        runs,
    };
    experiment.take_in_measured();
    experiment.set_adrift();
    experiment.fit.add_named_causes(&mut experiment.model);
    Ok(experiment)
}

/// The instants at which servos measured, with nothing seen at them yet.
fn instants(measured: &[MeasuredAngles]) -> Trajectory {
    let mut time_s: Vec<f64> = measured.iter().flat_map(|angles| angles.time_s.iter().copied()).collect();
    time_s.sort_by(f64::total_cmp);
    time_s.dedup();
    Trajectory { time_s, ..Trajectory::default() }
}

impl Entry {
    /// `table`, its rows held until the next where this says so.
    fn held(&self, mut table: ServoTable) -> ServoTable {
        // one that says so itself is so already
        if matches!(self.hold, Some(Hold::Steps)) && table.command.steps().is_none() {
            table.command = table.command.held();
        }
        table
    }

    fn load(
        &self,
        number: usize,
        base: &Path,
        folder: Option<Folder>,
        prescribed: Option<bool>,
    ) -> Result<Run, ExperimentError> {
        let name = self.id.clone().unwrap_or_else(|| format!("#{number}"));
        let refuse = |reason: &str| ExperimentError::Run { run: name.clone(), reason: reason.to_owned() };
        let mut run = match folder {
            Some(folder) => {
                for (given, key) in [
                    (self.kind.is_some(), "kind"),
                    (self.trajectory.is_some(), "trajectory"),
                    (self.servo.is_some(), "servo"),
                ] {
                    if given {
                        return Err(refuse(&format!(
                            "the run folder already says `{key}`; remove one of them"
                        )));
                    }
                }
                folder.run(|table| self.held(table))?
            }
            None => {
                let missing =
                    |key: &str| refuse(&format!("`{key}` is missing; add it, or name a run `folder`"));
                let id = self.id.clone().ok_or_else(|| missing("id"))?;
                let kind = self.kind.ok_or_else(|| missing("kind"))?;
                let table = self.servo.as_ref().map(|servo| read_servo(&base.join(servo))).transpose()?;
                let trajectory = match (&self.trajectory, &table) {
                    (Some(trajectory), _) => read_trajectory(&base.join(trajectory))?,
                    // what the servos measured may be all there is
                    (None, Some(table)) if table.measured.iter().any(|angles| !angles.time_s.is_empty()) => {
                        instants(&table.measured)
                    }
                    (None, _) => return Err(missing("trajectory")),
                };
                let mut run = Run::new(id, kind, trajectory);
                if let Some(table) = table {
                    run.take_servo(self.held(table));
                }
                run
            }
        };
        if self.release_s.is_some() && run.kind != RunKind::Drop {
            return Err(refuse("`release_s` belongs to runs of kind \"drop\"; remove it"));
        }
        if self.init_s.is_some() && run.kind != RunKind::Free {
            return Err(refuse("`init_s` belongs to runs of kind \"free\"; remove it"));
        }
        if let Some(id) = &self.id {
            run.id.clone_from(id);
        }
        if let Some(path) = &self.base {
            run.base = Some(Arc::new(read_base(&base.join(path))?));
        }
        run.usage = self.usage;
        run.times = self.times.iter().map(|(name, times)| (name.clone(), times.get())).collect();
        run.prescribed = prescribed.unwrap_or(run.prescribed);
        run.release_s = self.release_s.map(Finite::get).or(run.release_s);
        run.init_s = self.init_s.map_or(DEFAULT_INIT_S, Positive::get);
        run.weight = self.weight.map_or(1.0, Positive::get);
        Ok(run)
    }
}
