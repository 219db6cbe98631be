//! The daemon over HTTP, and its page: what its rigs do, their queues, their runs and reports, and how their coefficients went.
//!
//! Version 1 of it is everything below `/api/v1`; `/api/v1/openapi.json` describes it. Reading is free on the loopback. What moves a
//! rig or changes its queue wants the token of the runs folder (`Authorization: Bearer`), which only the user whose daemon it is can
//! read; off the loopback reading wants it too. Names and ids in paths are looked up, never joined into a path.

mod body;
mod document;
mod events;
mod guard;
mod jobs;
mod live;
mod metrics;
mod page;
mod runs;
mod server;
mod stop;
pub(super) mod token;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router, middleware};
use serde::Serialize;
use tokio::net::TcpListener;
use tokio::sync::watch;
use utoipa::{OpenApi, ToSchema};

use super::Heartbeat;
use super::state::RigState;
use super::stop::Stop;
use crate::web::{Hosts, uniform_errors};
use config::RigConfig;
use document::InCommon;
use store::job::Lane;
use store::{Limit, Store, StoreError};
use token::Token;

/// Size of a request's body at most \[bytes\]: a job that names every run of a year fits.
const REQUEST_BODY_LIMIT_BYTES: usize = 64 << 10;

/// What the server serves.
pub(super) struct Api {
    rigs: Vec<Arc<Served>>,
    token: Token,
    hosts: Hosts,
    /// Whether the address is the loopback, where reading needs no token.
    is_loopback: bool,
}

/// One of its rigs.
pub(super) struct Served {
    /// Where its config is.
    path: PathBuf,
    config: RigConfig,
    runs_dir: PathBuf,
    stop: Arc<Stop>,
    store: Mutex<Store>,
    state: watch::Receiver<RigState>,
    snapshot: watch::Receiver<Arc<str>>,
    /// Live views of its two lanes: motion, analysis.
    shown: [Arc<live::LiveView>; 2],
}

#[derive(OpenApi)]
#[openapi(
    info(
        title = "rig daemon",
        description = "Rigs, their queues and their runs. What changes something wants the token."
    ),
    paths(
        rigs,
        jobs::list,
        jobs::show,
        jobs::add,
        jobs::cancel,
        jobs::cancel_all,
        jobs::retry,
        jobs::alerts,
        stop::stop,
        stop::release,
        runs::list,
        runs::show,
        runs::file,
        runs::coefficients,
        runs::trend,
        runs::model_changes,
        events::events,
        live::live,
        metrics::metrics,
        document::document
    ),
    modifiers(&InCommon),
    components(schemas(Problem, analysis::showing::Snapshot))
)]
struct Document;

/// Why a request was not carried out.
#[derive(Debug, Serialize, ToSchema)]
struct Problem {
    /// What is wrong, and what to do.
    error: String,
    #[serde(skip)]
    status: StatusCode,
}

impl Problem {
    fn new(status: StatusCode, error: impl ToString) -> Self {
        Self { error: error.to_string(), status }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        (self.status, Json(self)).into_response()
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        let status = match &error {
            StoreError::NoJob(_) => StatusCode::NOT_FOUND,
            StoreError::Limit(Limit::Waiting(_)) => StatusCode::TOO_MANY_REQUESTS,
            StoreError::Limit(_) => StatusCode::UNPROCESSABLE_ENTITY,
            StoreError::Over { .. }
            | StoreError::NotOver { .. }
            | StoreError::Done(_)
            | StoreError::SameKey(_) => StatusCode::CONFLICT,
            _ => StatusCode::INTERNAL_SERVER_ERROR,
        };
        Self::new(status, ground::error_chain::with_causes(&error))
    }
}

impl Served {
    /// # Errors
    /// [`StoreError`] where its database cannot be opened a second time.
    pub(super) fn new(
        (path, config): (PathBuf, RigConfig),
        runs_dir: PathBuf,
        stop: Arc<Stop>,
        state: watch::Receiver<RigState>,
        heartbeat: Arc<Heartbeat>,
    ) -> Result<Self, StoreError> {
        let snapshot = events::watch_rig(Store::open(&runs_dir)?, state.clone(), heartbeat);
        let shown =
            [Lane::Motion, Lane::Analysis].map(|lane| live::LiveView::watch(&runs_dir, lane, state.clone()));
        let store = Mutex::new(Store::open(&runs_dir)?);
        Ok(Self { path, config, runs_dir, stop, store, state, snapshot, shown })
    }

