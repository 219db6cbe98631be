//! The page through real HTTP, with a mock camera.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::*;
use record::outputs::Outputs;

/// Longer than anything here takes, on a machine that does other things too.
const PATIENCE: Duration = Duration::from_secs(20);

/// A config whose mock camera looks at a tank of the shipped ones.
fn config(folder: &Path) -> PathBuf {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("configs");
    let text = std::fs::read_to_string(shipped.join("chain-passive-hanging.toml")).unwrap();
    let text = text
        .replace("models/", &format!("{}/models/", shipped.display()))
        .replace("tanks/", &format!("{}/tanks/", shipped.display()));
    let path = folder.join("rig.toml");
    std::fs::write(&path, text).unwrap();
    path
}

struct Answer {
    status: u16,
    head: String,
    body: Vec<u8>,
}

fn ask(address: SocketAddr, method: &str, path: &str, head: &str, body: &str) -> Answer {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let length = body.len();
    write!(
        stream,
        "{method} {path} HTTP/1.1\r\n{head}Connection: close\r\nContent-Length: {length}\r\n\r\n{body}"
    )
    .unwrap();
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
    let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    Answer { status, head, body: bytes[end + 4..].to_vec() }
}

fn look(address: SocketAddr, path: &str) -> Answer {
    ask(address, "GET", path, "Host: localhost:1234\r\n", "")
}

fn state(address: SocketAddr) -> Value {
    serde_json::from_slice(&look(address, "/state").body).unwrap()
}

