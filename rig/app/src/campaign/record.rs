//! `campaign.json`: what a campaign is for, what it did, where it stands. Written again after each step; begun again in the same folder a
//! campaign goes on from there.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use serde::{Deserialize, Serialize};

use crate::Failure;
use record::outputs::OutputFolder;
use record::run_id::RunId;
use store::goal::{Goal, Known};

/// The file in a campaign's folder.
pub const FILE: &str = "campaign.json";

/// The document `campaign.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The config of the rig.
    pub config: PathBuf,
    /// What it is for.
    pub goal: Goal,
    /// The most runs it may make.
    pub max_runs: usize,
    /// Where it stands.
    pub state: Standing,
    /// That in a sentence.
    pub says: String,
    /// What somebody must do for it to go on, or to be sure of what was found.
    pub needs: Vec<String>,
    /// Runs in the order in which they were made.
    pub runs: Vec<Made>,
    /// What was known after each run.
    pub steps: Vec<Step>,
}

/// Where a campaign stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// It is under way, or was interrupted.
    Running,
    /// It has what it is for.
    Reached,
    /// What would help no servo can do.
    NeedsAHand,
    /// All runs that it may make are made.
    BudgetSpent,
}

impl Standing {
    /// As `campaign.json` spells it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Reached => "reached",
            Self::NeedsAHand => "needs-a-hand",
            Self::BudgetSpent => "budget-spent",
        }
    }
}

/// A run of a campaign.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Made {
    /// The run.
    pub run: RunId,
    /// The config it was made with.
    pub config: PathBuf,
    /// What it was made for.
    pub why: String,
}

/// What was known after a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// The folder with experiment, results and report.
    pub folder: PathBuf,
    /// The diagnosis's verdict, where one was made.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub verdict: Option<String>,
    /// Its sentence.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub sentence: Option<String>,
    /// What the diagnosis names beyond doubt although it does not explain all; of aliases the first one.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub established: Vec<String>,
    /// The parameters of the goal.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub known: Vec<Known>,
}

impl Record {
    /// That of the campaign in `folder`, which may have been begun before.
    ///
    /// # Errors
    /// [`Failure::Input`] where another campaign is in the folder, or what is there cannot be read.
    pub(super) fn open(
        folder: &OutputFolder,
        config: &Path,
        goal: &Goal,
        max_runs: usize,
    ) -> Result<Self, Failure> {
        let path = folder.path().join(FILE);
        let new = Self {
            config: config.into(),
            goal: goal.clone(),
            max_runs,
            state: Standing::Running,
            says: String::new(),
            needs: Vec::new(),
            runs: Vec::new(),
            steps: Vec::new(),
        };
        let reading = || format!("reading {}", path.display());
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(new),
            Err(error) => return Err(Failure::Input(anyhow::Error::new(error).context(reading()))),
        };
        let old: Self = serde_json::from_str(&text).with_context(reading).map_err(Failure::Input)?;
        if old.config != new.config || old.goal != new.goal {
            return Err(Failure::Input(anyhow!(
                "{} is another campaign's, of {}; choose another --out",
                folder.path().display(),
                old.config.display()
            )));
        }
        Ok(Self { max_runs, state: Standing::Running, needs: Vec::new(), ..old })
    }

    /// How many runs were made with the config at `path`.
    pub(super) fn times(&self, path: &Path) -> usize {
        self.runs.iter().filter(|made| made.config == path).count()
    }

    /// Writes it to `folder`.
    ///
    /// # Errors
    /// [`Failure::Internal`].
    pub(super) fn write(&self, folder: &OutputFolder) -> Result<(), Failure> {
        folder.write_json(FILE, self).map_err(Failure::internal)
    }
}
