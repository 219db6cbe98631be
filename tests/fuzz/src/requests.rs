//! Requests to the daemon.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::{HeaderName, HeaderValue, Request, StatusCode, header};
use daemon::{Daemon, Options};
use tempfile::TempDir;
use tokio::runtime::Runtime;
use tower_service::Service as _;

/// So many requests meet one queue, which is then made anew: its jobs only become more. Chosen.
const REQUESTS_PER_QUEUE: u32 = 500;
/// The longest answer that is read \[bytes\].
const ANSWER_LIMIT_BYTES: usize = 16 << 20;

/// The daemon of a mock rig with one run, whose loop stands still.
struct Asked {
    router: Router,
    token: String,
    requests: u32,
    _daemon: Daemon,
    runtime: Runtime,
    _folder: TempDir,
}

impl Asked {
    fn new() -> Result<Self, Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let run = folder.path().join("20261120T101503Z-ab12cd");
        std::fs::create_dir(&run)?;
        std::fs::write(run.join("fit.json"), "{}")?;
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/chain-driven-pose-1.toml");
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let configs: [PathBuf; 1] = [config];
        let options = Options {
            configs: &configs,
            runs_dir: folder.path(),
            threads: 1,
            listen: Some(([127, 0, 0, 1], 0).into()),
            hosts: &[],
        };
        let opened = runtime.block_on(Daemon::open(&options, &mut Nobody));
        let mut daemon = opened.map_err(|failure| format!("{:#}", failure.error()))?;
        let router = daemon.take_router().ok_or("it has a server")?;
        let token = std::fs::read_to_string(folder.path().join(".token"))?;
        Ok(Self { router, token, requests: 0, _daemon: daemon, runtime, _folder: folder })
    }

    /// Status, kind of content and text of an answer; text only of what is JSON, for what it shows live has no end.
    fn ask(&mut self, mut request: Request<Body>) -> (StatusCode, bool, Vec<u8>) {
        self.requests += 1;
        let usual = [
            (header::HOST, "localhost".to_owned()),
            (header::AUTHORIZATION, format!("Bearer {}", self.token)),
        ];
        for (name, value) in usual {
            let value = HeaderValue::from_str(&value).unwrap_or(HeaderValue::from_static(""));
            request.headers_mut().entry(name).or_insert(value);
        }
        let mut router = self.router.clone();
        self.runtime.block_on(async {
            let Ok(answer) = router.call(request).await;
            let (status, json) = (answer.status(), HeaderValue::from_static("application/json"));
            let is_json = answer.headers().get(header::CONTENT_TYPE) == Some(&json);
            if !is_json {
                return (status, false, Vec::new());
            }
            let text = to_bytes(answer.into_body(), ANSWER_LIMIT_BYTES).await;
            (status, true, text.unwrap_or_else(|error| panic!("an answer's text: {error}")).to_vec())
        })
    }
}

/// The rig's part of a path, for which a request may say `~`: changes then meet what is behind it.
const RIG: &str = "/api/v1/rigs/chain-driven-pose-1";

/// Text as `METHOD /path`, lines of a header, an empty line, and any bytes behind it.
fn request(bytes: &[u8]) -> Option<Request<Body>> {
    let end = bytes.windows(2).position(|pair| pair == b"\n\n");
    let (head, body) = end.map_or((bytes, &[][..]), |end| (&bytes[..end], &bytes[end + 2..]));
    let mut lines = head.split(|&byte| byte == b'\n');
    let first = lines.next()?;
    let space = first.iter().position(|&byte| byte == b' ')?;
    let path = &first[space + 1..];
    let path = path.strip_prefix(b"~").map_or(path.to_vec(), |rest| [RIG.as_bytes(), rest].concat());
    let mut request = Request::builder().method(&first[..space]).uri(path);
    for line in lines {
        let colon = line.iter().position(|&byte| byte == b':')?;
        let name = HeaderName::from_bytes(&line[..colon]).ok()?;
        request = request.header(name, line[colon + 1..].trim_ascii());
    }
    request.body(Body::from(body.to_vec())).ok()
}

/// A request with the token of whoever may ask anything: it is answered, and not by a failure of the daemon; what is JSON is whole, and an
/// answer that says no says why.
pub(crate) fn http(bytes: &[u8]) -> bool {
    thread_local! {
        static ASKED: RefCell<Option<Asked>> = const { RefCell::new(None) };
    }
    let Some(request) = request(bytes) else { return false };
    let (status, is_json, text) = ASKED.with_borrow_mut(|asked| {
        if asked.as_ref().is_none_or(|asked| asked.requests >= REQUESTS_PER_QUEUE) {
            *asked = None;
        }
        let new = || Asked::new().unwrap_or_else(|error| panic!("a daemon to ask: {error}"));
        asked.get_or_insert_with(new).ask(request)
    });
    let shown = String::from_utf8_lossy(&text);
    assert!(!status.is_server_error(), "{status}: {shown}");
    if is_json && !text.is_empty() {
        let value: serde_json::Value =
            serde_json::from_slice(&text).unwrap_or_else(|error| panic!("{error}: {shown}"));
        let says_why = value["error"].as_str().is_some_and(|error| !error.is_empty());
        assert!(says_why || !status.is_client_error(), "{status}: {shown}");
    }
    assert!(is_json || !status.is_client_error(), "{status} and not in JSON");
    status.is_success()
}

/// Nobody looks.
struct Nobody;

impl app::Watcher for Nobody {
    fn status(&mut self, _: String) {}
    fn event(&mut self, _: &str) {}
    fn alert(&mut self, _: &str) {}
    fn clear(&mut self) {}
}

impl ident::fit::Observer for Nobody {
    fn progress(&mut self, _: &ident::fit::Progress<'_>) -> ident::fit::Flow {
        ident::fit::Flow::Continue
    }
}

impl ident::diagnose::Observer for Nobody {
    fn stage(&mut self, _: &str) -> bool {
        true
    }
}

impl analysis::Progress for Nobody {
    fn begin(&mut self, _: &str, _: Option<u64>) {}
    fn step(&mut self, _: u64) {}
}
