//! The runs of a rig, their files, and how coefficients went from run to run.

use std::sync::Arc;

use axum::Json;
use axum::extract::{Path, Query, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;

use super::{Api, InRig, Problem};
use record::below;
use record::folder::file;
use record::run_id::RunId;
use store::models::ModelChange;
use store::runs::{Coefficient, Summary};

/// Files of a run that are handed out, and what they are. A recording is too large for a page.
const FILES: [(&str, &str); 8] = [
    (file::REPORT, "text/html; charset=utf-8"),
    (file::FIT, "application/json"),
    (file::DIAGNOSIS, "application/json"),
    (file::TIMING, "application/json"),
    (file::MODEL, "application/xml"),
    (file::TRAJECTORY, "text/csv; charset=utf-8"),
    (file::SERVO, "text/csv; charset=utf-8"),
    (file::JOURNAL, "application/jsonl"),
];

/// A report is a page of its own: all that it needs is in it, and it may reach nothing else.
const REPORT_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; \
                             form-action 'none'; frame-ancestors 'self'; sandbox allow-scripts allow-downloads";

/// How many runs are listed.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct Page {
    /// At most so many, the newest.
    #[serde(default = "hundred")]
    most: usize,
    /// Of those older than this one.
    before: Option<String>,
}

const fn hundred() -> usize {
    100
}

/// Which coefficient.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct Named {
    /// For example `g3/blunt`.
    name: String,
}

/// Runs, oldest first.
#[utoipa::path(get, path = "/api/v1/rigs/{rig}/runs", operation_id = "list_runs", params(("rig" = String, Path), Page), responses((status = 200, description = "Runs.", body = [Summary])))]
pub(super) async fn list(
    State(api): State<Arc<Api>>,
    Path(rig): InRig,
    Query(Page { most, before }): Query<Page>,
) -> Result<Json<Vec<Summary>>, Problem> {
    let rig = api.rig(&rig)?;
    let list = rig.ask(move |store| {
        store.refresh(false)?;
        store.runs_before(before.as_deref(), most)
    });
    Ok(Json(list.await?))
}

/// One run.
#[utoipa::path(get, path = "/api/v1/rigs/{rig}/runs/{run}", operation_id = "show_run", params(("rig" = String, Path), ("run" = String, Path)), responses((status = 200, description = "The run.", body = Summary)))]
pub(super) async fn show(
    State(api): State<Arc<Api>>,
    Path((rig, run)): Path<(String, String)>,
) -> Result<Json<Summary>, Problem> {
    let (rig, id) = (api.rig(&rig)?, run_id(run)?);
    let found = tokio::task::spawn_blocking(move || {
        rig.runs_dir.join(id.as_str()).is_dir().then(|| Summary::within(&rig.runs_dir, &id))
    });
    let found = found.await.map_err(|error| Problem::new(StatusCode::INTERNAL_SERVER_ERROR, error))?;
    found.map(Json).ok_or_else(no_run)
}

/// A file of a run: its report, its fit and the like.
#[utoipa::path(get, path = "/api/v1/rigs/{rig}/runs/{run}/{file}", params(("rig" = String, Path), ("run" = String, Path), ("file" = String, Path)), responses((status = 200, description = "The file.", content((String = "text/html"), (String = "text/csv"), (String = "application/jsonl"), (String = "application/xml"), (Object = "application/json")))))]
pub(super) async fn file(
    State(api): State<Arc<Api>>,
    Path((rig, run, name)): Path<(String, String, String)>,
) -> Result<Response, Problem> {
    let (rig, id) = (api.rig(&rig)?, run_id(run)?);
    let Some((name, kind)) = FILES.into_iter().find(|(file, _)| *file == name) else {
        let names: Vec<&str> = FILES.iter().map(|(name, _)| *name).collect();
        let error = format!("a run's files here are {}", names.join(", "));
        return Err(Problem::new(StatusCode::NOT_FOUND, error));
    };
    let (runs_dir, run) = (rig.runs_dir.clone(), id.clone());
    let read = tokio::task::spawn_blocking(move || below::read(&runs_dir, &[run.as_str(), name])).await;
    match read.unwrap_or_else(|error| Err(std::io::Error::other(error))) {
        Ok(bytes) if name == file::REPORT => {
            let policy = (header::CONTENT_SECURITY_POLICY, REPORT_POLICY);
            Ok(([(header::CONTENT_TYPE, kind), policy], bytes).into_response())
        }
        Ok(bytes) => Ok(([(header::CONTENT_TYPE, kind)], bytes).into_response()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            Err(Problem::new(StatusCode::NOT_FOUND, format!("run {id} has no {name}")))
        }
        Err(error) if error.kind() == std::io::ErrorKind::InvalidInput => Err(Problem::new(
            StatusCode::FORBIDDEN,
            format!(
                "{name} of run {id} is not handed out: {error}; put the file itself into the run's folder"
            ),
        )),
        Err(error) => Err(Problem::new(StatusCode::INTERNAL_SERVER_ERROR, error)),
    }
}

/// Names of all coefficients that any run's fit found.
#[utoipa::path(get, path = "/api/v1/rigs/{rig}/coefficients", params(("rig" = String, Path)), responses((status = 200, description = "Names.", body = [String])))]
pub(super) async fn coefficients(
    State(api): State<Arc<Api>>,
    Path(rig): InRig,
) -> Result<Json<Vec<String>>, Problem> {
    let rig = api.rig(&rig)?;
    let names = rig.ask(|store| {
        store.refresh(false)?;
        store.coefficient_names()
    });
    Ok(Json(names.await?))
}

/// How a coefficient was found, run after run.
#[utoipa::path(get, path = "/api/v1/rigs/{rig}/trend", params(("rig" = String, Path), Named), responses((status = 200, description = "Values, oldest first.", body = [Coefficient])))]
pub(super) async fn trend(
    State(api): State<Arc<Api>>,
    Path(rig): InRig,
    Query(Named { name }): Query<Named>,
) -> Result<Json<Vec<Coefficient>>, Problem> {
    Ok(Json(api.rig(&rig)?.ask(move |store| store.trend(&name)).await?))
}

/// Where the model was changed from one run to the next.
#[utoipa::path(get, path = "/api/v1/rigs/{rig}/model-changes", params(("rig" = String, Path)), responses((status = 200, description = "Changes, oldest first.", body = [ModelChange])))]
pub(super) async fn model_changes(
    State(api): State<Arc<Api>>,
    Path(rig): InRig,
) -> Result<Json<Vec<ModelChange>>, Problem> {
    let rig = api.rig(&rig)?;
    let changes = rig.ask(|store| {
        store.refresh(false)?;
        store.model_changes()
    });
    Ok(Json(changes.await?))
}

fn run_id(run: String) -> Result<RunId, Problem> {
    RunId::try_from(run).map_err(|_| no_run())
}

fn no_run() -> Problem {
    Problem::new(StatusCode::NOT_FOUND, "there is no such run; /api/v1/rigs/RIG/runs lists them")
}
