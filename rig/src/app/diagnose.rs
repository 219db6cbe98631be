//! What the simulation of an experiment gets wrong, with the extended model and a report, in a folder.

use std::path::{Path, PathBuf};

use ident::diagnose::{Diagnosed, diagnose};

use super::design::{say_commands, write_configs};
use super::results::{Given, write_diagnosis};
use super::{Failure, Watcher, on_threads};
use crate::record::timing::Stage;
use crate::report::{DiagnosisFigures, Motion};

/// Diagnoses the experiment at `path` by so many threads, into the folder `out`; with a rig's `config`, or where a run folder says what
/// it was made with, those of the runs to make next go to `next` in it. Gives the diagnosis, and where the report is.
///
/// # Errors
/// [`Failure::Input`] for an experiment that contradicts itself, [`Failure::Data`] for one whose runs hold no
/// answer, [`Failure::Interrupted`] after a signal.
pub fn diagnosed(
    path: &Path,
    out: &Path,
    threads: usize,
    config: Option<&Path>,
    watcher: &mut dyn Watcher,
) -> Result<(Diagnosed, PathBuf), Failure> {
    let given = Given::read(path, out)?;
    let diagnosed = on_threads(threads, || Ok(diagnose(&given.experiment, watcher)?));
    watcher.clear();
    let mut diagnosed = diagnosed?;
    let (config, next) = (config.or(given.config.as_deref()), out.join("next"));
    if let Some(config) = config {
        write_configs(config, &diagnosed.next, &next)?;
        say_commands(&mut diagnosed.diagnosis.next_experiments, &next);
    }
    let stage = Stage { name: "diagnosis".into(), wall_s: diagnosed.timing.wall.as_secs_f64() };
    let mut data = given.report(["Diagnosis", "on"], stage, diagnosed.timing.threads);
    data.motions = diagnosed.after.iter().map(|run| Motion::of(&diagnosed.model, run)).collect();
    data.diagnosis = Some(DiagnosisFigures::new(&diagnosed));
    write_diagnosis(&diagnosed, &given.source(), out)?;
    let report = given.write_report(&data)?;
    Ok((diagnosed, report))
}
