//! What a request brings: JSON, whatever it calls itself.

use axum::Json;
use axum::body::Bytes;
use axum::extract::{FromRequest, Request};
use serde::de::DeserializeOwned;

use super::Problem;

/// A request's body, from JSON. Nothing counts but what it holds: a client that says another kind of content, or none, or that sends
/// nothing at all where every part may be left out, means no less what it says.
pub(super) struct Body<T>(pub(super) T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequest<S> for Body<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let bytes = Bytes::from_request(request, state).await;
        let bytes = bytes.map_err(|error| Problem::new(error.status(), error.body_text()))?;
        let text = if bytes.trim_ascii().is_empty() { b"{}" } else { &bytes[..] };
        match Json::from_bytes(text) {
            Ok(Json(value)) => Ok(Self(value)),
            Err(error) => Err(Problem::new(error.status(), error.body_text())),
        }
    }
}

#[cfg(test)]
mod tests {
    use axum::http::StatusCode;

    use super::*;
    use store::{Limit, StoreError};

    #[derive(Debug, Default, PartialEq, serde::Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Said {
        why: Option<String>,
    }

    fn read(kind: &str, text: &'static str) -> Result<Said, StatusCode> {
        let request = axum::http::Request::builder().header("content-type", kind).body(text.into()).unwrap();
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let read = runtime.block_on(Body::from_request(request, &()));
        read.map(|Body(said)| said).map_err(|problem| problem.status)
    }

    #[test]
    fn body_counts_by_what_it_holds_and_by_nothing_else() {
        let said = Said { why: Some("wet".into()) };
        for kind in ["application/json", "text/plain", "application/x-www-form-urlencoded", "nonsense"] {
            assert_eq!(read(kind, r#"{"why":"wet"}"#).as_ref(), Ok(&said), "{kind}");
            assert_eq!(read(kind, " \n"), Ok(Said::default()), "{kind}");
            assert_eq!(read(kind, "{"), Err(StatusCode::BAD_REQUEST), "{kind}");
            assert_eq!(read(kind, r#"{"who":"me"}"#), Err(StatusCode::UNPROCESSABLE_ENTITY), "{kind}");
        }
    }

    #[test]
    fn full_queue_is_for_later_and_what_is_too_much_is_not_possible() {
        let status = |limit: Limit| Problem::from(StoreError::from(limit)).status;
        assert_eq!(status(Limit::Waiting(1000)), StatusCode::TOO_MANY_REQUESTS);
        assert_eq!(status(Limit::Why(201)), StatusCode::UNPROCESSABLE_ENTITY);
    }
}
