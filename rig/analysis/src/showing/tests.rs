//! From the working threads to a connected client.

use std::io::{BufRead, BufReader};
use std::os::unix::net::UnixStream;
use std::time::Instant;

use super::*;
use camera::fixtures;

/// Longer than anything here takes, on a machine that does other things too.
const TEST_TIMEOUT: Duration = Duration::from_secs(20);

fn line(lines: &mut impl BufRead) -> serde_json::Value {
    let mut line = String::new();
    lines.read_line(&mut line).unwrap();
    serde_json::from_str(&line).unwrap_or_else(|error| panic!("{error}: {line}"))
}

#[test]
fn whoever_connects_gets_snapshots_until_the_job_ends() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("live.sock");
    // what a killed one left behind
    drop(std::os::unix::net::UnixListener::bind(&path).unwrap());
    let showing = Showing::open(&path, 7);
    showing.stage("armed", None);
    let stream = UnixStream::connect(&path).unwrap();
    stream.set_read_timeout(Some(TEST_TIMEOUT)).unwrap();
    let mut lines = BufReader::new(stream);
    let first = line(&mut lines);
    assert_eq!((&first["job"], &first["stage"]), (&7.into(), &"armed".into()));
    showing.stage("images", Some(100));
    showing.step(40);
    let until = |lines: &mut BufReader<UnixStream>, stage: &str| {
        let began = Instant::now();
        loop {
            let snapshot = line(lines);
            if snapshot["stage"] == stage {
                return snapshot;
            }
            assert!(began.elapsed() < TEST_TIMEOUT, "{snapshot}");
        }
    };
    assert_eq!(until(&mut lines, "images")["steps"], serde_json::json!([40, 100]));
    showing.stage("report", None);
    showing.end();
    until(&mut lines, "report");
    let mut rest = String::new();
    while lines.read_line(&mut rest).unwrap() > 0 {}
    assert!(!path.exists(), "nobody is misled");
}

#[test]
fn nobody_who_hands_over_waits_for_one_who_never_reads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("live.sock");
    let showing = Showing::open(&path, 7);
    let stalled: Vec<UnixStream> = (0..6).map(|_| UnixStream::connect(&path).unwrap()).collect();
    let image = Arc::new(fixtures::image(1, MonotonicNs(0), (640, 480)));
    let event = ServoEvent::Started { board_tick_us: 1 };
    let (mut longest, began) = (Duration::ZERO, Instant::now());
    // ten times as many as find room
    for _ in 0..10 * MESSAGE_QUEUE_CAPACITY {
        let at = Instant::now();
        showing.image(&image);
        showing.servo(&event);
        longest = longest.max(at.elapsed());
    }
    println!("{} hand-overs in {:?}, the longest {longest:?}", 10 * MESSAGE_QUEUE_CAPACITY, began.elapsed());
    // a look at the sockets takes 200 ms: who waited for one would take ten of them
    assert!(began.elapsed() < Duration::from_secs(2), "{:?}", began.elapsed());
    assert!(Arc::strong_count(&image) <= 3, "images pile up: {}", Arc::strong_count(&image));
    drop(stalled);
}

#[test]
fn job_without_a_socket_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let showing = Showing::open(&folder.path().join("x".repeat(120)).join("live.sock"), 7);
    assert!(showing.0.is_none());
    showing.stage("armed", None);
    showing.end();
}
