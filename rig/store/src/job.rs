//! A job: what it does, where it stands, what came of it.

use std::path::PathBuf;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::goal::Target;
use record::run_id::RunId;
use record::stage::Stage;

/// A job's number: in the order in which they were added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct JobId(pub i64);

impl std::fmt::Display for JobId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl std::str::FromStr for JobId {
    type Err = std::num::ParseIntError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        text.parse().map(Self)
    }
}

/// What a job does: a verb of the command line, with what it needs. Runs are named by their ids.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Work {
    /// One experiment: it moves the rig.
    Run {
        /// The rig config.
        #[schema(value_type = String)]
        config: PathBuf,
        /// No extraction, no fit.
        #[serde(default)]
        film_only: bool,
    },
    /// A new fit of a run against the last good coefficients.
    Recalibrate {
        /// The run.
        #[schema(value_type = String)]
        run: RunId,
    },
    /// A run's analysis again, into the job's folder.
    Replay {
        /// The run.
        #[schema(value_type = String)]
        run: RunId,
        /// The stage to begin with.
        #[serde(default)]
        from: Stage,
    },
    /// A fit of some runs, into the job's folder.
    Fit(Chosen),
    /// A diagnosis of some runs, into the job's folder.
    Diagnose(Chosen),
    /// The design of the next runs, into the job's folder.
    Design(Chosen),
    /// Runs until the goals are met: it moves the rig.
    Campaign {
        /// The rig config.
        #[schema(value_type = String)]
        config: PathBuf,
        /// Parameters and how well they are to be known, as `g3/blunt 5%`; none: until the diagnosis says one thing.
        #[serde(default)]
        #[schema(value_type = Vec<String>)]
        goals: Vec<Target>,
        /// The most runs it may make.
        max_runs: usize,
    },
}

/// Runs of an experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Chosen {
    /// Runs to fit.
    #[schema(value_type = Vec<String>)]
    pub runs: Vec<RunId>,
    /// Runs that are only scored.
    #[serde(default)]
    #[schema(value_type = Vec<String>)]
    pub holdout: Vec<RunId>,
}

/// Jobs of one lane are done one after the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Lane {
    /// Jobs that move the rig.
    Motion,
    /// Jobs that only compute.
    Analysis,
}

impl Lane {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Motion => "motion",
            Self::Analysis => "analysis",
        }
    }
}

impl Work {
    /// Its lane.
    pub fn lane(&self) -> Lane {
        match self {
            Self::Run { .. } | Self::Campaign { .. } => Lane::Motion,
            Self::Recalibrate { .. }
            | Self::Replay { .. }
            | Self::Fit(_)
            | Self::Diagnose(_)
            | Self::Design(_) => Lane::Analysis,
        }
    }

    /// The runs that it is about.
    pub fn runs(&self) -> Vec<&RunId> {
        match self {
            Self::Run { .. } | Self::Campaign { .. } => Vec::new(),
            Self::Recalibrate { run } | Self::Replay { run, .. } => vec![run],
            Self::Fit(chosen) | Self::Diagnose(chosen) | Self::Design(chosen) => {
                chosen.runs.iter().chain(&chosen.holdout).collect()
            }
        }
    }

    /// Its kind in one word.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Run { .. } => "run",
            Self::Recalibrate { .. } => "recalibrate",
            Self::Replay { .. } => "replay",
            Self::Fit(_) => "fit",
            Self::Diagnose(_) => "diagnose",
            Self::Design(_) => "design",
            Self::Campaign { .. } => "campaign",
        }
    }
}

/// The state of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// It waits for its turn.
    Queued,
    /// It is being done.
    Running,
    /// It ended well.
    Done,
    /// It ended with an error.
    Failed,
    /// Somebody cancelled it.
    Cancelled,
    /// Its process ended without a result: killed, or the power was cut.
    Lost,
}

impl State {
    pub(super) const ALL: [(Self, &'static str); 6] = [
        (Self::Queued, "queued"),
        (Self::Running, "running"),
        (Self::Done, "done"),
        (Self::Failed, "failed"),
        (Self::Cancelled, "cancelled"),
        (Self::Lost, "lost"),
    ];

    /// Whether the job has ended.
    pub fn is_over(self) -> bool {
        !matches!(self, Self::Queued | Self::Running)
    }

    pub(super) fn name(self) -> &'static str {
        Self::ALL.iter().find(|(state, _)| *state == self).map_or("", |(_, name)| name)
    }
}

impl std::fmt::Display for State {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// A job to add.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NewJob {
    /// What it does.
    pub work: Work,
    /// Higher ones come first; of equal ones the older.
    #[serde(default)]
    pub priority: i32,
    /// Why it was added, for who looks at it later.
    #[serde(default)]
    pub why: Option<String>,
    /// The job does not begin before this time.
    #[serde(default)]
    pub not_before: Option<Timestamp>,
    /// The job that this one repeats.
    #[serde(default)]
    pub retry_of: Option<JobId>,
    /// The slot of the schedule that wants it.
    #[serde(default)]
    pub slot: Option<Timestamp>,
    /// A request that comes again has the same key, and is one job.
    #[serde(default)]
    pub key: Option<String>,
}

impl NewJob {
    /// A job with this work and default settings.
    pub fn new(work: Work) -> Self {
        Self { work, priority: 0, why: None, not_before: None, retry_of: None, slot: None, key: None }
    }
}

/// A job in the queue.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Job {
    /// Its number.
    #[schema(value_type = i64)]
    pub id: JobId,
    /// What it does.
    pub work: Work,
    /// Higher ones come first.
    pub priority: i32,
    /// Its state.
    pub state: State,
    /// Somebody asked for its end, for this reason; it may still be running.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cancel: Option<String>,
    /// Why it was added.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// The job that this one repeats.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<i64>)]
    pub retry_of: Option<JobId>,
    /// The job does not begin before this time, UTC.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_before: Option<String>,
    /// When it was added, UTC.
    pub added: String,
    /// When it began, UTC.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub began: Option<String>,
    /// When it ended, UTC.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ended: Option<String>,
    /// The slot of the schedule that wants it, UTC; none where a person has asked for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slot: Option<String>,
    /// The process that does it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pid: Option<u32>,
    /// Its result.
    #[serde(flatten)]
    pub result: JobResult,
}

/// The result of a verb, or of the job that carried it out: the one object of `--json`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default)]
pub struct JobResult {
    /// How it ended: `done`, or the class of what went wrong.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub status: Option<String>,
    /// The run it made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// The folder it wrote to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub out: Option<String>,
    /// The diagnosis's verdict.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<String>,
    /// Warnings, one sentence each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Why it did not end well.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}
