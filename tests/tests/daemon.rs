//! The daemon: jobs of its queue one after the other, and the experiment on its schedule.

use std::os::unix::process::CommandExt as _;

use rustix::process::{Pid, Signal, kill_process, kill_process_group, test_kill_process};
use system_tests::daemon::Bench;
use system_tests::{Background, in_real_time, json, only_run, printed, run_rig, set, wait_until};

#[test]
fn daemon_runs_at_its_slot_recalibrates_and_journals_the_slots_it_skips() {
    let _turn = in_real_time();
    let bench = Bench::new("*/2 * * * * *");
    let output = bench.daemon(&["--max-runs", "2"]).output().expect("the daemon");
    assert!(output.status.success(), "{}", printed(&output));
    let jobs = bench.jobs(&["ls"]);
    assert_eq!(
        jobs.matches("  done  ").count(),
        4,
        "two runs, two recalibrations\n{jobs}{}",
        bench.journal()
    );
    let good = bench.runs.join("last-good");
    assert_eq!(jobs.matches("updated: ").count(), 2, "{jobs}");
    let fit = json(&good.join("fit.json"));
    assert_eq!(fit["recalibration"]["accepted"], true, "{fit}");
    assert!(good.join("model.xml").exists());
    // A run takes longer than the two seconds between slots.
    assert!(bench.journal().contains("\"skipped\""), "{}", bench.journal());
}

#[test]
fn sigterm_ends_a_waiting_daemon_and_a_second_daemon_is_refused() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    let mut daemon = bench.start(&[]);
    let second = bench.daemon(&[]).output().expect("the second daemon");
    assert_eq!(second.status.code(), Some(2), "{}", printed(&second));
    assert!(printed(&second).contains(&daemon.child().id().to_string()), "{}", printed(&second));
    daemon.signal(Signal::TERM);
    wait_until("the daemon's end", 5.0, || daemon.child().try_wait().expect("its status").is_some());
    assert!(bench.journal().contains("\"stopped\""), "{}", bench.journal());
}

#[test]
fn daemon_starts_where_its_session_was_begun_outside_its_container() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    if bench.start_in_a_container().is_none() {
        eprintln!("Skipped: nobody may have process numbers of their own here.");
    }
}

#[test]
fn rig_run_beside_a_daemon_hands_its_job_in_and_shows_how_it_goes() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    let _daemon = bench.start(&[]);
    let run = ["run".as_ref(), bench.config.as_os_str(), "--runs-dir".as_ref(), bench.runs.as_os_str()];
    let output = run_rig(run);
    assert!(output.status.success(), "{}", printed(&output));
    let told = printed(&output);
    assert!(told.contains("as job 1") && told.contains("driving"), "{told}");
    let run = only_run(&bench.runs).expect("a run");
    assert!(told.contains(run.to_str().expect("readable")) && run.join("report.html").exists(), "{told}");
    bench.wait(2, &["done"], 60.0);
}

#[test]
fn cancelled_run_stops_the_servo_and_the_next_job_has_its_turn() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    bench.add_run();
    let _daemon = bench.start(&[]);
    let run = bench.wait_for_motion();
    bench.add_run();
    assert!(bench.jobs(&["cancel", "1", "--why", "water on the floor"]).contains("told to end"));
    bench.wait(1, &["cancelled"], 5.0);
    let stop = json(&run.join("stop.json"));
    assert_eq!((&stop["status"], &stop["servo"]), (&"abort".into(), &"acknowledged".into()), "{stop}");
    bench.wait(2, &["done"], 60.0);
}

#[test]
fn daemon_killed_during_a_run_leaves_the_run_alone_and_the_next_daemon_waits_for_it() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    bench.add_run();
    bench.add_run();
    let daemon = bench.start(&[]);
    let run = bench.wait_for_motion();
    daemon.signal(Signal::KILL);
    drop(daemon);
    assert!(test_kill_process(bench.job_process()).is_ok(), "the run goes on");
    let _next = bench.start(&[]);
    wait_until("the job's adoption", 5.0, || bench.journal().contains("\"job-adopted\""));
    let line = bench.wait(1, &["done"], 60.0);
    assert!(line.contains(run.to_str().expect("readable")), "{line}");
    // one motion at a time: the second began when the first was over
    bench.wait(2, &["done"], 60.0);
    assert_eq!(json(&run.join("stop.json"))["status"], "success");
}

