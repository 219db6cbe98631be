//! The requests that stop a rig and that release it.

use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::body::{Body, to_bytes};
use axum::extract::{Path, State};
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::body::Body as Lenient;
use super::{Api, InRig, Problem};
use app::{self, Failure};
use ground::hold::Hold;
use servo::motion::Standing;

/// Time to read name and reason from the request's body; the stop itself does not wait for it. Chosen.
const BODY_TIMEOUT: Duration = Duration::from_millis(50);
/// Length of the body that is read \[bytes\]. Chosen.
const BODY_LIMIT_BYTES: usize = 4096;
/// Time for writing the hold; after it the answer says that it is not written. Chosen.
const HOLD_WRITE_TIMEOUT: Duration = Duration::from_secs(1);

/// Who stops, and why. Any of it may be missing, and whatever else is sent stops as well.
#[derive(Debug, Default, Deserialize, ToSchema)]
#[serde(default)]
pub(super) struct Words {
    /// Who, or which program, stops.
    by: Option<String>,
    /// The reason.
    why: Option<String>,
}

/// A stop that was carried out.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Stopped {
    /// The hold, until the rig is released.
    hold: Hold,
    /// State of its servos when it was stopped.
    servos: Standing,
    /// Whether the hold is on the disk; else the daemon alone holds the rig, and goes on trying.
    written: bool,
}

/// Stops what moves the rig now, and holds all that could move it until somebody releases it. Any body will do.
#[utoipa::path(post, path = "/api/v1/rigs/{rig}/stop", params(("rig" = String, Path)), request_body = Words, responses((status = 200, description = "Stopped and held.", body = Stopped)))]
pub(super) async fn stop(
    State(api): State<Arc<Api>>,
    Path(rig): InRig,
    body: Body,
) -> Result<Json<Stopped>, Problem> {
    let rig = api.rig(&rig)?;
    let servos = rig.state.borrow().servos.clone();
    rig.stop.request(Hold::now("somebody over HTTP", "stopped"));
    let words = tokio::time::timeout(BODY_TIMEOUT, to_bytes(body, BODY_LIMIT_BYTES)).await;
    let words = words.ok().and_then(Result::ok).map(|bytes| parse_words(&bytes)).unwrap_or_default();
    rig.stop.explain(words.by.as_deref(), words.why.as_deref());
    let writing = Arc::clone(&rig);
    let written = tokio::task::spawn_blocking(move || writing.stop.write(Duration::ZERO));
    let written = matches!(tokio::time::timeout(HOLD_WRITE_TIMEOUT, written).await, Ok(Ok(Ok(()))));
    let hold = rig.stop.held().unwrap_or_else(|| Hold::now("somebody over HTTP", "stopped"));
    Ok(Json(Stopped { hold, servos, written }))
}

/// Name and reason from a body; a body that is not JSON is the reason.
fn parse_words(body: &[u8]) -> Words {
    serde_json::from_slice(body).unwrap_or_else(|_| {
        let why = String::from_utf8_lossy(body).trim().to_owned();
        Words { by: None, why: Some(why).filter(|why| !why.is_empty()) }
    })
}

/// Who releases the rig.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Releases {
    /// A person's name.
    by: String,
}

/// What was released.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Released {
    /// What was released, in words.
    released: String,
}

/// Ends the hold, in somebody's name: an emergency stop that the board has latched is acknowledged, and what waits goes on.
#[utoipa::path(post, path = "/api/v1/rigs/{rig}/release", params(("rig" = String, Path)), request_body = Releases, responses((status = 200, description = "What was released.", body = Released)))]
pub(super) async fn release(
    State(api): State<Arc<Api>>,
    Path(rig): InRig,
    Lenient(Releases { by }): Lenient<Releases>,
) -> Result<Json<Released>, Problem> {
    let rig = api.rig(&rig)?;
    let released = tokio::task::spawn_blocking(move || {
        let released = app::stop::release(&rig.config, Some(&rig.runs_dir), &by)?;
        rig.stop.forget();
        Ok(released)
    });
    let released = released.await.map_err(|error| Problem::new(StatusCode::INTERNAL_SERVER_ERROR, error))?;
    released.map(|released| Json(Released { released })).map_err(|failure: Failure| {
        let status = match &failure {
            Failure::Input(_) => StatusCode::UNPROCESSABLE_ENTITY,
            Failure::Hardware(_) => StatusCode::CONFLICT,
            _ => StatusCode::INTERNAL_SERVER_ERROR,
        };
        Problem::new(status, format!("{:#}", failure.error()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_body_is_a_reason_or_none() {
        let why = |body: &str| parse_words(body.as_bytes()).why;
        assert_eq!(why(""), None);
        assert_eq!(why("{}"), None);
        assert_eq!(why(r#"{"why":"a hand","colour":"red"}"#).as_deref(), Some("a hand"));
        assert_eq!(why("{\"why\": 3}").as_deref(), Some("{\"why\": 3}"));
        assert_eq!(why("water on the floor").as_deref(), Some("water on the floor"));
        assert!(parse_words(&[0xFF, 0xFE]).why.is_some());
    }
}
