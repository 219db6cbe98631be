//! What a rig of the daemon is doing, for whoever looks on.

use serde::Serialize;
use utoipa::ToSchema;

/// See the module.
#[derive(Debug, Clone, Default, PartialEq, Serialize, ToSchema)]
pub(super) struct RigState {
    /// Its name: that of its config's file.
    pub name: String,
    /// What its config calls the experiment.
    pub experiment: String,
    /// When the schedule next wants a run; none without a schedule.
    pub next_run: Option<String>,
    /// The job that moves it.
    pub motion: Option<i64>,
    /// The job that computes.
    pub analysis: Option<i64>,
    /// The water is left alone after a motion; no other one begins.
    pub rests: bool,
    /// Motions that have ended since the daemon began.
    pub motions_ended: u64,
}
