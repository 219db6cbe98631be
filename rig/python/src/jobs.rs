//! Fits, diagnoses and imports, as the command line carries them out.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use app::compose::shortfalls;
use app::diagnose::diagnosed;
use app::exchange::{Import, TableOfImages, frames_file};
use app::fit::FitJob;
use app::threads;
use config::paths;
use ident::experiment::Experiment;
use pyo3::prelude::*;
use record::outputs::Outputs;

use crate::errors::unlocked;
use crate::watched::watched;

/// Fits the experiment at `experiment` into the folder `out`, as `rig fit` does; gives its warnings.
///
/// # Errors
/// As [`FitJob::carry_out`].
#[pyfunction]
#[pyo3(signature = (experiment, out, *, threads=None, resume=false, profile=false, prior=None, tell=None))]
#[expect(clippy::too_many_arguments, reason = "the options of a verb, by name")]
pub(crate) fn fit(
    py: Python<'_>,
    experiment: PathBuf,
    out: PathBuf,
    threads: Option<NonZeroUsize>,
    resume: bool,
    profile: bool,
    prior: Option<PathBuf>,
    tell: Option<&Bound<'_, PyAny>>,
) -> PyResult<Vec<String>> {
    watched(py, tell, |teller| {
        let read = Experiment::sources(&experiment).into_iter().chain(prior.clone());
        let out = Outputs::reading(read).folder(&out, &app::fit::FILES)?;
        let (experiment, prior) = (experiment.as_path(), prior.as_deref());
        let job = FitJob { experiment, out: &out, threads: self::threads(threads), resume, profile, prior };
        Ok(job.carry_out(teller)?.0.warnings)
    })
}

/// Diagnoses the experiment at `experiment` into the folder `out`, as `rig diagnose` does; gives its warnings.
///
/// # Errors
/// As [`diagnosed`].
#[pyfunction]
#[pyo3(signature = (experiment, out, *, threads=None, config=None, tell=None))]
pub(crate) fn diagnose(
    py: Python<'_>,
    experiment: PathBuf,
    out: PathBuf,
    threads: Option<NonZeroUsize>,
    config: Option<PathBuf>,
    tell: Option<&Bound<'_, PyAny>>,
) -> PyResult<Vec<String>> {
    watched(py, tell, |teller| {
        let configs = config.iter().flat_map(|config| paths::files(config));
        let read = Experiment::sources(&experiment).into_iter().chain(configs);
        let out = Outputs::reading(read).folder(&out, &app::diagnose::FILES)?;
        diagnosed(&experiment, &out, self::threads(threads), config.as_deref(), teller)?;
        Ok(shortfalls(&experiment))
    })
}

/// Keypoints of a tracker's CSV into a trajectory, as `rig import` makes it; gives what was taken for granted.
///
/// # Errors
/// As [`Import::carry_out`].
#[pyfunction]
#[pyo3(signature = (file, config, out, *, model=None, keypoints=None, individual=None, fps=None, times=None, least_likelihood=0.6, std_px=None))]
#[expect(clippy::too_many_arguments, reason = "the options of a verb, by name")]
pub(crate) fn import_keypoints(
    py: Python<'_>,
    file: PathBuf,
    config: PathBuf,
    out: PathBuf,
    model: Option<PathBuf>,
    keypoints: Option<String>,
    individual: Option<String>,
    fps: Option<f64>,
    times: Option<PathBuf>,
    least_likelihood: f64,
    std_px: Option<f64>,
) -> PyResult<Vec<String>> {
    unlocked(py, || {
        let read = [file.clone(), frames_file(&file)].into_iter();
        let read = read.chain(times.clone()).chain(model.clone()).chain(paths::files(&config));
        let out = TableOfImages::at(&out, &mut Outputs::reading(read))?;
        let import = Import {
            file: &file,
            format: None,
            config: &config,
            model: model.as_deref(),
            out: &out,
            keypoints: keypoints.as_deref(),
            individual: individual.as_deref(),
            fps,
            times: times.as_deref(),
            least_likelihood,
            std_px,
            y_down: false,
        };
        Ok(import.carry_out()?.notes)
    })
}
