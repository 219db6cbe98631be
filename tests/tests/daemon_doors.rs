//! What comes in and goes out by the daemon's doors: files, tokens, and the form in which it refuses.

use std::os::unix::fs::symlink;
use std::time::{Duration, Instant};

use rustix::fs::{CWD, FileType, Mode, mknodat};
use system_tests::daemon::Served;
use system_tests::http::{Answer, ask};
use system_tests::in_real_time;

const RUN: &str = "20261120T101503Z-ab12cd";
const LINKED: &str = "20261120T101503Z-linked";

#[test]
fn links_pipes_and_folders_in_a_run_folder_are_not_handed_out() {
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    let runs = &served.bench.runs;
    let elsewhere = runs.parent().expect("a folder").join("elsewhere");
    let run = runs.join(RUN);
    for folder in [&elsewhere, &run] {
        std::fs::create_dir(folder).expect("a folder");
    }
    for name in ["secret", "fit.json"] {
        std::fs::write(elsewhere.join(name), "a secret").expect("a file");
    }
    std::fs::write(run.join("timing.json"), "{}").expect("a file");
    symlink(elsewhere.join("secret"), run.join("servo.csv")).expect("a link");
    symlink("timing.json", run.join("diagnosis.json")).expect("a link");
    symlink("/proc/self/environ", run.join("model.xml")).expect("a link");
    std::fs::create_dir(run.join("journal.jsonl")).expect("a folder");
    let pipe = |name| mknodat(CWD, run.join(name), FileType::Fifo, Mode::from_raw_mode(0o600), 0);
    pipe("trajectory.csv").and_then(|()| pipe("start.json")).expect("pipes");
    symlink(&elsewhere, runs.join(LINKED)).expect("a link");

    let get = |path: &str| {
        let asked = Instant::now();
        let answer = served.get(&format!("/api/v1/rigs/rig/runs{path}"));
        assert!(asked.elapsed() < Duration::from_secs(3), "{path}: {:?}", asked.elapsed());
        assert!(
            !answer.body.contains("a secret") && !answer.body.contains("PATH="),
            "{path}: {}",
            answer.body
        );
        answer
    };
    assert_eq!(
        (get(&format!("/{RUN}/timing.json")).status, get(&format!("/{RUN}/fit.json")).status),
        (200, 404)
    );
    for (file, why) in [
        ("servo.csv", "a link"),
        ("diagnosis.json", "a link"),
        ("model.xml", "a link"),
        ("journal.jsonl", "no regular file"),
        ("trajectory.csv", "no regular file"),
    ] {
        let answer = get(&format!("/{RUN}/{file}"));
        assert!(
            answer.status == 403 && answer.body.contains(why),
            "{file}: {} {}",
            answer.status,
            answer.body
        );
    }
    assert_eq!(get(&format!("/{LINKED}/fit.json")).status, 403);
    let listed = get("").json();
    for (run, why) in [(RUN, "no regular file"), (LINKED, "is a link")] {
        let line = listed.as_array().and_then(|runs| runs.iter().find(|one| one["id"] == run));
        let line = line.unwrap_or_else(|| panic!("no {run} in {listed}"));
        assert_eq!(line["status"], "unreadable", "{line}");
        assert!(line["reason"].as_str().is_some_and(|reason| reason.contains(why)), "{line}");
        assert_eq!(&get(&format!("/{run}")).json(), line);
    }
}

#[test]
fn token_is_told_to_no_journal_and_one_that_others_can_read_is_void() {
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    let log =
        || std::fs::read_to_string(served.bench.runs.with_file_name("daemon.log")).expect("what it said");
    let said = log();
    assert!(
        said.contains(&format!("serving at http://{}/", served.address)) && said.contains(".token"),
        "{said}"
    );
    assert!(!said.contains(&served.token) && !said.contains("#token="), "{said}");
    let Served { bench, token, .. } = served.ended();
    let path = bench.runs.join(".token");
    std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o644)).expect("ours");
    let again = Served::on(bench, "127.0.0.1:0");
    assert_ne!(again.token, token);
    let said = std::fs::read_to_string(again.bench.runs.with_file_name("daemon.log")).expect("what it said");
    assert!(said.contains("open to others (mode 644): a new one is there now"), "{said}");
}

