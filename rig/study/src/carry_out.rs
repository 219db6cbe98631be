//! A task carried out: a pure function from its file and what that names to `results/<id>.json`.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::anyhow;
use app::compose::{self, EXPERIMENT, Given};
use app::{Failure, on_threads};
use ident::diagnose::{self, diagnose};
use ident::experiment::Experiment;
use ident::fit::{Flow, INTERRUPTED, Observer, Progress, fit};
use record::outputs::Outputs;

use crate::folder::{FILES, StudyFolder};
use crate::inputs::{digest, digest_of};
use crate::resample::{draw_blocks, draw_runs};
use crate::results::TaskResult;
use crate::task::{By, Does, Task};
use crate::tries::Tries;

/// How a task ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// Its result is there now.
    Done,
    /// Its result was there already.
    WasDone,
    /// It is set aside: it has failed, or died too often.
    SetAside,
}

/// Carries out the task in the file `path`, in a study's folder. A failure that lies in the task sets it aside, with the reason: it would fail
/// again.
///
/// # Errors
/// [`Failure::Input`] where the file is no task of this program's, or not in a study's folder, [`Failure::Interrupted`] after a signal, and what a
/// disk may refuse; the task may then be tried again.
pub fn carry_out(path: &Path, interrupted: &Arc<AtomicBool>) -> Result<Ended, Failure> {
    let task = Task::read(path)?;
    let id = task.id()?;
    let read = Experiment::sources(&task.path).into_iter().chain(task.model.clone());
    let home = StudyFolder::of_task(path)?;
    let out = StudyFolder::open(&Outputs::reading(read).folder(home, &FILES)?);
    if out.has_result(&id) {
        return Ok(Ended::WasDone);
    }
    if out.set_aside(&id).is_some() {
        return Ok(Ended::SetAside);
    }
    let tries = Tries::of(&out, &id);
    let begun = tries.begun();
    if begun >= task.tries {
        out.put_aside(
            &id,
            &format!("begun {begun} times and never ended: killed, or out of memory or time"),
        )?;
        return Ok(Ended::SetAside);
    }
    tries.begin()?;
    let began = Instant::now();
    let made = on_threads(task.threads, || result(&task, &id, interrupted));
    match made {
        Ok(result) => {
            out.write_result(&id, &result)?;
            tries.end(began.elapsed())?;
            Ok(Ended::Done)
        }
        Err(Failure::Interrupted(error)) => {
            tries.take_back();
            Err(Failure::Interrupted(error))
        }
        Err(failure) => {
            out.put_aside(&id, &format!("{}: {:#}", failure.status(), failure.error()))?;
            tries.end(began.elapsed())?;
            Ok(Ended::SetAside)
        }
    }
}

fn result(task: &Task, id: &str, interrupted: &Arc<AtomicBool>) -> Result<TaskResult, Failure> {
    let changed = digest(&task.path)? != task.inputs_sha256 || {
        let model = task.model.as_ref().and_then(|model| std::fs::read(model).ok());
        model.map(|model| digest_of(&model)) != task.model_sha256
    };
    if changed {
        return Err(Failure::Input(anyhow!(
            "{} has changed since the study was planned; run `rig study` again, which makes a task of its own of it",
            task.path.display()
        )));
    }
    let mut given = experiment(task)?;
    let is_whole = task.resample.is_none();
    if let Some(resample) = task.resample.as_ref().filter(|resample| resample.by == By::Run) {
        draw_runs(&mut given, resample)?;
    }
    let mut watcher = Listening(Arc::clone(interrupted));
    if task.does == Does::Diagnose {
        let diagnosed = diagnose(&given, &mut watcher)?;
        return Ok(TaskResult::of_diagnosis(id, diagnosed.diagnosis, is_whole));
    }
    let mut fitted = fit(&given, &mut watcher)?;
    if let Some(resample) = task.resample.as_ref().filter(|resample| resample.by == By::Block) {
        fitted = fit(&draw_blocks(given, &fitted, resample)?, &mut watcher)?;
    }
    if fitted.fit.stop_reason == INTERRUPTED {
        return Err(Failure::Interrupted(anyhow!(
            "interrupted after {} evaluations",
            fitted.fit.evaluations
        )));
    }
    Ok(TaskResult::of_fit(id, fitted.fit, is_whole))
}

/// The experiment of `task`, with what its variation says otherwise.
///
/// # Errors
/// As a fit of it.
pub(crate) fn experiment(task: &Task) -> Result<Experiment, Failure> {
    let Given { experiment, text, .. } = compose::given(&task.path)?;
    if task.model.is_none() && task.fit.is_empty() && task.diagnose.is_empty() && task.seed.is_none() {
        return Ok(experiment);
    }
    let mut table: toml::Table = text.parse().map_err(Failure::internal)?;
    if let Some(model) = &task.model {
        table.insert("model".into(), model.display().to_string().into());
    }
    put_into(&mut table, "fit", &task.fit);
    put_into(&mut table, "diagnose", &task.diagnose);
    if let Some(seed) = task.seed {
        let seed = i64::try_from(seed).map_err(Failure::input)?;
        put_into(&mut table, "fit", &toml::Table::from_iter([("seed".to_owned(), seed.into())]));
    }
    let text = toml::to_string(&table).map_err(Failure::internal)?;
    let place = if task.path.is_dir() { task.path.join(EXPERIMENT) } else { task.path.clone() };
    Ok(Experiment::parse(&text, &place)?)
}

/// Puts the keys of `changes` into the table `name`; tables in it (`bounds`, `prior`) take them key by key.
fn put_into(table: &mut toml::Table, name: &str, changes: &toml::Table) {
    if changes.is_empty() {
        return;
    }
    let entry = table.entry(name).or_insert_with(|| toml::Table::new().into());
    let Some(entry) = entry.as_table_mut() else { return };
    for (key, value) in changes {
        match value.as_table() {
            Some(inner) => put_into(entry, key, inner),
            None => drop(entry.insert(key.clone(), value.clone())),
        }
    }
}

/// Ends a task after a signal.
struct Listening(Arc<AtomicBool>);

impl Observer for Listening {
    fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.0)
    }

    fn progress(&mut self, _: &Progress<'_>) -> Flow {
        if self.0.load(Ordering::Relaxed) { Flow::Stop } else { Flow::Continue }
    }
}

impl diagnose::Observer for Listening {
    fn stage(&mut self, _: &str) -> bool {
        !self.0.load(Ordering::Relaxed)
    }

    fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.0)
    }
}
