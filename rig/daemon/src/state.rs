//! The state of a rig, for the API and the page.

use serde::Serialize;
use utoipa::ToSchema;

use ground::hold::Hold;
use servo::motion::{Motion, Standing};

/// The state of one rig, as the API and the page show it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, ToSchema)]
pub(super) struct RigState {
    /// Its name: that of its config's file.
    pub name: String,
    /// What its config calls the experiment.
    pub experiment: String,
    /// What it does, in one word.
    pub doing: Doing,
    /// State of its servos, as measured.
    pub servos: Standing,
    /// Why nothing may move, until somebody releases it.
    pub hold: Option<Hold>,
    /// When the schedule next wants a run; none without a schedule.
    pub next_run: Option<String>,
    /// The running job that moves it, also while that job computes.
    pub motion: Option<i64>,
    /// The running job that only computes.
    pub analysis: Option<i64>,
    /// Why no motion begins although a job waits.
    pub waits: Option<String>,
    /// The error that keeps the daemon from working.
    pub trouble: Option<String>,
    /// Motions that have ended since the daemon began.
    pub motions_ended: u64,
}

/// What a rig does.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Doing {
    /// Nothing.
    #[default]
    AtRest,
    /// Only the computer is at work.
    Computing,
    /// A motion begins soon.
    Announced,
    /// Something has power: it may move at any instant.
    Armed,
    /// Something moves.
    Moving,
    /// Nobody knows.
    Unknown,
}

impl Doing {
    /// All states with their names.
    pub(super) const ALL: [(Self, &str); 6] = [
        (Self::AtRest, "at-rest"),
        (Self::Computing, "computing"),
        (Self::Announced, "announced"),
        (Self::Armed, "armed"),
        (Self::Moving, "moving"),
        (Self::Unknown, "unknown"),
    ];

    /// From the servos' state, and whether a job runs.
    pub(super) fn of(motion: Motion, computes: bool) -> Self {
        match motion {
            Motion::AtRest if computes => Self::Computing,
            Motion::AtRest => Self::AtRest,
            Motion::Announced => Self::Announced,
            Motion::Armed => Self::Armed,
            Motion::Moving => Self::Moving,
            Motion::Unknown => Self::Unknown,
        }
    }
}

impl RigState {
    /// The state in a few words.
    pub(super) fn status_line(&self) -> String {
        let job = self.motion.or(self.analysis).map_or(String::new(), |job| format!(" (job {job})"));
        let what = match (self.doing, &self.hold, &self.next_run) {
            (Doing::Computing, ..) => format!("computes{job}"),
            (Doing::AtRest, Some(hold), _) => hold.to_string(),
            (Doing::AtRest, None, Some(next)) => format!("next run at {next}"),
            (Doing::AtRest, None, None) => "waits for jobs".into(),
            _ => format!("servos {}{job}", self.servos),
        };
        format!("{}: {what}", self.name)
    }
}
