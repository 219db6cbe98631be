//! A study's folder: its plan and its results, nothing else is shared between those who work on it.
//!
//! ```text
//! study.json            the study, its experiments, the names of its tasks in order
//! tasks/<id>.json       what is to be done
//! results/<id>.json     what came out
//! set-aside/<id>.txt    why a task will not be tried again
//! tries/<id>.jsonl      when and where it was begun, what it took
//! logs/<id>.txt         what it printed
//! submitted/            lists of tasks that engines were given
//! table.csv, table.parquet, findings.json, report.html      collected
//! ```

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use app::Failure;
use record::files::{read_json, write_json};
use record::outputs::OutputFolder;
use serde::{Deserialize, Serialize};

use crate::plan::{Limits, Plan, StudyFile, Subject};
use crate::results::TaskResult;
use crate::task::{Task, VERSION};

/// The study's own file.
const STUDY: &str = "study.json";
const TASKS: &str = "tasks";
const RESULTS: &str = "results";
const SET_ASIDE: &str = "set-aside";
pub(crate) const TRIES: &str = "tries";
const LOGS: &str = "logs";
const SUBMITTED: &str = "submitted";
/// The table for people.
pub const TABLE: &str = "table.csv";
/// The table for programs.
pub const PARQUET: &str = "table.parquet";
/// What the table says.
pub const FINDINGS: &str = "findings.json";
/// The page.
pub const REPORT: &str = "report.html";
/// Lock of those that work on it on this machine.
pub const LOCK: &str = "local.lock";

/// What a study writes into its folder.
pub const FILES: [&str; 12] =
    [STUDY, TASKS, RESULTS, SET_ASIDE, TRIES, LOGS, SUBMITTED, TABLE, PARQUET, FINDINGS, REPORT, LOCK];

/// `study.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// Version of the program that planned it.
    pub version: String,
    /// Its file.
    pub study: PathBuf,
    /// Its experiments.
    pub experiments: Vec<Subject>,
    /// Its variations, in order.
    pub variations: Vec<String>,
    /// Memory that an engine reserves for a task \[MiB\].
    pub memory_mib: u64,
    /// Longest time of a task \[s\].
    pub limit_s: f64,
    /// How long one usually takes \[s\], where the study says it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub typical_s: Option<f64>,
    /// Threads of a task.
    pub threads: usize,
    /// How often one may die.
    pub tries: usize,
    /// What Slurm is told besides.
    pub slurm: Vec<String>,
    /// What HyperQueue is told besides.
    pub hyperqueue: Vec<String>,
    /// Names of its tasks, in order.
    pub tasks: Vec<String>,
    /// What engines were given, in order.
    pub jobs: Vec<Job>,
}

/// What an engine was given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Job {
    /// The engine.
    pub engine: String,
    /// What the engine calls it.
    pub id: String,
    /// How many tasks.
    pub tasks: usize,
}

/// The folder.
#[derive(Debug, Clone)]
pub struct StudyFolder {
    out: OutputFolder,
}

impl StudyFolder {
    /// The study's folder `out`, which may write [`FILES`].
    pub fn open(out: &OutputFolder) -> Self {
        Self { out: out.clone() }
    }

    /// The study's folder that the task's file `path` lies in.
    pub(crate) fn of_task(path: &Path) -> Result<&Path, Failure> {
        let tasks = app::base(path);
        let is_tasks = tasks.canonicalize().is_ok_and(|tasks| tasks.ends_with(TASKS));
        let home = if tasks == Path::new(TASKS) { Some(Path::new(".")) } else { tasks.parent() };
        home.filter(|_| is_tasks).ok_or_else(|| {
            Failure::Input(anyhow!(
                "{} is in no study's folder: tasks are in its `{TASKS}`, and results go beside that",
                path.display()
            ))
        })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        self.out.path()
    }

    /// Its study.
    ///
    /// # Errors
    /// [`Failure::Input`] where there is none, or one of another version.
    pub fn study(&self) -> Result<Study, Failure> {
        let path = self.path().join(STUDY);
        if !path.exists() {
            return Err(Failure::Input(anyhow!(
                "{} is no study's folder: `rig study STUDY.toml --out {0}` makes it one",
                self.path().display()
            )));
        }
        read_json(&path).map_err(Failure::input)
    }

    /// Writes the study.
    ///
    /// # Errors
    /// [`Failure::Input`].
    pub fn write_study(&self, study: &Study) -> Result<(), Failure> {
        write_json(self.out.file(STUDY).place(), study).map_err(Failure::input)
    }

    /// Writes `plan`, of the study `file` at `path`: tasks that are there stay, with their results.
    ///
    /// # Errors
    /// [`Failure::Input`].
    pub fn write_plan(&self, file: &StudyFile, path: &Path, plan: &Plan) -> Result<Study, Failure> {
        self.out.create().map_err(Failure::input)?;
        for name in [TASKS, RESULTS, SET_ASIDE, TRIES, LOGS, SUBMITTED] {
            self.out.folder(name).create().map_err(Failure::input)?;
        }
        let there = self.names(TASKS);
        for (id, task) in plan.tasks.iter().filter(|(id, _)| !there.contains(id)) {
            self.write_task(id, task)?;
        }
        let Limits { threads, limit_s, memory_mib, tries, typical_s } = file.task.clone();
        let jobs = self.study().map(|study| study.jobs).unwrap_or_default();
        let study = Study {
            version: VERSION.into(),
            study: std::path::absolute(path).map_err(Failure::input)?,
            experiments: plan.subjects.clone(),
            variations: file.variation.iter().map(|variation| variation.name.clone()).collect(),
            memory_mib,
            limit_s: limit_s.get(),
            typical_s: typical_s.map(|typical_s| typical_s.get()),
            threads,
            tries,
            slurm: file.slurm.options.clone(),
            hyperqueue: file.hyperqueue.options.clone(),
            tasks: plan.tasks.iter().map(|(id, _)| id.clone()).collect(),
            jobs,
        };
        self.write_study(&study)?;
        Ok(study)
    }

