//! The preview's page over HTTP, for this machine alone.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::{StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde_json::json;
use tokio::net::TcpListener;

use super::edit::Places;
use super::watch::{Picture, Watch};
use camera::calibration::{Plane, Px};
use config::RigConfig;
use daemon::web::{Hosts, protect, uniform_errors};
use ground::error_chain::with_causes;
use record::outputs::OutputFile;
use tank::render::outlines;

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum PreviewError {
    /// Somebody else has the port.
    #[error("serving the preview at 127.0.0.1:{port}; choose another --port, or 0 for any")]
    Port {
        /// Which.
        port: u16,
        /// What the system said.
        source: std::io::Error,
    },
    /// The server ended.
    #[error("serving the preview")]
    Serve(#[from] std::io::Error),
}

/// The page, not served yet.
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    page: Arc<Page>,
}

/// What the page is made of.
struct Page {
    watch: Watch,
    config: OutputFile,
}

impl Server {
    /// Listens at `port` of the loopback, any where it is 0, for a page that shows `watch` and writes into the `config`.
    ///
    /// # Errors
    /// [`PreviewError::Port`].
    pub async fn listen(port: u16, watch: Watch, config: OutputFile) -> Result<Self, PreviewError> {
        let taken = |source| PreviewError::Port { port, source };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).await.map_err(taken)?;
        let address = listener.local_addr().map_err(taken)?;
        Ok(Self { listener, address, page: Arc::new(Page { watch, config }) })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until `end` comes; connections that are open then are cut.
    ///
    /// # Errors
    /// [`PreviewError::Serve`].
    pub async fn serve(self, end: impl Future<Output = ()>) -> Result<(), PreviewError> {
        let fixed = |kind: &'static str, text: &'static str| {
            get(async move || ([(header::CONTENT_TYPE, kind)], text))
        };
        let router = Router::new()
            .route("/", fixed("text/html; charset=utf-8", PAGE))
            .route("/page.css", fixed("text/css; charset=utf-8", STYLE))
            .route("/page.js", fixed("text/javascript; charset=utf-8", SCRIPT))
            .route("/state", get(state))
            .route("/plain.jpg", get(async |page| picture(page, |picture| &picture.plain)))
            .route("/marked.jpg", get(async |page| picture(page, |picture| &picture.marked)))
            .route("/config", post(write))
            .with_state(self.page)
            .layer(middleware::from_fn(guarded))
            .layer(middleware::from_fn(uniform_errors));
        tokio::select! {
            served = axum::serve(self.listener, router) => Ok(served?),
            () = end => Ok(()),
        }
    }
}

async fn guarded(request: Request, next: Next) -> Response {
    if !Hosts::default().is_same_origin(request.headers()) {
        let why = "this page is for 127.0.0.1 and localhost, asked from itself";
        return (StatusCode::FORBIDDEN, why).into_response();
    }
    let mut response = next.run(request).await;
    protect(response.headers_mut());
    response
}

fn picture(State(page): State<Arc<Page>>, of: impl Fn(&Picture) -> &Vec<u8>) -> Response {
    let bytes = page.watch.picture().map(|picture| of(&picture).clone()).filter(|bytes| !bytes.is_empty());
    match bytes {
        Some(bytes) => ([(header::CONTENT_TYPE, "image/jpeg")], bytes).into_response(),
        None => (StatusCode::SERVICE_UNAVAILABLE, "no picture yet").into_response(),
    }
}

async fn state(State(page): State<Arc<Page>>) -> Response {
    let picture = page.watch.picture();
    let (measures, unreadable) = match picture.as_ref().map(|picture| &picture.measures) {
        Some(Ok(measures)) => (Some(measures), None),
        Some(Err(why)) => (None, Some(why)),
        None => (None, None),
    };
    let state = json!({
        "rolling": page.watch.rolling(),
        "sequence": picture.as_ref().map(|picture| picture.sequence),
        "size_px": picture.as_ref().map(|picture| picture.size_px),
        "measures": measures,
        "unreadable": unreadable,
        "config": Known::of(page.config.path()),
    });
    Json(state).into_response()
}

/// What the config says now.
#[derive(serde::Serialize)]
struct Known {
    file: String,
    base_px: Option<Px>,
    origin_px: Option<Px>,
    /// The origin belongs to a calibration file.
    origin_is_fixed: bool,
    /// The model's links at rest, as the calibration has them in the picture: corners of each.
    links_px: Vec<Vec<Px>>,
    error: Option<String>,
}

impl Known {
    fn of(path: &Path) -> Self {
        let file = path.display().to_string();
        match RigConfig::read(path) {
            Ok(config) => {
                let folder = path.parent().unwrap_or(Path::new(""));
                let plane = config.calibration.plane(folder).ok();
                let links_px = plane.as_ref().and_then(|plane| links_at_rest(&config, folder, plane));
                Self {
                    file,
                    base_px: config.vision.base(),
                    origin_px: plane.map(|plane| plane.pixel([0.0, 0.0])),
                    origin_is_fixed: config.calibration.file.is_some(),
                    links_px: links_px.unwrap_or_default(),
                    error: None,
                }
            }
            Err(error) => Self {
                file,
                base_px: None,
                origin_px: None,
                origin_is_fixed: false,
                links_px: Vec::new(),
                error: Some(with_causes(&error)),
            },
        }
    }
}

/// Outlines of the model's shapes at rest; none where the model cannot be read, which `rig doctor` tells.
fn links_at_rest(config: &RigConfig, folder: &Path, plane: &Plane) -> Option<Vec<Vec<Px>>> {
    let model = sim::Model::read_mjcf(&folder.join(&config.run.model)).ok()?;
    Some(outlines(&model, &model.rest_state().qpos, plane))
}

async fn write(State(page): State<Arc<Page>>, Json(places): Json<Places>) -> Response {
    let no_picture = || (StatusCode::SERVICE_UNAVAILABLE, "no picture yet").into_response();
    let Some(picture) = page.watch.picture() else { return no_picture() };
    let written = {
        let config = page.config.clone();
        tokio::task::spawn_blocking(move || places.write(&config, picture.size_px)).await
    };
    match written {
        Ok(Ok(())) => Json(json!({ "written": page.config.path().display().to_string() })).into_response(),
        Ok(Err(error)) => (StatusCode::UNPROCESSABLE_ENTITY, with_causes(&error)).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
    }
}

#[cfg(test)]
mod tests;
