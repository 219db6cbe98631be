//! Stop means stop: whoever stops a rig, by whatever way, nothing moves before somebody releases it.

use std::io::Write as _;
use std::net::TcpStream;
use std::time::Duration;

use rusqlite::Connection;
use rustix::process::Signal;
use serde_json::json as object;
use system_tests::daemon::{Bench, Served};
use system_tests::http::{Events, ask};
use system_tests::outside::Outside;
use system_tests::{Background, in_real_time, json, only_run, printed, rig, run_rig, set, wait_until};

const CONFIG: &str = "chain-driven-hanging.toml";
const RIG: &str = "/api/v1/rigs/rig";
/// Long enough for anything to begin that would.
const A_WHILE: Duration = Duration::from_secs(4);

/// Seconds from the run's start to now.
fn now_s(run: &std::path::Path) -> f64 {
    let origin = json(&run.join("start.json"))["clock"]["monotonic_ns"].as_u64().expect("a stamp");
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9 - origin as f64 * 1e-9
}

/// When the board had answered the stop, from the run's start \[s\].
fn stopped_s(run: &std::path::Path) -> f64 {
    let read = || std::fs::read_to_string(run.join("journal.jsonl")).unwrap_or_default();
    wait_until("the stop's line", 5.0, || read().contains("\"servo-stopped\""));
    let journal = read();
    let line = journal.lines().find(|line| line.contains("\"servo-stopped\"")).expect("a line");
    serde_json::from_str::<serde_json::Value>(line).expect("a line")["at_s"].as_f64().expect("a time")
}

/// Waits until the servo of the only run plays its profile.
fn in_motion(served: &Served) -> std::path::PathBuf {
    let run = served.bench.wait_for_motion();
    wait_until("a motion that is measured", 20.0, || state(served)["doing"] == "moving");
    run
}

fn state(served: &Served) -> serde_json::Value {
    served.get("/api/v1/rigs").json()[0].clone()
}

