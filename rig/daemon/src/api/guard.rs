//! Which requests are accepted, and their time limit.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::server::Connection;
use super::{Api, Problem, page};
use crate::web::protect;

/// Time limit of a request. Chosen.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);

/// Lets a request pass, or says why not.
pub(super) async fn guarded(State(api): State<Arc<Api>>, request: Request, next: Next) -> Response {
    let mut response = match refused(&api, &request) {
        Some(problem) => problem.into_response(),
        None => next.run(request).await,
    };
    protect(response.headers_mut());
    response
}

fn refused(api: &Api, request: &Request) -> Option<Problem> {
    if !api.hosts.is_same_origin(request.headers()) {
        return Some(Problem::new(
            StatusCode::FORBIDDEN,
            "asked by a page from elsewhere, or under a name that is not this server's; name it with `rig daemon --host NAME`",
        ));
    }
    let reads = [Method::GET, Method::HEAD].contains(request.method());
    let is_free = api.is_loopback || page::is_page(request.uri().path());
    let has_token = has_token(api, request.headers());
    if has_token && let Some(connection) = request.extensions().get::<Arc<Connection>>() {
        connection.shows_token();
    }
    if reads && is_free || has_token {
        return None;
    }
    Some(Problem::new(
        StatusCode::UNAUTHORIZED,
        "the token is wanted, as `Authorization: Bearer ...`: it is in `.token` in the runs folder",
    ))
}

fn has_token(api: &Api, headers: &HeaderMap) -> bool {
    let token = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
    token.and_then(|token| token.strip_prefix("Bearer ")).is_some_and(|token| api.token.is(token))
}

/// Ends a request that takes too long, also one whose body arrives too slowly.
pub(super) async fn in_time(request: Request, next: Next) -> Response {
    match tokio::time::timeout(REQUEST_TIMEOUT, next.run(request)).await {
        Ok(response) => response,
        Err(_) => Problem::new(
            StatusCode::REQUEST_TIMEOUT,
            format!("not done within {} s; try again", REQUEST_TIMEOUT.as_secs()),
        )
        .into_response(),
    }
}
