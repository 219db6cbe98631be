//! How long a stop takes from the click to the board, with the queue's database held by somebody, the disk full and a thousand
//! connections that never end their request: `cargo run -p system-tests --example stops -- 200`. Board and camera are processes of their
//! own; a stop counts from before its request is sent to when the board takes the pulse away, by the board's own log. As root the runs
//! are on a disk of their own, which is filled just before each stop.

#![expect(clippy::print_stdout, reason = "it prints what it measures")]

use std::io::Write as _;
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Command, ExitCode};

use rusqlite::Connection;
use system_tests::http::ask;
use system_tests::outside::Outside;
use system_tests::{Background, rig, wait_until};

const CONFIG: &str = "chain-driven-hanging.toml";
const RIG: &str = "/api/v1/rigs/rig";
/// The bar \[ms\].
const MOST_MS: f64 = 100.0;
const IDLE: usize = 1000;

fn monotonic_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs()
}

/// A disk of its own at `folder`, where one may be had.
fn own_disk(folder: &Path) -> bool {
    std::fs::create_dir_all(folder).expect("a folder");
    let mount = Command::new("mount").args(["-t", "tmpfs", "-o", "size=600m", "tmpfs"]).arg(folder).status();
    mount.is_ok_and(|status| status.success())
}

/// Fills the disk of `folder` to its last byte.
fn fill(folder: &Path) {
    let mut file = std::fs::File::create(folder.join("full")).expect("a file");
    while file.write_all(&[0; 1 << 20]).is_ok() {}
    while file.write_all(&[0; 4096]).is_ok() {}
}

fn main() -> ExitCode {
    let count: usize = std::env::args().nth(1).and_then(|count| count.parse().ok()).unwrap_or(200);
    let folder = tempfile::tempdir().expect("a folder");
    let outside = Outside::new(CONFIG, folder.path());
    let is_own = own_disk(&outside.runs);
    let mut daemon =
        rig(["daemon".as_ref(), outside.config.as_os_str(), "--runs-dir".as_ref(), outside.runs.as_os_str()]);
    daemon.args(["--listen", "127.0.0.1:0"]);
    let _daemon = Background::start(daemon);
    let journal = || std::fs::read_to_string(outside.runs.join("daemon.jsonl")).unwrap_or_default();
    wait_until("the daemon", 20.0, || journal().contains("\"serving\""));
    let line = journal().lines().find(|line| line.contains("\"serving\"")).expect("a line").to_owned();
    let line: serde_json::Value = serde_json::from_str(&line).expect("a line of the journal");
    let address: SocketAddr = line["address"].as_str().expect("its address").parse().expect("an address");
    let token = std::fs::read_to_string(outside.runs.join(".token")).expect("a token");
    let post = |path: &str, body: &str| {
        let head = format!("Host: localhost\r\nAuthorization: Bearer {token}\r\n");
        ask(address, "POST", &format!("{RIG}{path}"), &head, body)
    };
    let doing = || {
        let state = ask(address, "GET", "/api/v1/rigs", "Host: localhost\r\n", "").json();
        state[0]["doing"].as_str().unwrap_or_default().to_owned()
    };
    let log = folder.path().join("tank/servo.log");
    let mut took_ms = Vec::new();
    for stop in 0..count {
        let added = post("/jobs", r#"{"work":{"kind":"run","film_only":true}}"#);
        assert_eq!(added.status, 201, "{}", added.body);
        wait_until("a motion", 60.0, || doing() == "moving");
        let writer = Connection::open(outside.runs.join("rig.sqlite")).expect("the queue");
        writer.execute_batch("BEGIN IMMEDIATE").expect("a lock");
        let connect = |_| {
            let mut idle = TcpStream::connect(address).ok()?;
            idle.write_all(b"POST /api/v1/rigs/rig/stop HTTP/1.1\r\nHost").ok()?;
            Some(idle)
        };
        let idle: Vec<TcpStream> = (0..IDLE).filter_map(connect).collect();
        if is_own {
            fill(&outside.runs);
        }
        let clicked_ns = monotonic_ns();
        let stopped = post("/stop", "{}");
        wait_until("the end of the pulses", 5.0, || outside.last_pulse().is_none());
        let lines = std::fs::read_to_string(&log).expect("the board's pulses");
        let ends = |line: &&str| line.split(',').nth(1) == Some("0") && line.ends_with('-');
        let end = lines.lines().rfind(ends).expect("an end").split(',').next().expect("a stamp").to_owned();
        let ms = (end.parse::<u64>().expect("a stamp") as f64 - clicked_ns as f64) * 1e-6;
        println!("{stop}: {ms:.1} ms, {} idle, {}", idle.len(), stopped.status);
        took_ms.push(ms);
        drop(idle);
        let _ = std::fs::remove_file(outside.runs.join("full"));
        writer.execute_batch("COMMIT").expect("the lock's end");
        wait_until("rest", 20.0, || doing() == "at-rest");
        wait_until("a release", 20.0, || post("/release", r#"{"by":"the example"}"#).status == 200);
        // runs of a stop each are small, but many
        let runs = std::fs::read_dir(&outside.runs).expect("runs").flatten().map(|entry| entry.path());
        runs.filter(|path| path.join("stop.json").exists())
            .for_each(|path| drop(std::fs::remove_dir_all(path)));
    }
    took_ms.sort_by(f64::total_cmp);
    let within = took_ms.iter().filter(|ms| **ms <= MOST_MS).count();
    println!(
        "{within} of {count} within {MOST_MS} ms{}; median {:.1} ms, longest {:.1} ms",
        if is_own { ", disk full" } else { "" },
        took_ms[took_ms.len() / 2],
        took_ms[took_ms.len() - 1]
    );
    if is_own {
        let _ = Command::new("umount").arg("-l").arg(&outside.runs).status();
    }
    if within == count { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