fn until<T>(mut look: impl FnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        match look() {
            Some(seen) => return seen,
            None => assert!(began.elapsed() < PATIENCE, "it never came"),
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// `work` beside a page that is served; then how long its end took.
fn served(work: impl FnOnce(SocketAddr, &Path)) -> Duration {
    let folder = tempfile::tempdir().unwrap();
    let path = config(folder.path());
    let watch = Watch::start(RigConfig::read(&path).unwrap(), folder.path()).unwrap();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let (end, ended) = tokio::sync::oneshot::channel::<()>();
    let server = runtime.block_on(Server::listen(0, watch, Outputs::edited(&path).unwrap())).unwrap();
    let address = server.address();
    assert!(address.ip().is_loopback());
    let serving = runtime.spawn(server.serve(async {
        let _ = ended.await;
    }));
    work(address, &path);
    let asked = Instant::now();
    end.send(()).unwrap();
    runtime.block_on(serving).unwrap().unwrap();
    drop(runtime);
    asked.elapsed()
}

#[test]
fn page_shows_the_mock_camera_writes_places_and_lets_nobody_hold_it_up() {
    let ending = served(|address, config| {
        let picture = until(|| Some(look(address, "/marked.jpg")).filter(|answer| answer.status == 200));
        let seen = image::load_from_memory(&picture.body).unwrap().to_rgb8();
        assert_eq!(seen.dimensions(), (640, 480));
        let green = seen.pixels().filter(|pixel| pixel.0[1] > pixel.0[0].saturating_add(30)).count();
        assert!(green > 1000, "{green} px are tinted: the mechanism stands out");
        let plain = image::load_from_memory(&look(address, "/plain.jpg").body).unwrap();
        assert!(plain.to_rgb8().pixels().all(|pixel| pixel.0[1] <= pixel.0[0].saturating_add(2)));

        let seen = until(|| {
            Some(state(address)).filter(|state| state["measures"]["flicker_s"].as_f64() > Some(0.2))
        });
        assert_eq!(seen["size_px"], json!([640, 480]));
        assert_eq!(seen["config"]["origin_px"], json!([320.0, 60.0]));
        let links = seen["config"]["links_px"].as_array().unwrap();
        let rows = |link: &Value| -> Vec<f64> {
            link.as_array().unwrap().iter().map(|corner| corner[1].as_f64().unwrap()).collect()
        };
        assert_eq!(links.len(), 3);
        // 30 mm from 2.5 mm above the first pivot, in pixels of 0.25 mm.
        let (top, bottom) = (
            rows(&links[0]).into_iter().fold(f64::MAX, f64::min),
            rows(&links[0]).into_iter().fold(0.0, f64::max),
        );
        assert!((top - 50.0).abs() < 0.01 && (bottom - 170.0).abs() < 0.01, "{top} to {bottom}");
        let edge = seen["measures"]["edge_width_px"].as_f64().unwrap();
        assert!((1.9..6.0).contains(&edge), "{edge}");
        assert_eq!(seen["measures"]["saturation"]["light_share"], 0.0);
        assert!(seen["rolling"]["fps"].as_f64().is_some_and(|fps| fps > 1.0), "{seen}");

        // One who asks and reads nothing, one who says nothing, and one who hangs up.
        let mut stalled = TcpStream::connect(address).unwrap();
        for _ in 0..50 {
            let _ = write!(stalled, "GET /plain.jpg HTTP/1.1\r\nHost: localhost\r\n\r\n");
        }
        let silent = TcpStream::connect(address).unwrap();
        let mut gone = TcpStream::connect(address).unwrap();
        let _ = write!(gone, "GET /marked.jpg HTTP/1.1\r\nHost: localhost\r\n\r\n");
        drop(gone);
        let before = state(address)["sequence"].as_u64().unwrap();
        until(|| state(address)["sequence"].as_u64().filter(|now| *now > before));

        let json = "Host: 127.0.0.1\r\nContent-Type: application/json\r\n";
        let body = r#"{"base_px":[321.04,59.0],"origin_px":[320.5,60.0]}"#;
        let answer = ask(address, "POST", "/config", json, body);
        assert_eq!(answer.status, 200, "{}", String::from_utf8_lossy(&answer.body));
        let text = std::fs::read_to_string(config).unwrap();
        assert!(text.starts_with("# Purely passive") && text.contains("base_px = [321.0, 59.0]"), "{text}");
        assert_eq!(state(address)["config"]["origin_px"], json!([320.5, 60.0]));
        let outside = ask(address, "POST", "/config", json, r#"{"base_px":[9000,59]}"#);
        assert_eq!(outside.status, 422);
        assert!(String::from_utf8_lossy(&outside.body).contains("outside the picture"));
        assert_eq!(std::fs::read_to_string(config).unwrap(), text);
        drop((stalled, silent));
    });
    assert!(ending < Duration::from_secs(1), "the end took {ending:?}");
}

#[test]
fn only_this_machine_and_the_page_itself_are_answered() {
    served(|address, config| {
        let before = std::fs::read_to_string(config).unwrap();
        for host in [
            "Host: evil.example\r\n",
            "Host: 127.0.0.1.evil.example:80\r\n",
            "Host: localhost.evil.example\r\n",
            "",
        ] {
            let answer = ask(address, "GET", "/state", host, "");
            assert!([400, 403].contains(&answer.status), "{host}: {}", answer.status);
        }
        let body = r#"{"base_px":[1,1]}"#;
        for head in [
            "Host: localhost\r\nOrigin: http://evil.example\r\nContent-Type: application/json\r\n",
            "Host: localhost\r\nOrigin: null\r\nContent-Type: application/json\r\n",
            "Host: localhost\r\nContent-Type: text/plain\r\n",
        ] {
            let answer = ask(address, "POST", "/config", head, body);
            assert!([403, 415].contains(&answer.status), "{head}: {}", answer.status);
        }
        assert_eq!(std::fs::read_to_string(config).unwrap(), before);
        for (path, kind) in [("/", "text/html"), ("/page.css", "text/css"), ("/page.js", "text/javascript")] {
            let answer = look(address, path);
            assert_eq!(answer.status, 200);
            assert!(
                answer.head.contains(kind) && answer.head.contains("content-security-policy"),
                "{}",
                answer.head
            );
            assert!(
                !String::from_utf8_lossy(&answer.body)
                    .replace("http://www.w3.org/2000/svg", "")
                    .contains("http")
            );
        }
        assert_eq!(look(address, "/elsewhere").status, 404);
    });
}
