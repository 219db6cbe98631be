//! One task: what one fit or diagnosis is made of, as one file.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use app::Failure;
use serde::{Deserialize, Serialize};

use crate::inputs::digest_of;

/// What a task makes of its experiment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Does {
    /// A fit.
    #[default]
    Fit,
    /// A diagnosis.
    Diagnose,
}

/// What a bootstrap draws again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum By {
    /// Whole runs, with replacement: what other runs would have given.
    Run,
    /// Blocks of the fit's residuals within each run: what other noise would have given.
    Block,
}

/// One draw of a bootstrap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Resample {
    /// What is drawn.
    pub by: By,
    /// Which draw it is, from 1.
    pub number: u32,
    /// Seed of all draws.
    pub seed: u64,
    /// Length of a block \[s\].
    pub block_s: f64,
}

/// A task, as `tasks/<id>.json` holds it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// Version of the program that made it, which alone may carry it out.
    pub version: String,
    /// Fit or diagnosis.
    pub does: Does,
    /// The experiment as the study names it.
    pub experiment: String,
    /// Where it is: an experiment's file or a run folder.
    pub path: PathBuf,
    /// SHA-256 of everything that it reads.
    pub inputs_sha256: String,
    /// The variation's name.
    pub variation: String,
    /// Another model.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub model: Option<PathBuf>,
    /// SHA-256 of that.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub model_sha256: Option<String>,
    /// What the variation says otherwise than the experiment's `[fit]`.
    #[serde(skip_serializing_if = "toml::Table::is_empty", default)]
    pub fit: toml::Table,
    /// What it says otherwise than its `[diagnose]`.
    #[serde(skip_serializing_if = "toml::Table::is_empty", default)]
    pub diagnose: toml::Table,
    /// Seed of the fit's random numbers.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub seed: Option<u64>,
    /// The draw of a bootstrap; absent for the data as they are.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub resample: Option<Resample>,
    /// Threads it works with; the result does not depend on it.
    pub threads: usize,
    /// Longer than this \[s\] it may not take.
    pub limit_s: f64,
    /// So often it may die before it is set aside.
    pub tries: usize,
}

/// Hexadecimal digits of a task's name: two of a million tasks have the same by a chance of 3e-8.
const NAME_DIGITS: usize = 16;

impl Task {
    /// Its name: of everything that its result depends on, and of nothing else.
    ///
    /// # Errors
    /// [`Failure::Internal`] for numbers that JSON does not know.
    pub fn id(&self) -> Result<String, Failure> {
        let depends_on =
            Self { path: PathBuf::new(), model: None, threads: 0, limit_s: 0.0, tries: 0, ..self.clone() };
        let text = serde_json::to_vec(&depends_on).map_err(Failure::internal)?;
        Ok(digest_of(&text)[..NAME_DIGITS].to_owned())
    }

    /// Reads the task in the file `path`.
    ///
    /// # Errors
    /// [`Failure::Input`] where there is none, it was changed, or another version made it.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let reading = || format!("reading task {}", path.display());
        let text = std::fs::read(path).with_context(reading).map_err(Failure::Input)?;
        let task: Self = serde_json::from_slice(&text).with_context(reading).map_err(Failure::Input)?;
        if task.version != VERSION {
            return Err(Failure::Input(anyhow!(
                "task {} was planned by rig {}, and this is rig {VERSION}: results of two versions do not go together; run `rig study` again \
                 with this one, or install that one here",
                path.display(),
                task.version
            )));
        }
        let named = path.file_stem().is_some_and(|stem| task.id().is_ok_and(|id| stem == id.as_str()));
        if !named {
            return Err(Failure::Input(anyhow!(
                "task {} is not what its name says: it was changed; run `rig study` again, which makes a task of its own of it",
                path.display()
            )));
        }
        Ok(task)
    }

    /// What it is, in words.
    pub fn words(&self) -> String {
        let mut text = format!("{} as {}", self.experiment, self.variation);
        if let Some(seed) = self.seed {
            text += &format!(", seed {seed}");
        }
        if let Some(resample) = &self.resample {
            text += &format!(", resample {}", resample.number);
        }
        text
    }
}

/// Of this program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

#[cfg(test)]
pub(crate) fn example() -> Task {
    Task {
        version: VERSION.into(),
        does: Does::Fit,
        experiment: "runs/a".into(),
        path: "/data/runs/a".into(),
        inputs_sha256: "00".into(),
        variation: "as it is".into(),
        model: None,
        model_sha256: None,
        fit: toml::Table::new(),
        diagnose: toml::Table::new(),
        seed: None,
        resample: None,
        threads: 1,
        limit_s: 60.0,
        tries: 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn name_follows_what_the_result_depends_on_and_nothing_else() {
        let task = example();
        let id = task.id().unwrap();
        assert_eq!(id.len(), NAME_DIGITS);
        let moved = Task { path: "/elsewhere".into(), threads: 4, limit_s: 5.0, tries: 9, ..task.clone() };
        assert_eq!(moved.id().unwrap(), id);
        for other in [
            Task { version: "0.0.1".into(), ..task.clone() },
            Task { inputs_sha256: "01".into(), ..task.clone() },
            Task { experiment: "runs/b".into(), ..task.clone() },
            Task { fit: "seed = 2".parse().unwrap(), ..task.clone() },
            Task { seed: Some(2), ..task.clone() },
            Task { does: Does::Diagnose, ..task.clone() },
        ] {
            assert_ne!(other.id().unwrap(), id, "{other:?}");
        }
    }

    #[test]
    fn another_version_s_task_and_a_changed_one_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let write = |task: &Task, id: &str| {
            let path = folder.path().join(format!("{id}.json"));
            std::fs::write(&path, serde_json::to_vec(task).unwrap()).unwrap();
            Task::read(&path).map_err(|failure| failure.error().to_string())
        };
        let task = example();
        let id = task.id().unwrap();
        assert_eq!(write(&task, &id).unwrap(), task);
        let old = Task { version: "0.0.1".into(), ..task.clone() };
        assert!(write(&old, &old.id().unwrap()).unwrap_err().contains("planned by rig 0.0.1"));
        let changed = Task { seed: Some(7), ..task };
        assert!(write(&changed, &id).unwrap_err().contains("it was changed"));
    }
}
