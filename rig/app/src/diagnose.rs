//! What the simulation of an experiment gets wrong, with the extended model and a report, in a folder.

use std::path::{Path, PathBuf};

use ident::diagnose::{Diagnosed, diagnose};

use super::design::{add_commands, write_configs};
use super::results::{Given, write_diagnosis};
use super::{Failure, Watcher, on_threads};
use record::folder::file;
use record::outputs::OutputFolder;
use record::timing::Stage;
use report::{DiagnosisFigures, Motion};

/// Configs of the runs to make next, in the folder of a diagnosis.
const NEXT: &str = "next";
/// What a diagnosis writes into its folder.
pub const FILES: [&str; 5] = [file::DIAGNOSIS, file::MODEL, file::REPORT, file::TIMING, NEXT];

/// Diagnoses the experiment at `path` by so many threads, into the folder `out`; with a rig's `config`, or where a run folder says what
/// it was made with, those of the runs to make next go to `next` in it. Gives the diagnosis, and where the report is.
///
/// # Errors
/// [`Failure::Input`] for an experiment that contradicts itself, [`Failure::Data`] for one whose runs hold no
/// answer, [`Failure::Interrupted`] after a signal.
pub fn diagnosed(
    path: &Path,
    out: &OutputFolder,
    threads: usize,
    config: Option<&Path>,
    watcher: &mut dyn Watcher,
) -> Result<(Diagnosed, PathBuf), Failure> {
    let given = Given::read(path, out)?;
    let diagnosed = on_threads(threads, || Ok(diagnose(&given.experiment, watcher)?));
    watcher.clear();
    let mut diagnosed = diagnosed?;
    let (config, next) = (config.or(given.config.as_deref()), out.folder(NEXT));
    if let Some(config) = config {
        write_configs(config, &diagnosed.next, &next)?;
        add_commands(&mut diagnosed.diagnosis.next_experiments, next.path());
    }
    let stage = Stage { name: "diagnosis".into(), wall_s: diagnosed.timing.wall.as_secs_f64() };
    let mut data = given.report(["Diagnosis", "on"], stage, diagnosed.timing.threads);
    data.motions = diagnosed.after.iter().map(|run| Motion::of(&diagnosed.model, run)).collect();
    data.diagnosis = Some(DiagnosisFigures::new(&diagnosed));
    write_diagnosis(&diagnosed, &given.source(), out)?;
    let report = given.write_report(&data)?;
    Ok((diagnosed, report))
}