/// What an answer says, whose form is that of every refusal.
fn refusal(answer: &Answer) -> String {
    assert!(answer.head.contains("content-type: application/json"), "{}\n{}", answer.head, answer.body);
    let body = answer.json();
    assert_eq!(body.as_object().map(serde_json::Map::len), Some(1), "{body}");
    body["error"].as_str().filter(|error| !error.is_empty()).unwrap_or_else(|| panic!("{body}")).to_owned()
}

#[test]
fn every_refusal_has_one_form_and_says_what_is_wrong() {
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    let with_token = format!("Host: localhost\r\nAuthorization: Bearer {}\r\n", served.token);
    let (with_token, free) = (with_token.as_str(), "Host: localhost\r\n");
    let long = format!("{{\"why\":\"{}\"}}", "x".repeat(1 << 17));
    let why = format!("{{\"work\":{{\"kind\":\"run\"}},\"why\":\"{}\"}}", "x".repeat(20_000));
    let rig = "/api/v1/rigs/rig";
    for (status, method, path, head, body, says) in [
        (404, "GET", "/nowhere", free, "", "/nowhere"),
        (404, "GET", "/api/v1/rigs/none/jobs", free, "", "no rig is called `none`"),
        (404, "GET", "/api/v1/rigs/rig/jobs/99", free, "", "there is no job 99"),
        (405, "DELETE", "/api/v1/rigs/rig/jobs", with_token, "", "is not for DELETE"),
        (400, "GET", "/api/v1/rigs/rig/jobs?most=x", free, "", "most"),
        (400, "GET", "/api/v1/rigs/rig/jobs?odd=1", free, "", "odd"),
        (400, "GET", "/api/v1/rigs/rig/jobs/first", free, "", "first"),
        (400, "GET", "/api/v1/rigs/rig/trend", free, "", "name"),
        (401, "POST", "/api/v1/rigs/rig/jobs", free, "{}", "the token is wanted"),
        (403, "GET", "/api/v1/rigs", "Host: evil.example\r\n", "", "name it with"),
        (400, "POST", "/api/v1/rigs/rig/jobs", with_token, "{", "JSON"),
        (422, "POST", "/api/v1/rigs/rig/jobs", with_token, r#"{"work":{"kind":"fly"}}"#, "fly"),
        (422, "POST", "/api/v1/rigs/rig/jobs", with_token, "", "work"),
        (413, "POST", "/api/v1/rigs/rig/jobs", with_token, long.as_str(), "limit"),
        (
            422,
            "POST",
            "/api/v1/rigs/rig/jobs",
            with_token,
            why.as_str(),
            "20000 characters, 200 are the most",
        ),
        (
            422,
            "POST",
            "/api/v1/rigs/rig/jobs",
            with_token,
            r#"{"work":{"kind":"campaign","max_runs":1000000}}"#,
            "`max_runs` = 1000000 is not between 1 and 1000",
        ),
    ] {
        let answer = ask(served.address, method, path, head, body);
        assert_eq!(answer.status, status, "{method} {path} {}: {}", &body[..body.len().min(99)], answer.body);
        let said = refusal(&answer);
        assert!(said.contains(says), "{method} {path}: {said}");
    }
    assert_eq!(served.bench.jobs(&["ls"]), "no jobs yet\n", "nothing was queued");

    // what is JSON counts, whatever it calls itself; and nothing at all where all may be left out
    let body = r#"{"work":{"kind":"run"},"not_before":"2099-01-01T00:00:00Z"}"#;
    for kind in ["", "Content-Type: text/plain\r\n", "Content-Type: application/x-www-form-urlencoded\r\n"] {
        let answer =
            ask(served.address, "POST", &format!("{rig}/jobs"), &format!("{with_token}{kind}"), body);
        assert_eq!(answer.status, 201, "{kind}: {}", answer.body);
        let cancel = format!("{rig}/jobs/{}/cancel", answer.json()["job"]);
        let answer =
            ask(served.address, "POST", &cancel, &format!("{with_token}{kind}Content-Length: 0\r\n"), "");
        assert_eq!(answer.status, 200, "{kind}: {}", answer.body);
    }
}
