//! The queue of a rig.

use std::sync::Arc;

use axum::Json;
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, StatusCode};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::body::Body;
use super::{Api, InRig, Problem};
use record::run_id::RunId;
use store::alerts::Alert;
use store::goal::Target;
use store::job::{Chosen, Job, JobId, NewJob, State as JobState, Work};

/// The header that marks repeated requests as one.
const IDEMPOTENCY_HEADER: &str = "Idempotency-Key";
const KEY_LIMIT_BYTES: usize = 200;

/// Length of a list.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct Most {
    /// Number of entries at most.
    #[serde(default = "thirty")]
    most: usize,
}

const fn thirty() -> usize {
    30
}

/// A job to add. Runs are named by their ids, and the rig's own config is used.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Wanted {
    work: WantedWork,
    /// Higher ones come first; of equal ones the older.
    #[serde(default)]
    priority: i32,
    /// The reason, for the record.
    #[serde(default)]
    why: Option<String>,
    /// The job does not begin before this time, RFC 3339.
    #[serde(default)]
    #[schema(value_type = Option<String>, format = DateTime)]
    not_before: Option<jiff::Timestamp>,
}

/// What a job does.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
enum WantedWork {
    /// One experiment: it moves the rig.
    Run {
        /// Only film: no extraction, no fit.
        #[serde(default)]
        film_only: bool,
    },
    /// A new fit of a run against the last good coefficients.
    Recalibrate {
        #[schema(value_type = String)]
        run: RunId,
    },
    /// A run's analysis again.
    Replay {
        #[schema(value_type = String)]
        run: RunId,
    },
    /// A fit of runs.
    Fit(WantedRuns),
    /// A diagnosis of runs: what their simulation gets wrong.
    Diagnose(WantedRuns),
    /// The design of the next runs, from those made.
    Design(WantedRuns),
    /// Runs until the goals are met: it moves the rig.
    Campaign {
        /// Parameters and how well they are to be known, as `g3/blunt 5%`; none: until the diagnosis has one clear verdict.
        #[serde(default)]
        #[schema(value_type = Vec<String>)]
        goals: Vec<Target>,
        /// The most runs it may make.
        max_runs: usize,
    },
}

/// Runs of an experiment.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct WantedRuns {
    /// Runs to fit.
    #[schema(value_type = Vec<String>)]
    runs: Vec<RunId>,
    /// Runs that are only scored.
    #[serde(default)]
    #[schema(value_type = Vec<String>)]
    holdout: Vec<RunId>,
}

impl From<WantedRuns> for Chosen {
    fn from(WantedRuns { runs, holdout }: WantedRuns) -> Self {
        Self { runs, holdout }
    }
}

/// Why something is asked for.
#[derive(Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Why {
    /// The reason, for the record.
    #[serde(default)]
    why: Option<String>,
}

/// A job, by its number.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct JobNumber {
    /// Its number.
    job: i64,
    /// Its state.
    state: String,
}

impl JobNumber {
    fn new(id: JobId, state: JobState) -> Self {
        Self { job: id.0, state: state.to_string() }
    }
}

/// Jobs: those that run, those that wait in the order of their turns, then the newest that are over.
#[utoipa::path(get, path = "/api/v1/rigs/{rig}/jobs", operation_id = "list_jobs", params(("rig" = String, Path), Most), responses((status = 200, description = "Jobs.", body = [Job])))]
pub(super) async fn list(
    State(api): State<Arc<Api>>,
    Path(rig): InRig,
    Query(Most { most }): Query<Most>,
) -> Result<Json<Vec<Job>>, Problem> {
    Ok(Json(api.rig(&rig)?.ask(move |store| store.jobs(most)).await?))
}

/// One job.
#[utoipa::path(get, path = "/api/v1/rigs/{rig}/jobs/{job}", operation_id = "show_job", params(("rig" = String, Path), ("job" = i64, Path)), responses((status = 200, description = "The job.", body = Job)))]
pub(super) async fn show(
    State(api): State<Arc<Api>>,
    Path((rig, job)): Path<(String, i64)>,
) -> Result<Json<Job>, Problem> {
    Ok(Json(api.rig(&rig)?.ask(move |store| store.job(JobId(job))).await?))
}