    fn store(&self) -> MutexGuard<'_, Store> {
        self.store.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Queries its database on a blocking thread.
    async fn ask<T: Send + 'static>(
        self: &Arc<Self>,
        query: impl FnOnce(&mut Store) -> Result<T, StoreError> + Send + 'static,
    ) -> Result<T, Problem> {
        let served = Arc::clone(self);
        let answer = tokio::task::spawn_blocking(move || query(&mut served.store())).await;
        Ok(answer.map_err(|error| Problem::new(StatusCode::INTERNAL_SERVER_ERROR, error))??)
    }
}

impl Api {
    pub(super) fn new(rigs: Vec<Served>, token: Token, address: SocketAddr, hosts: Vec<String>) -> Self {
        Self {
            rigs: rigs.into_iter().map(Arc::new).collect(),
            token,
            hosts: Hosts::and(hosts),
            is_loopback: address.ip().is_loopback(),
        }
    }

    fn rig(&self, name: &str) -> Result<Arc<Served>, Problem> {
        let found = self.rigs.iter().find(|rig| rig.state.borrow().name == name);
        found.cloned().ok_or_else(|| {
            Problem::new(StatusCode::NOT_FOUND, format!("no rig is called `{name}`; /api/v1/rigs lists them"))
        })
    }

    /// Serves until it is dropped.
    ///
    /// # Errors
    /// What the system says.
    pub(super) async fn serve(self, listener: TcpListener) -> std::io::Result<()> {
        server::serve(listener, self.router()).await
    }

    /// Who answers what.
    pub(super) fn router(self) -> Router {
        let api = Arc::new(self);
        let reading = Router::new()
            .route("/api/v1/rigs", get(rigs))
            .route("/api/v1/rigs/{rig}/jobs/{job}", get(jobs::show))
            .route("/api/v1/rigs/{rig}/alerts", get(jobs::alerts))
            .route("/api/v1/rigs/{rig}/runs", get(runs::list))
            .route("/api/v1/rigs/{rig}/runs/{run}", get(runs::show))
            .route("/api/v1/rigs/{rig}/runs/{run}/{file}", get(runs::file))
            .route("/api/v1/rigs/{rig}/coefficients", get(runs::coefficients))
            .route("/api/v1/rigs/{rig}/trend", get(runs::trend))
            .route("/api/v1/rigs/{rig}/model-changes", get(runs::model_changes))
            .route("/api/v1/openapi.json", get(document::document))
            .route("/metrics", get(metrics::metrics))
            .merge(page::routes());
        let changing = Router::new()
            .route("/api/v1/rigs/{rig}/jobs", get(jobs::list).post(jobs::add))
            .route("/api/v1/rigs/{rig}/jobs/{job}/cancel", post(jobs::cancel))
            .route("/api/v1/rigs/{rig}/jobs/{job}/retry", post(jobs::retry))
            .route("/api/v1/rigs/{rig}/jobs/cancel", post(jobs::cancel_all))
            .route("/api/v1/rigs/{rig}/stop", post(stop::stop))
            .route("/api/v1/rigs/{rig}/release", post(stop::release));
        reading
            .merge(changing)
            .layer(middleware::from_fn(guard::in_time))
            // a stream of events has no end to wait for
            .route("/api/v1/events", get(events::events))
            .route("/api/v1/rigs/{rig}/live", get(live::live))
            .layer(DefaultBodyLimit::max(REQUEST_BODY_LIMIT_BYTES))
            .layer(middleware::from_fn_with_state(Arc::clone(&api), guard::guarded))
            .layer(middleware::from_fn(uniform_errors))
            .with_state(api)
    }
}

/// The states of all rigs.
#[utoipa::path(get, path = "/api/v1/rigs", responses((status = 200, description = "Each rig.", body = [RigState])))]
async fn rigs(State(api): State<Arc<Api>>) -> Json<Vec<RigState>> {
    Json(api.rigs.iter().map(|rig| rig.state.borrow().clone()).collect())
}

/// The rig's name in a request's path.
type InRig = Path<String>;