fn released(served: &Served) {
    let answer = served.post(&format!("{RIG}/release"), r#"{"by":"Ada"}"#);
    assert_eq!(answer.status, 200, "{}", answer.body);
}

#[test]
fn stop_over_http_holds_the_queue_across_a_restart_until_a_person_releases_it_by_name() {
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    for _ in 0..3 {
        served.post(&format!("{RIG}/jobs"), r#"{"work":{"kind":"run","film_only":true}}"#);
    }
    let run = in_motion(&served);
    let clicked = now_s(&run);
    let stopped = served.post(&format!("{RIG}/stop"), r#"{"by":"Ada","why":"a hand in the tank"}"#).json();
    assert_eq!(
        (&stopped["written"], &stopped["servos"]["motion"]),
        (&true.into(), &"moving".into()),
        "{stopped}"
    );
    let took = stopped_s(&run) - clicked;
    println!("from the click to the board's answer: {:.1} ms", took * 1e3);
    assert!(took < 0.1, "{took} s");
    served.bench.wait(1, &["cancelled"], 5.0);
    std::thread::sleep(A_WHILE);
    let held = state(&served);
    assert_eq!((&held["hold"]["by"], &held["hold"]["why"]), (&"Ada".into(), &"a hand in the tank".into()));
    assert_eq!((&held["doing"], &held["motion"]), (&"at-rest".into(), &serde_json::Value::Null), "{held}");
    assert_eq!(only_run(&served.bench.runs), Some(run.clone()), "no other run began");
    let metrics = served.get("/metrics").body;
    assert!(metrics.contains("rig_held{rig=\"rig\"} 1") && metrics.contains("rig_moving{rig=\"rig\"} 0"));

    // `rig run` is not let either, with the daemon or after it
    let bench = served.into_bench();
    let args = ["run".as_ref(), bench.config.as_os_str(), "--runs-dir".as_ref(), bench.runs.as_os_str()];
    let output = run_rig(args);
    assert_eq!(output.status.code(), Some(3), "{}", printed(&output));
    assert!(printed(&output).contains("a hand in the tank") && printed(&output).contains("rig release"));

    let served = Served::on(bench, "127.0.0.1:0");
    std::thread::sleep(A_WHILE);
    assert!(served.bench.job(2).contains("queued"), "{}", served.bench.job(2));
    for nobody in [r#"{"by":"  "}"#, "{}"] {
        assert_eq!(served.post(&format!("{RIG}/release"), nobody).status, 422);
    }
    released(&served);
    served.bench.wait(2, &["done"], 60.0);
    served.bench.wait(3, &["done"], 60.0);
    let journal = served.bench.journal();
    assert!(journal.contains("\"held\"") && journal.contains("\"by\":\"Ada\""), "{journal}");
}

#[test]
fn estop_beside_a_daemon_holds_its_queue_and_the_board_until_a_release() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let outside = Outside::new(CONFIG, folder.path());
    let daemon = |more: &[&str]| {
        let mut daemon = rig([
            "daemon".as_ref(),
            outside.config.as_os_str(),
            "--runs-dir".as_ref(),
            outside.runs.as_os_str(),
        ]);
        daemon.args(more);
        Background::start(daemon)
    };
    let jobs = |args: &[&str]| {
        let all = [&["jobs", "--runs-dir", outside.runs.to_str().expect("readable")], args].concat();
        printed(&run_rig(all))
    };
    let _daemon = daemon(&[]);
    wait_until("the queue", 10.0, || outside.runs.join("rig.sqlite").exists());
    for _ in 0..3 {
        jobs(&["add", "run", outside.config.to_str().expect("readable"), "--film-only"]);
    }
    outside.wait_for_motion();
    // somebody was about to change the config
    let being_edited = folder.path().join("being-edited.toml");
    let config = std::fs::read_to_string(&outside.config).expect("the config");
    std::fs::write(&being_edited, format!("[camera]\nfps =\n{config}")).expect("written");
    let output = run_rig(["estop".as_ref(), being_edited.as_os_str()]);
    for says in ["rig release", "the config is wrong elsewhere"] {
        assert!(output.status.success() && printed(&output).contains(says), "{}", printed(&output));
    }
    assert_eq!(outside.last_pulse(), None);
    let pulses = outside.pulses();
    std::thread::sleep(A_WHILE);
    assert_eq!(outside.pulses(), pulses, "no pulse comes after the stop");
    assert!(jobs(&["ls"]).contains("queued"), "{}", jobs(&["ls"]));
    let status = |verb: &str| {
        printed(&run_rig([
            verb.as_ref(),
            outside.config.as_os_str(),
            "--runs-dir".as_ref(),
            outside.runs.as_os_str(),
        ]))
    };
    assert!(status("status").contains("emergency stop"), "{}", status("status"));
    let release = |by: &str| {
        let args = ["release", "--by", by].map(std::ffi::OsStr::new);
        run_rig(
            [&args[..], &[outside.config.as_os_str(), "--runs-dir".as_ref(), outside.runs.as_os_str()]]
                .concat(),
        )
    };
    let output = release("Ada");
    assert!(output.status.success() && printed(&output).contains("released by Ada"), "{}", printed(&output));
    wait_until("the other two", 90.0, || jobs(&["ls"]).matches("  done  ").count() == 2);
}

#[test]
fn stop_is_never_refused_for_its_form() {
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    let token = format!("Host: localhost\r\nAuthorization: Bearer {}\r\n", served.token);
    for (head, body) in [
        ("", ""),
        ("", "{}"),
        ("Content-Type: text/plain\r\n", "water on the floor"),
        ("Content-Type: application/json\r\n", "{\"why\""),
        ("Content-Type: application/json\r\n", r#"{"why":"wet","colour":"red","by":7}"#),
        ("Content-Type: application/x-www-form-urlencoded\r\n", "why=wet"),
    ] {
        let answer = ask(served.address, "POST", &format!("{RIG}/stop"), &format!("{token}{head}"), body);
        assert_eq!(answer.status, 200, "{head}{body}: {}", answer.body);
        assert!(answer.json()["hold"]["why"].is_string(), "{}", answer.body);
        released(&served);
    }
    let answer = ask(served.address, "POST", &format!("{RIG}/stop"), "Host: localhost\r\n", "");
    assert_eq!(answer.status, 401, "but for who has no token");
}

#[test]
fn stop_waits_neither_for_the_database_nor_for_a_thousand_connections() {
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    for tried in 0..3 {
        served.post(&format!("{RIG}/jobs"), r#"{"work":{"kind":"run","film_only":true}}"#);
        wait_until("a motion", 30.0, || state(&served)["doing"] == "moving");
        let run = newest(&served);
        let writer = Connection::open(served.bench.runs.join("rig.sqlite")).expect("the queue");
        writer.execute_batch("BEGIN IMMEDIATE").expect("a lock");
        let idle: Vec<TcpStream> = (0..1000)
            .filter_map(|_| {
                let mut idle = TcpStream::connect(served.address).ok()?;
                idle.write_all(b"POST /api/v1/rigs/rig/st").ok()?;
                Some(idle)
            })
            .collect();
        let clicked = now_s(&run);
        let answer = served.post(&format!("{RIG}/stop"), "{}");
        assert_eq!((answer.status, &answer.json()["written"]), (200, &true.into()), "{}", answer.body);
        let took = stopped_s(&run) - clicked;
        println!("{tried}: from the click to the board's answer: {:.1} ms, {} idle", took * 1e3, idle.len());
        assert!(took < 0.1, "{took} s");
        // the daemon outlives it, and says what is the matter
        std::thread::sleep(Duration::from_secs(1));
        let held = state(&served);
        assert!(held["trouble"].as_str().is_some_and(|trouble| trouble.contains("rig.sqlite")), "{held}");
        drop(idle);
        writer.execute_batch("COMMIT").expect("the lock's end");
        wait_until("the end of the trouble", 10.0, || state(&served)["trouble"].is_null());
        released(&served);
    }
}

fn newest(served: &Served) -> std::path::PathBuf {
    let runs =
        std::fs::read_dir(&served.bench.runs).expect("runs").map(|entry| entry.expect("an entry").path());
    runs.filter(|path| path.join("start.json").exists() && !path.join("stop.json").exists())
        .max()
        .expect("a run")
}

#[test]
fn motions_that_hardware_ends_one_after_the_other_hold_the_rig() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    bench.change(|config| {
        let mock = config["mock"].as_table_mut().expect("a table");
        mock.insert(
            "faults".into(),
            toml::toml! { faults = [{ at_s = 0.3, kind = "camera-off" }] }["faults"].clone(),
        );
    });
    (0..5).for_each(|_| bench.add_run());
    let served = Served::on(bench, "127.0.0.1:0");
    wait_until("a hold", 60.0, || !state(&served)["hold"].is_null());
    assert!(state(&served)["hold"]["why"].as_str().expect("why").contains("3 motions in a row"));
    std::thread::sleep(A_WHILE);
    let jobs = served.bench.jobs(&["ls"]);
    assert_eq!((jobs.matches("failed").count(), jobs.matches("queued").count()), (3, 2), "{jobs}");
    let alerts = served.get(&format!("{RIG}/alerts")).json();
    assert!(alerts.as_array().expect("alerts").iter().any(|alert| alert["kind"] == "held"), "{alerts}");
    let cancelled = served.post(&format!("{RIG}/jobs/cancel"), "{}").json();
    assert_eq!(cancelled, object!({ "cancelled": 2 }));
}

#[test]
fn request_that_is_sent_again_moves_the_rig_once_and_what_is_done_is_not_retried() {
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    let head =
        format!("Host: localhost\r\nAuthorization: Bearer {}\r\nIdempotency-Key: 4711\r\n", served.token);
    let body = r#"{"work":{"kind":"run","film_only":true}}"#;
    for _ in 0..3 {
        let answer = ask(served.address, "POST", &format!("{RIG}/jobs"), &head, body);
        assert_eq!((answer.status, &answer.json()["job"]), (201, &1.into()), "{}", answer.body);
    }
    let other = ask(served.address, "POST", &format!("{RIG}/jobs"), &head, r#"{"work":{"kind":"run"}}"#);
    assert_eq!(other.status, 409, "{}", other.body);
    served.bench.wait(1, &["done"], 60.0);
    assert_eq!(served.post(&format!("{RIG}/jobs/1/retry"), "{}").status, 409);
}

#[test]
fn motion_is_announced_by_a_countdown_in_which_it_can_be_stopped() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    bench.change(|config| {
        let motion = config.entry("motion").or_insert_with(|| toml::Table::new().into());
        motion.as_table_mut().expect("a table").insert("announce_s".into(), 3.0.into());
    });
    let served = Served::on(bench, "127.0.0.1:0");
    served.post(&format!("{RIG}/jobs"), r#"{"work":{"kind":"run","film_only":true}}"#);
    wait_until("the countdown", 10.0, || state(&served)["doing"] == "announced");
    let left_s = state(&served)["servos"]["moves_in_s"].as_f64().expect("a countdown");
    assert!((0.5..=3.0).contains(&left_s), "{left_s}");
    served.post(&format!("{RIG}/stop"), "");
    wait_until("its end", 5.0, || state(&served)["doing"] == "at-rest");
    std::thread::sleep(A_WHILE);
    assert_eq!(only_run(&served.bench.runs), None, "nothing was begun");
    let job = served.bench.job(1);
    assert!(job.contains("queued") || job.contains("cancelled"), "{job}");
    released(&served);
    if job.contains("queued") {
        served.bench.wait(1, &["done"], 60.0);
    }
}

#[test]
fn what_is_told_of_a_rig_is_of_now_and_a_daemon_that_hangs_tells_nothing() {
    let _turn = in_real_time();
    let served = Served::start("127.0.0.1:0");
    let mut events = Events::listen(served.address, "/api/v1/events");
    let began = std::time::Instant::now();
    let told = (0..4).map(|_| events.wait()).collect::<Vec<_>>();
    assert!(began.elapsed() < Duration::from_secs(5), "a snapshot a second although nothing changes");
    assert_eq!(told[3]["rig"]["doing"], "at-rest");
    // a job whose process is halted tells nothing of its servo: that is not rest
    served.post(&format!("{RIG}/jobs"), r#"{"work":{"kind":"run","film_only":true}}"#);
    in_motion(&served);
    let job = served.bench.job_process();
    rustix::process::kill_process(job, Signal::STOP).expect("the job's process");
    wait_until("what is not known", 5.0, || state(&served)["doing"] == "unknown");
    rustix::process::kill_process(job, Signal::KILL).expect("the job's process");
    served.bench.wait(1, &["lost"], 5.0);
    wait_until("rest", 10.0, || state(&served)["doing"] == "at-rest");
}

#[test]
fn jog_is_held_too_and_set_free_by_a_release() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let config =
        system_tests::changed_config(CONFIG, folder.path(), |config| set(config, "profile", "cycles", 1));
    let runs = folder.path().join("runs");
    std::fs::create_dir(&runs).expect("a folder");
    let verb = |verb: &str, more: &[&str]| {
        let mut args = vec![verb.to_owned(), config.display().to_string()];
        args.extend(["--runs-dir".to_owned(), runs.display().to_string()]);
        args.extend(more.iter().map(|word| (*word).to_owned()));
        run_rig(args)
    };
    let jog = || verb("jog", &["--pulse-us", "1500", "--duration-s", "0.1", "--stay-s", "0.1"]);
    assert!(jog().status.success(), "{}", printed(&jog()));
    assert!(verb("estop", &["--why", "wet hands"]).status.success());
    assert!(jog().status.code() == Some(3) && printed(&jog()).contains("wet hands"), "{}", printed(&jog()));
    assert!(verb("release", &["--by", "Ada"]).status.success());
    assert!(jog().status.success(), "{}", printed(&jog()));
}
