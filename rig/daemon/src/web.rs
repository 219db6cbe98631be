//! What the servers of this program have in common: the form of an error, and which requests are accepted. They serve their own page
//! and programs on this machine, but no other web page that a browser on this machine happens to show.
//!
//! A browser can be made to send requests to the loopback in two ways. A page from elsewhere asks directly: then `Origin` and
//! `Sec-Fetch-Site` say so. Or a name is first made to point at that page and then at this machine: then the request counts as one
//! from the page itself, and only `Host` tells. All three are looked at.

use axum::Json;
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// What a page of such a server may load: itself, and pictures that its script has fetched.
pub const POLICY: &str = "default-src 'none'; style-src 'self'; script-src 'self'; connect-src 'self'; img-src 'self' blob:; \
                          base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// What every answer says to the browser.
pub const HEADERS: [(HeaderName, &str); 4] = [
    (header::CACHE_CONTROL, "no-store"),
    (header::CONTENT_SECURITY_POLICY, POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
];

/// The host names of a server.
#[derive(Debug, Clone, Default)]
pub struct Hosts {
    /// Names in addition to those of the loopback.
    others: Vec<String>,
}

impl Hosts {
    /// The names of the loopback, and `others`.
    pub fn and(others: impl IntoIterator<Item = String>) -> Self {
        Self { others: others.into_iter().map(|name| name.to_ascii_lowercase()).collect() }
    }

    /// Whether `host`, as a browser names whom it asks, is this server: a page from elsewhere whose name was made to point here is
    /// not.
    pub fn know(&self, host: &str) -> bool {
        let name = match host.rsplit_once(':') {
            Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
            _ => host,
        }
        .to_ascii_lowercase();
        ["127.0.0.1", "localhost", "[::1]"].contains(&name.as_str()) || self.others.contains(&name)
    }

    /// Whether a page of this server, or no page at all, asks with these `headers`.
    pub fn is_same_origin(&self, headers: &HeaderMap) -> bool {
        let text = |name: HeaderName| {
            headers.get(name).map(|value: &HeaderValue| value.to_str().unwrap_or_default())
        };
        let Some(host) = text(header::HOST) else { return false };
        let same = |origin: &str| {
            let origin = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
            origin.is_some_and(|origin| origin == host)
        };
        let site = HeaderName::from_static("sec-fetch-site");
        self.know(host)
            && text(header::ORIGIN).is_none_or(same)
            // "none": typed into the address bar
            && text(site).is_none_or(|site| ["same-origin", "none"].contains(&site))
    }
}

/// Adds those [`HEADERS`] that the answer does not set itself.
pub fn protect(headers: &mut HeaderMap) {
    for (name, value) in HEADERS {
        headers.entry(name).or_insert(HeaderValue::from_static(value));
    }
}

/// Length to which the error text of another part of the server is cut \[bytes\]. Chosen.
const ERROR_TEXT_LIMIT_BYTES: usize = 8 << 10;

/// Gives every error response the form `{"error": "..."}`, also those that the framework makes in other forms or without a text.
pub async fn uniform_errors(request: Request, next: Next) -> Response {
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let response = next.run(request).await;
    let is_json = |response: &Response| {
        response.headers().get(header::CONTENT_TYPE).is_some_and(|kind| kind == "application/json")
    };
    let status = response.status();
    if !(status.is_client_error() || status.is_server_error()) || is_json(&response) {
        return response;
    }
    let (mut head, body) = response.into_parts();
    let text = axum::body::to_bytes(body, ERROR_TEXT_LIMIT_BYTES).await.unwrap_or_default();
    let text = String::from_utf8_lossy(&text).trim().to_owned();
    let error = match status {
        StatusCode::METHOD_NOT_ALLOWED => format!("{path} is not for {method}"),
        _ if !text.is_empty() => text,
        StatusCode::NOT_FOUND => format!("there is nothing at {path}"),
        _ => status.canonical_reason().unwrap_or("refused").to_lowercase(),
    };
    // these headers belong to the old body
    for header in [header::CONTENT_TYPE, header::CONTENT_LENGTH] {
        head.headers.remove(header);
    }
    (head, Json(serde_json::json!({ "error": error }))).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(headers: &[(&'static str, &'static str)]) -> bool {
        let named = |(name, value): &(&'static str, &'static str)| {
            (HeaderName::from_static(name), HeaderValue::from_static(value))
        };
        Hosts::and(["rig.lab".to_owned()]).is_same_origin(&headers.iter().map(named).collect())
    }

    #[test]
    fn own_page_and_programs_may_ask_and_pages_from_elsewhere_may_not() {
        for own in [
            &[("host", "127.0.0.1:8080")][..],
            &[("host", "LocalHost:8080"), ("sec-fetch-site", "none")],
            &[("host", "[::1]:8080"), ("origin", "http://[::1]:8080"), ("sec-fetch-site", "same-origin")],
            &[("host", "rig.lab"), ("origin", "https://rig.lab")],
        ] {
            assert!(asked(own), "{own:?}");
        }
        for foreign in [
            &[][..],
            &[("host", "evil.example:8080")],
            &[("host", "127.0.0.1.evil.example")],
            &[("host", "127.0.0.1:8080"), ("origin", "http://evil.example")],
            &[("host", "127.0.0.1:8080"), ("origin", "null")],
            &[("host", "127.0.0.1:8080"), ("origin", "http://127.0.0.1:9090")],
            &[("host", "127.0.0.1:8080"), ("sec-fetch-site", "cross-site")],
            &[("host", "127.0.0.1:8080"), ("sec-fetch-site", "same-site")],
        ] {
            assert!(!asked(foreign), "{foreign:?}");
        }
    }
}
