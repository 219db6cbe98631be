//! The daemon over HTTP: what its page and programs may do, and what nobody else may.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use system_tests::book::commands::blocks;
use system_tests::daemon::{Bench, Served};
use system_tests::http::{Events, ask};
use system_tests::{in_real_time, json, printed, repository};

#[test]
fn a_run_is_queued_watched_and_its_fit_read() {
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    let mut events = Events::listen(served.address, "/api/v1/events");
    assert_eq!(events.wait()["jobs"], serde_json::json!([]));
    let added = served.post("/api/v1/rigs/rig/jobs", r#"{"work":{"kind":"run"},"why":"a test"}"#);
    assert_eq!((added.status, &added.json()["job"]), (201, &1.into()), "{}", added.body);
    let mut states = Vec::new();
    let run = loop {
        let event = events.wait();
        let jobs = event["jobs"].as_array().expect("jobs");
        let Some(job) = jobs.iter().find(|job| job["id"] == 1) else { continue };
        states.push(job["state"].as_str().expect("a state").to_owned());
        if job["state"] == "done" {
            break job["run"].as_str().expect("its run").rsplit('/').next().expect("its id").to_owned();
        }
    };
    states.dedup();
    assert!(["queued,running,done", "running,done"].contains(&states.join(",").as_str()), "{states:?}");

    let runs = served.get("/api/v1/rigs/rig/runs").json();
    assert_eq!((&runs[0]["id"], &runs[0]["status"]), (&run.as_str().into(), &"success".into()), "{runs}");
    let fit = served.get(&format!("/api/v1/rigs/rig/runs/{run}/fit.json")).json();
    let name = fit["parameters"][0]["name"].as_str().expect("a name").to_owned();
    assert_eq!(served.get("/api/v1/rigs/rig/coefficients").json(), serde_json::json!([name]));
    let trend = served.get(&format!("/api/v1/rigs/rig/trend?name={}", name.replace('/', "%2F"))).json();
    assert_eq!(
        (&trend[0]["run"], &trend[0]["value"]),
        (&run.as_str().into(), &fit["parameters"][0]["value"])
    );
    let report = served.get(&format!("/api/v1/rigs/rig/runs/{run}/report.html"));
    assert!(report.status == 200 && report.head.contains("sandbox"), "{}", report.head);

    let metrics = served.get("/metrics").body;
    assert!(metrics.contains("rig_runs{rig=\"rig\",status=\"success\"} 1"), "{metrics}");
    let document = served.get("/api/v1/openapi.json").json();
    for path in document["paths"].as_object().expect("paths").keys() {
        let filled = path
            .replace("{rig}", "rig")
            .replace("{run}", &run)
            .replace("{job}", "1")
            .replace("{file}", "fit.json");
        let filled = if filled.ends_with("trend") { format!("{filled}?name={name}") } else { filled };
        let ends = !path.ends_with("events") && !path.ends_with("live");
        let reads = document["paths"][path].get("get").is_some() && ends;
        if reads {
            assert_eq!(served.get(&filled).status, 200, "{filled}");
        }
    }
}

#[test]
fn python_of_the_page_queues_a_run_and_reads_its_fit() {
    let _turn = in_real_time();
    let page = repository().join("docs/daemon.md");
    let block = blocks(&page).expect("the page").into_iter().find(|block| block.language == "python");
    let served = Served::start("127.0.0.1:0");
    let script = block
        .expect("a script")
        .text
        .replace("127.0.0.1:8071", &served.address.to_string())
        .replace("rigs/chain-driven-hanging", "rigs/rig");
    let folder = served.bench.runs.parent().expect("its folder");
    let python = std::process::Command::new("python3").args(["-c", &script]).current_dir(folder).output();
    let output = match python {
        Ok(output) => output,
        Err(error) => return eprintln!("skipped: no python3 ({error})"),
    };
    assert!(output.status.success(), "{}", printed(&output));
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("q2/damping "), "{}", printed(&output));
}

