//! The daemon's page: fixed texts, which ask the API for everything they show.

use std::sync::Arc;

use axum::Router;
use axum::http::header;
use axum::routing::get;

use super::Api;

const SCRIPT: &str = "text/javascript; charset=utf-8";
const FILES: [(&str, &str, &str); 8] = [
    ("/", "text/html; charset=utf-8", include_str!("../page/page.html")),
    ("/page.css", "text/css; charset=utf-8", include_str!("../page/page.css")),
    ("/icon.svg", "image/svg+xml", include_str!("../page/icon.svg")),
    ("/page.js", SCRIPT, include_str!("../page/page.js")),
    ("/api.js", SCRIPT, include_str!("../page/api.js")),
    ("/chart.js", SCRIPT, include_str!("../page/chart.js")),
    ("/live.js", SCRIPT, include_str!("../page/live.js")),
    ("/trends.js", SCRIPT, include_str!("../page/trends.js")),
];

/// Whether `path` is the page's, which holds nothing of a rig and may be had without the token: it asks for that.
pub(super) fn is_page(path: &str) -> bool {
    FILES.iter().any(|(file, ..)| *file == path)
}

pub(super) fn routes() -> Router<Arc<Api>> {
    FILES.into_iter().fold(Router::new(), |router, (path, kind, text)| {
        router.route(path, get(async move || ([(header::CONTENT_TYPE, kind)], text)))
    })
}