/// Adds a job. A request that may have to be sent again says `Idempotency-Key`, the same each time: it is one job.
#[utoipa::path(post, path = "/api/v1/rigs/{rig}/jobs", params(("rig" = String, Path), ("Idempotency-Key" = Option<String>, Header)), request_body = Wanted, responses((status = 201, description = "The new job, or that of the same key.", body = JobNumber)))]
pub(super) async fn add(
    State(api): State<Arc<Api>>,
    Path(rig): InRig,
    headers: HeaderMap,
    Body(wanted): Body<Wanted>,
) -> Result<(StatusCode, Json<JobNumber>), Problem> {
    let rig = api.rig(&rig)?;
    let key = headers.get(IDEMPOTENCY_HEADER).map(|key| key.to_str().map(str::to_owned)).transpose();
    let key = key.ok().filter(|key| key.as_ref().is_none_or(|key| key.len() <= KEY_LIMIT_BYTES));
    let key = key.ok_or_else(|| {
        let error = format!("Idempotency-Key: up to {KEY_LIMIT_BYTES} plain characters are wanted");
        Problem::new(StatusCode::UNPROCESSABLE_ENTITY, error)
    })?;
    let work = match wanted.work {
        WantedWork::Run { film_only } => Work::Run { config: rig.path.clone(), film_only },
        WantedWork::Recalibrate { run } => Work::Recalibrate { run },
        WantedWork::Replay { run } => Work::Replay { run, from: Default::default() },
        WantedWork::Fit(runs) => Work::Fit(runs.into()),
        WantedWork::Diagnose(runs) => Work::Diagnose(runs.into()),
        WantedWork::Design(runs) => Work::Design(runs.into()),
        WantedWork::Campaign { goals, max_runs } => {
            Work::Campaign { config: rig.path.clone(), goals, max_runs }
        }
    };
    let Wanted { priority, why, not_before, .. } = wanted;
    let job = NewJob { priority, why, not_before, key, ..NewJob::new(work) };
    let id = rig.ask(move |store| store.add(&job)).await?;
    Ok((StatusCode::CREATED, Json(JobNumber::new(id, JobState::Queued))))
}

/// Cancels a job; one that moves the rig is stopped, the servo first.
#[utoipa::path(post, path = "/api/v1/rigs/{rig}/jobs/{job}/cancel", params(("rig" = String, Path), ("job" = i64, Path)), request_body = Why, responses((status = 200, description = "Where it stands.", body = JobNumber)))]
pub(super) async fn cancel(
    State(api): State<Arc<Api>>,
    Path((rig, job)): Path<(String, i64)>,
    Body(Why { why }): Body<Why>,
) -> Result<Json<JobNumber>, Problem> {
    let why = why.unwrap_or_else(|| "cancelled over HTTP".into());
    let state = api.rig(&rig)?.ask(move |store| store.cancel(JobId(job), &why)).await?;
    Ok(Json(JobNumber::new(JobId(job), state)))
}

/// How many jobs were cancelled.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Cancelled {
    /// Number of jobs cancelled.
    cancelled: usize,
}

/// Cancels all jobs that wait.
#[utoipa::path(post, path = "/api/v1/rigs/{rig}/jobs/cancel", params(("rig" = String, Path)), request_body = Why, responses((status = 200, description = "How many.", body = Cancelled)))]
pub(super) async fn cancel_all(
    State(api): State<Arc<Api>>,
    Path(rig): InRig,
    Body(Why { why }): Body<Why>,
) -> Result<Json<Cancelled>, Problem> {
    let why = why.unwrap_or_else(|| "all were cancelled over HTTP".into());
    let cancelled = api.rig(&rig)?.ask(move |store| store.cancel_waiting(&why)).await?;
    Ok(Json(Cancelled { cancelled }))
}

/// Does again what a job that is over should have done; a motion that was done wants a job of its own.
#[utoipa::path(post, path = "/api/v1/rigs/{rig}/jobs/{job}/retry", params(("rig" = String, Path), ("job" = i64, Path)), request_body = Why, responses((status = 201, description = "The new job.", body = JobNumber)))]
pub(super) async fn retry(
    State(api): State<Arc<Api>>,
    Path((rig, job)): Path<(String, i64)>,
    Body(Why { why }): Body<Why>,
) -> Result<(StatusCode, Json<JobNumber>), Problem> {
    let id = api.rig(&rig)?.ask(move |store| store.retry(JobId(job), why)).await?;
    Ok((StatusCode::CREATED, Json(JobNumber::new(id, JobState::Queued))))
}

/// Alerts, the newest first.
#[utoipa::path(get, path = "/api/v1/rigs/{rig}/alerts", params(("rig" = String, Path), Most), responses((status = 200, description = "Alerts, the newest first.", body = [Alert])))]
pub(super) async fn alerts(
    State(api): State<Arc<Api>>,
    Path(rig): InRig,
    Query(Most { most }): Query<Most>,
) -> Result<Json<Vec<Alert>>, Problem> {
    Ok(Json(api.rig(&rig)?.ask(move |store| store.alerts(most)).await?))
}