#[test]
fn pages_from_elsewhere_guesses_and_ways_out_of_the_folder_lead_nowhere() {
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    let secret = served.bench.runs.parent().expect("a folder").join("secret.json");
    std::fs::write(&secret, "secret").expect("a file");
    for head in [
        "Host: evil.example\r\n",
        "Host: localhost\r\nOrigin: http://evil.example\r\n",
        "Host: localhost\r\nSec-Fetch-Site: cross-site\r\n",
    ] {
        let answer = ask(served.address, "GET", "/api/v1/rigs", head, "");
        assert_eq!(answer.status, 403, "{head}: {}", answer.body);
        assert!(answer.head.contains("content-security-policy: default-src 'none'"), "{}", answer.head);
    }
    assert_eq!(
        ask(served.address, "GET", "/api/v1/rigs", "Host: rig.lab\r\n", "").status,
        200,
        "a named host"
    );
    let run = r#"{"work":{"kind":"run"}}"#;
    let guesses = [String::new(), "Bearer ".into(), "Bearer x".into(), format!("bearer{}", served.token)];
    let wrong = format!("Bearer {}", "A".repeat(served.token.len()));
    for guess in guesses.iter().chain([&wrong]) {
        let head = format!("Host: localhost\r\nContent-Type: application/json\r\nAuthorization: {guess}\r\n");
        for path in ["/api/v1/rigs/rig/jobs", "/api/v1/rigs/rig/stop", "/api/v1/rigs/rig/jobs/1/cancel"] {
            assert_eq!(ask(served.address, "POST", path, &head, run).status, 401, "{guess} {path}");
        }
    }
    for body in [
        r#"{"work":{"kind":"run","config":"/etc/passwd"}}"#,
        r#"{"work":{"kind":"replay","run":"../../secret"}}"#,
        r#"{"work":{"kind":"fly"}}"#,
        "{",
    ] {
        let status = served.post("/api/v1/rigs/rig/jobs", body).status;
        assert!([400, 422].contains(&status), "{body}: {status}");
    }
    assert_eq!(
        served.post("/api/v1/rigs/rig/jobs", &format!("{{\"why\":\"{}\"}}", "x".repeat(1 << 20))).status,
        413
    );
    for path in [
        "/api/v1/rigs/rig/runs/..%2F..%2Fsecret.json",
        "/api/v1/rigs/rig/runs/../secret.json",
        "/api/v1/rigs/rig/runs/20261120T101503Z-ab12cd/..%2F..%2F..%2Fsecret.json",
        "/api/v1/rigs/rig/runs/20261120T101503Z-ab12cd/recording.mcap",
        "/api/v1/rigs/..%2F/jobs",
        "/api/v1/rigs/rig/jobs/99",
        "/.token",
    ] {
        let answer = served.get(path);
        assert_eq!(answer.status, 404, "{path}");
        assert!(!answer.body.contains("secret\n") && !answer.body.contains(&served.token), "{}", answer.body);
    }
    assert_eq!(served.bench.jobs(&["ls"]), "no jobs yet\n", "nothing was queued");
}

#[test]
fn off_the_loopback_reading_wants_the_token_too() {
    let _turn = in_real_time();
    let served = Served::start("0.0.0.0:0");
    assert_eq!(served.get("/api/v1/rigs").status, 401);
    let head = format!("Host: localhost\r\nAuthorization: Bearer {}\r\n", served.token);
    assert_eq!(ask(served.address, "GET", "/api/v1/rigs", &head, "").status, 200);
}