    /// Whole, but not forced to the disk: a plan that a power cut takes is made again in a second.
    #[expect(clippy::disallowed_methods, reason = "in a study's own folder, of which a handle was given")]
    fn write_task(&self, id: &str, task: &Task) -> Result<(), Failure> {
        let to = self.task(id);
        let part = to.with_file_name(format!(".part-{}-{id}", std::process::id()));
        let text = serde_json::to_vec_pretty(task).map_err(Failure::internal)?;
        std::fs::write(&part, text)
            .and_then(|()| std::fs::rename(&part, &to))
            .with_context(|| format!("writing {}", to.display()))
            .map_err(Failure::Input)
    }

    /// The file of the task `id`.
    pub fn task(&self, id: &str) -> PathBuf {
        self.path().join(TASKS).join(format!("{id}.json"))
    }

    /// The file for what the task `id` prints.
    pub fn log(&self, id: &str) -> PathBuf {
        self.path().join(LOGS).join(format!("{id}.txt"))
    }

    /// The folder for what engines print.
    pub fn logs(&self) -> PathBuf {
        self.path().join(LOGS)
    }

    /// Writes the file `name` of an engine's and gives its path.
    ///
    /// # Errors
    /// [`Failure::Input`].
    pub fn write_submitted(&self, name: &str, text: &str) -> Result<PathBuf, Failure> {
        let file = self.out.folder(SUBMITTED).file(name);
        file.write(text.as_bytes()).map_err(Failure::input)?;
        Ok(file.path().to_owned())
    }

    /// Writes one of the collected files.
    ///
    /// # Errors
    /// [`Failure::Input`].
    pub fn write_collected(&self, name: &str, bytes: &[u8]) -> Result<(), Failure> {
        self.out.write(name, bytes).map_err(Failure::input)
    }

    /// Begins one of the collected files.
    ///
    /// # Errors
    /// [`Failure::Input`].
    pub fn begin_collected(&self, name: &str) -> Result<record::files::Part, Failure> {
        self.out.file(name).begin().map_err(Failure::input)
    }

    pub(crate) fn has_result(&self, id: &str) -> bool {
        self.result_path(id).exists()
    }

    fn result_path(&self, id: &str) -> PathBuf {
        self.path().join(RESULTS).join(format!("{id}.json"))
    }

    pub(crate) fn write_result(&self, id: &str, result: &TaskResult) -> Result<(), Failure> {
        self.out.folder(RESULTS).write_json(&format!("{id}.json"), result).map_err(Failure::input)
    }

    /// The result of the task `id`, where there is one.
    ///
    /// # Errors
    /// [`Failure::Input`] where it cannot be read.
    pub fn result(&self, id: &str) -> Result<Option<TaskResult>, Failure> {
        let path = self.result_path(id);
        if path.exists() { read_json(&path).map(Some).map_err(Failure::input) } else { Ok(None) }
    }

    fn aside_path(&self, id: &str) -> PathBuf {
        self.path().join(SET_ASIDE).join(format!("{id}.txt"))
    }

    /// Why the task `id` is set aside, where it is.
    pub fn set_aside(&self, id: &str) -> Option<String> {
        std::fs::read_to_string(self.aside_path(id)).ok().map(|why| why.trim_end().to_owned())
    }

    pub(crate) fn put_aside(&self, id: &str, why: &str) -> Result<(), Failure> {
        let text = format!("{why}\n");
        self.out.folder(SET_ASIDE).write(&format!("{id}.txt"), text.as_bytes()).map_err(Failure::input)
    }

    /// Lets tasks that are set aside be tried again.
    pub fn try_again(&self) {
        for id in self.names(SET_ASIDE) {
            for path in [self.aside_path(&id), self.path().join(TRIES).join(format!("{id}.jsonl"))] {
                // what is not there needs no removing
                let _ = std::fs::remove_file(path);
            }
        }
    }

    /// Names of the files in the folder `name`, without their ending.
    fn names(&self, name: &str) -> BTreeSet<String> {
        let entries = std::fs::read_dir(self.path().join(name)).into_iter().flatten().flatten();
        let stem = |entry: std::fs::DirEntry| {
            let name = entry.file_name();
            let name = name.to_str()?;
            (!name.starts_with('.')).then(|| name.split('.').next().unwrap_or(name).to_owned())
        };
        entries.filter_map(stem).collect()
    }

    /// How far `study` is.
    pub fn standing(&self, study: &Study) -> Standing {
        let (results, aside) = (self.names(RESULTS), self.names(SET_ASIDE));
        let of = |found: &BTreeSet<String>| study.tasks.iter().filter(|id| found.contains(*id)).count();
        Standing { all: study.tasks.len(), done: of(&results), set_aside: of(&aside) }
    }

    /// Tasks of `study` that have neither a result nor are set aside, in order.
    pub fn left<'s>(&self, study: &'s Study) -> Vec<&'s str> {
        let (results, aside) = (self.names(RESULTS), self.names(SET_ASIDE));
        let is_left = |id: &&String| !results.contains(*id) && !aside.contains(*id);
        study.tasks.iter().filter(is_left).map(String::as_str).collect()
    }
}

/// How far a study is, in tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Standing {
    /// All.
    pub all: usize,
    /// With a result.
    pub done: usize,
    /// Set aside.
    pub set_aside: usize,
}

impl Standing {
    /// With neither.
    pub fn left(&self) -> usize {
        self.all.saturating_sub(self.done + self.set_aside)
    }
}