#[test]
fn killed_job_is_lost_and_neither_the_daemon_nor_the_next_job_minds() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    bench.add_run();
    bench.add_run();
    let mut daemon = bench.start(&[]);
    let run = bench.wait_for_motion();
    kill_process(bench.job_process(), Signal::KILL).expect("the job's process");
    let line = bench.wait(1, &["lost"], 5.0);
    assert!(line.contains("signal: 9"), "{line}");
    // before anything moves again
    wait_until("the run's recovery", 10.0, || run.join("stop.json").exists());
    let stop = json(&run.join("stop.json"));
    assert_eq!((&stop["status"], &stop["servo"]), (&"fail".into(), &"left-to-dead-man".into()), "{stop}");
    assert!(stop["recovered"].is_object() && stop["images"].as_u64() > Some(20), "{stop}");
    wait_until("the journal's line", 10.0, || bench.journal().contains("\"run-recovered\""));
    bench.wait(2, &["done"], 60.0);
    assert!(daemon.child().try_wait().expect("its status").is_none(), "the daemon lives");
}

#[test]
fn sigterm_during_a_run_stops_the_servo_and_ends_within_five_seconds() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    bench.add_run();
    let mut daemon = bench.start(&[]);
    let run = bench.wait_for_motion();
    daemon.signal(Signal::TERM);
    wait_until("the daemon's end", 5.0, || daemon.child().try_wait().expect("its status").is_some());
    let stop = json(&run.join("stop.json"));
    assert_eq!((&stop["status"], &stop["servo"]), (&"abort".into(), &"acknowledged".into()), "{stop}");
    assert!(bench.job(1).contains("cancelled"), "{}", bench.jobs(&["ls"]));
}

/// A terminal sends Ctrl-C to all that runs in it.
#[test]
fn ctrl_c_during_a_run_stops_the_servo_before_the_job_ends() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    bench.add_run();
    let mut command = bench.daemon(&[]);
    command.process_group(0);
    let mut daemon = Background::start(command);
    let run = bench.wait_for_motion();
    let group = Pid::from_child(daemon.child());
    kill_process_group(group, Signal::INT).expect("the daemon's group");
    wait_until("the daemon's end", 5.0, || daemon.child().try_wait().expect("its status").is_some());
    let stop = json(&run.join("stop.json"));
    assert_eq!((&stop["status"], &stop["servo"]), (&"abort".into(), &"acknowledged".into()), "{stop}");
    assert!(bench.job(1).contains("cancelled"), "{}", bench.jobs(&["ls"]));
}

#[test]
fn alert_reaches_a_program_and_a_webhook_that_refuses_it_at_first() {
    use std::io::{BufRead as _, BufReader, Read as _, Write as _};

    let _turn = in_real_time();
    let bench = Bench::quiet();
    let said = bench.runs.join("said.json");
    let hook = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = hook.local_addr().expect("its address");
    let listening = std::thread::spawn(move || -> std::io::Result<Vec<String>> {
        let mut bodies = Vec::new();
        for answer in ["503 Service Unavailable", "200 OK"] {
            let mut stream = BufReader::new(hook.accept()?.0);
            let (mut length, mut line) = (0, String::new());
            while stream.read_line(&mut line)? > 2 {
                if let Some(value) = line.to_lowercase().strip_prefix("content-length:") {
                    length = value.trim().parse().unwrap_or(0);
                }
                line.clear();
            }
            let mut body = vec![0; length];
            stream.read_exact(&mut body)?;
            bodies.push(String::from_utf8_lossy(&body).into_owned());
            write!(stream.get_mut(), "HTTP/1.1 {answer}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")?;
        }
        Ok(bodies)
    });
    bench.change(|config| {
        let script = format!("cat > {}.part; mv {}.part {}", said.display(), said.display(), said.display());
        set(config, "alerts", "command", vec!["sh".to_owned(), "-c".to_owned(), script]);
        set(config, "alerts", "webhook", format!("http://{address}/secret-path"));
    });
    let _daemon = bench.start(&[]);
    bench.jobs(&["add", "fit", "20261120T101503Z-ab12cd"]);
    bench.wait(1, &["failed"], 30.0);
    wait_until("the program to be told", 10.0, || said.exists());
    let alert = json(&said);
    assert_eq!((&alert["kind"], &alert["job"]), (&"job-failed".into(), &1.into()), "{alert}");
    assert!(alert["text"].to_string().contains("20261120T101503Z-ab12cd"), "{alert}");
    wait_until("the webhook to be told again", 30.0, || listening.is_finished());
    let bodies = listening.join().expect("the listener").expect("two requests");
    assert_eq!(bodies[0], bodies[1]);
    let posted: serde_json::Value = serde_json::from_str(&bodies[1]).expect("JSON");
    assert_eq!(posted, alert);
    assert!(bench.journal().contains("\"alert\""), "{}", bench.journal());
}