#[test]
fn clients_that_stall_hold_up_neither_the_others_nor_a_run() {
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    // one that never ends its request, and fifty that listen and never read
    let mut drip = TcpStream::connect(served.address).expect("a connection");
    let head = format!(
        "POST /api/v1/rigs/rig/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n\
         Authorization: Bearer {}\r\nContent-Length: 1000\r\n\r\n{{",
        served.token
    );
    drip.write_all(head.as_bytes()).expect("half a request");
    let listeners: Vec<Events> = (0..50).map(|_| Events::listen(served.address, "/api/v1/events")).collect();
    served.post("/api/v1/rigs/rig/jobs", r#"{"work":{"kind":"run","film_only":true}}"#);
    let began = Instant::now();
    while !served.bench.job(1).contains("done") {
        let asked = Instant::now();
        assert_eq!(served.get("/api/v1/rigs").status, 200);
        assert!(asked.elapsed() < Duration::from_secs(2), "{:?}", asked.elapsed());
        assert!(began.elapsed() < Duration::from_secs(60), "{}", served.bench.jobs(&["ls"]));
        std::thread::sleep(Duration::from_millis(200));
    }
    let run = system_tests::only_run(&served.bench.runs).expect("a run");
    let stop = json(&run.join("stop.json"));
    assert_eq!((&stop["images_lost"], &stop["messages_dropped"]), (&0.into(), &0.into()), "{stop}");
    drip.set_read_timeout(Some(Duration::from_secs(20))).expect("a timeout");
    let mut answer = String::new();
    let _ = drip.read_to_string(&mut answer);
    assert!(answer.starts_with("HTTP/1.1 408"), "{answer}");
    drop(listeners);
}

const LIVE: &str = "/api/v1/rigs/rig/live";

/// Pictures until the run has been filmed, and the last snapshot.
fn watched(mut events: Events, job: u32) -> (u32, serde_json::Value) {
    let (mut pictures, mut last) = (0, serde_json::Value::Null);
    while last["stage"] != "filming" || last["job"] != job {
        let Some(next) = events.next_in_time() else { break };
        last = next;
        pictures += u32::from(last["job"] == job && last.get("picture").is_some());
    }
    (pictures, last)
}

/// A run that fifty watch from beginning to end; what it lost, or how late it was, where it did not go as if nobody did.
fn run_before_fifty(served: &Served, job: u32) -> Result<(), String> {
    let watch = |_| {
        let events = Events::listen(served.address, LIVE);
        std::thread::spawn(move || watched(events, job))
    };
    let watchers: Vec<_> = (0..50).map(watch).collect();
    served.post("/api/v1/rigs/rig/jobs", r#"{"work":{"kind":"run","film_only":true}}"#);
    served.bench.wait(job, &["done", "failed"], 60.0);
    let ended = served.get(&format!("/api/v1/rigs/rig/jobs/{job}")).json();
    if ended["state"] != "done" {
        return Err(ended.to_string());
    }
    let stop = json(&std::path::Path::new(ended["run"].as_str().expect("its run")).join("stop.json"));
    assert_eq!(stop["servo"], "acknowledged", "{stop}");
    for watcher in watchers {
        let (pictures, last) = watcher.join().expect("it watches to the end");
        let figures = &last["figures"];
        assert!(pictures > 3 && figures["received"].as_u64() > Some(50), "{pictures} pictures, {figures}");
        let late_s = figures["start_late_s"].as_f64().expect("a motion");
        if late_s.abs() > 0.02 {
            return Err(format!("the motion began {late_s} s late"));
        }
    }
    let lost = stop["images_lost"] != 0 || stop["messages_dropped"] != 0;
    if lost { Err(stop.to_string()) } else { Ok(()) }
}

#[test]
fn fifty_who_watch_live_and_one_who_stalls_cost_a_run_neither_an_image_nor_its_punctuality() {
    let _turn = in_real_time();
    let served = Served::on(Bench::slow(), "127.0.0.1:0");
    assert_eq!(served.get("/api/v1/rigs/other/live").status, 404);
    let stalled = Events::listen(served.address, LIVE);
    // a busy machine costs a run images, watched or not; one that is held up by who watches loses them each time
    let held_up: Vec<String> = (1..=3).map_while(|job| run_before_fifty(&served, job).err()).collect();
    println!("held up: {held_up:#?}");
    assert!(held_up.len() < 3, "{held_up:#?}");
    drop(stalled);
}
