//! Fits and diagnoses of experiments: read with what a report says of them, written into folders.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use ident::diagnose::{Diagnosed, NamedCause};
use ident::experiment::{Experiment, Use};
use ident::fit::{Fit, Fitted, FittedRun};

use super::Failure;
use super::compose::{self, shortfalls};
use record::folder::file;
use record::outputs::OutputFolder;
use record::timing::{Stage, Timing};
use report::{self, ReportData};

/// An experiment from its file, and the folder that the results go to.
pub(super) struct Given<'a> {
    pub(super) experiment: Experiment,
    pub(super) out: &'a OutputFolder,
    path: &'a Path,
    text: String,
    /// The config of its rig, where that is known.
    pub(super) config: Option<PathBuf>,
}

impl<'a> Given<'a> {
    /// Reads the experiment at `path`, which may be a run folder, and makes the folder `out`.
    pub(super) fn read(path: &'a Path, out: &'a OutputFolder) -> Result<Self, Failure> {
        let compose::Given { experiment, text, config } = compose::given(path)?;
        out.create().map_err(Failure::input)?;
        Ok(Self { experiment, out, path, text, config })
    }

    /// What the results were made from.
    pub(super) fn source(&self) -> String {
        self.path.display().to_string()
    }

    /// A report of what was `done` ("Fit", "to" the runs), so far without its results.
    pub(super) fn report(&self, [done, to]: [&str; 2], stage: Stage, workers: usize) -> ReportData {
        let model = &self.experiment.model.name;
        let held_out = self.experiment.runs.iter().filter(|run| run.usage == Use::Holdout).count();
        let fitted = self.experiment.runs.len() - held_out;
        ReportData {
            id: name(self.path),
            date: jiff::Timestamp::now().strftime("%Y-%m-%d %H:%M:%S UTC").to_string(),
            description: format!("{done} of {model} {to} {fitted} runs, {held_out} held out."),
            timing: Timing { workers, stages: vec![stage] },
            warnings: shortfalls(self.path),
            provenance: vec![
                ("rig".into(), env!("CARGO_PKG_VERSION").into()),
                ("experiment".into(), self.source()),
                ("model".into(), model.clone()),
            ],
            config_toml: Some(self.text.clone()),
            ..ReportData::default()
        }
    }

    /// Writes the report and how long it all took; gives the report's path.
    pub(super) fn write_report(&self, data: &ReportData) -> Result<PathBuf, Failure> {
        self.out.write_json(file::TIMING, &data.timing).map_err(Failure::internal)?;
        self.out.write(file::REPORT, report::render(data).as_bytes()).map_err(Failure::internal)?;
        Ok(self.out.path().join(file::REPORT))
    }
}

/// Writes the calibrated `model.xml` and `fit.json` to `folder`, what is read again last; `source` says in the model what it was
/// fitted to.
///
/// # Errors
/// [`Failure::Internal`] when the folder cannot be written.
pub(super) fn write_fit(fitted: &Fitted, source: &str, folder: &OutputFolder) -> Result<(), Failure> {
    let fit = &fitted.fit;
    let json = fit.to_json().map_err(Failure::internal)?;
    let undetermined: Vec<&str> =
        fit.parameters.iter().filter(|p| !p.determined).map(|p| p.name.as_str()).collect();
    let mut comment = format!(
        "Calibrated by rig {} on {source}: method {}, seed {}, loss {:.4} mm2.",
        env!("CARGO_PKG_VERSION"),
        fit.method,
        fit.seed,
        fit.loss_m2 * 1e6
    );
    if !undetermined.is_empty() {
        comment.push_str(&format!(" Left open by the data: {}.", undetermined.join(", ")));
    }
    folder.write(file::MODEL, fitted.to_mjcf(&comment).as_bytes()).map_err(Failure::internal)?;
    folder.write(file::FIT, json.as_bytes()).map_err(Failure::internal)
}

/// Writes `diagnosis.json` and the extended `model.xml` to `folder`; `source` says in the model what it was made from.
///
/// # Errors
/// [`Failure::Internal`] when the folder cannot be written.
pub(super) fn write_diagnosis(
    diagnosed: &Diagnosed,
    source: &str,
    folder: &OutputFolder,
) -> Result<(), Failure> {
    let diagnosis = &diagnosed.diagnosis;
    let json = diagnosis.to_json().map_err(Failure::internal)?;
    folder.write(file::DIAGNOSIS, json.as_bytes()).map_err(Failure::internal)?;
    let folded = diagnosed.model.folded();
    let mut comment =
        format!("Diagnosed by rig {} on {source}: {}.", env!("CARGO_PKG_VERSION"), diagnosis.verdict.name());
    let names: Vec<String> = diagnosis.causes.iter().map(NamedCause::label).collect();
    if !names.is_empty() {
        comment.push_str(&format!(" Extended by {}, kept as custom numbers.", names.join(", ")));
    }
    if !folded.lost.is_empty() {
        let lost: Vec<&str> = folded.lost.iter().map(|cause| cause.name()).collect();
        comment.push_str(&format!(" MuJoCo itself moves without {}.", lost.join(", ")));
    }
    let text = diagnosed.model.to_mjcf_from(&comment, &FittedRun::starts(&diagnosed.after));
    folder.write(file::MODEL, text.as_bytes()).map_err(Failure::internal)
}

/// Reads the fit.json of an earlier fit.
pub(super) fn earlier(path: &Path) -> Result<Fit, Failure> {
    let read = || format!("reading the earlier fit {}", path.display());
    let text = std::fs::read_to_string(path).with_context(read).map_err(Failure::Input)?;
    serde_json::from_str(&text).with_context(read).map_err(Failure::Input)
}

/// The experiment's name: its file's, or its folder's where the file has the usual name.
fn name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    if stem != "experiment" {
        return stem;
    }
    let folder = path.canonicalize().ok().and_then(|path| Some(path.parent()?.file_name()?.to_owned()));
    folder.map_or(stem, |folder| folder.to_string_lossy().into_owned())
}
