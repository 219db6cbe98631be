//! The rig as a service: what the manager hears of it, how it stops, who may stop it from outside, and what the package holds.

use std::os::unix::net::UnixDatagram;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use rustix::process::Signal;
use system_tests::outside::Outside;
use system_tests::{
    Background, changed_config, in_real_time, json, printed, repository, rig, run_rig, set, wait_until,
};

const CONFIG: &str = "chain-driven-pose-1.toml";
/// `TimeoutStopSec` of the unit is twice as long.
const STOP: Duration = Duration::from_secs(5);

fn with_schedule(config: &Path, cron: &str) {
    let text = std::fs::read_to_string(config).expect("a config");
    std::fs::write(config, format!("{text}\n[schedule]\ncron = \"{cron}\"\n")).expect("written");
}

/// Tells the daemon to end: its exit code, and how long it took.
fn end(daemon: &mut Background) -> (Option<i32>, Duration) {
    let told = Instant::now();
    daemon.signal(Signal::TERM);
    let mut status = None;
    wait_until("the daemon's end", STOP.as_secs_f64(), || {
        status = daemon.child().try_wait().expect("its status");
        status.is_some()
    });
    (status.and_then(|status| status.code()), told.elapsed())
}

#[test]
fn manager_hears_ready_then_signs_of_life_then_the_end() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("notify");
    let manager = UnixDatagram::bind(&path).expect("a socket");
    manager.set_read_timeout(Some(Duration::from_secs(10))).expect("a socket");
    let hear = || {
        let mut buffer = [0; 4096];
        let length = manager.recv(&mut buffer).expect("a word within 10 s");
        String::from_utf8_lossy(&buffer[..length]).into_owned()
    };
    let hears = |what: &str| while !hear().lines().any(|line| line == what) {};
    let config = changed_config(CONFIG, folder.path(), |config| set(config, "schedule", "cron", "0 0 1 1 *"));
    let runs = folder.path().join("runs");
    let mut daemon = rig(["daemon".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    daemon.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "1000000");
    let mut daemon = Background::start(daemon);
    hears("READY=1");
    let fed = Instant::now();
    for _ in 0..8 {
        hears("WATCHDOG=1");
    }
    assert!(fed.elapsed() < Duration::from_secs(4), "fed eight times in {:?}", fed.elapsed());
    assert_eq!(end(&mut daemon).0, Some(0));
    hears("STOPPING=1");
}

#[test]
fn sigterm_stops_the_servo_of_a_scheduled_run_first_and_the_daemon_within_5_s() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let outside = Outside::new(CONFIG, folder.path());
    with_schedule(&outside.config, "* * * * * *");
    let mut daemon = outside.start_verb("daemon");
    let run = outside.wait_for_motion();
    let (code, took) = end(&mut daemon);
    println!("ended {:.0} ms after SIGTERM", took.as_secs_f64() * 1e3);
    assert!(matches!(code, Some(0 | 130)), "{code:?}");
    assert_eq!(outside.last_pulse(), None, "the servo still gets pulses");
    let stop = json(&run.join("stop.json"));
    assert_eq!((&stop["status"], &stop["servo"]), (&"abort".into(), &"acknowledged".into()), "{stop}");
}

#[test]
fn estop_of_another_user_who_may_signal_nobody_stops_what_moves_all_the_same() {
    if !rustix::process::geteuid().is_root() {
        eprintln!("skipped: another user's estop (only root becomes another user)");
        return;
    }
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let readable = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(folder.path(), readable).expect("ours");
    let outside = Outside::new(CONFIG, folder.path());
    // As a service has it: a temporary folder of its own.
    let own = tempfile::tempdir().expect("a folder");
    let args = ["run".as_ref(), outside.config.as_os_str(), "--runs-dir".as_ref(), outside.runs.as_os_str()];
    let mut running = rig(args);
    running.env("TMPDIR", own.path());
    let mut running = Background::start(running);
    outside.wait_for_motion();
    let program = tempfile::Builder::new().tempfile_in(folder.path()).expect("a file").into_temp_path();
    std::fs::copy(rig::<[&str; 0], &str>([]).get_program(), &program).expect("a program that all may start");
    let readable = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(&program, readable).expect("ours");
    let nobody = 65534;
    let estop = || {
        let mut estop = Command::new(&program);
        estop.arg("estop").arg(&outside.config);
        estop
    };
    let output = estop().uid(nobody).gid(nobody).output().expect("rig starts");
    assert!(output.status.success(), "{}", printed(&output));
    let said = printed(&output);
    assert!(said.contains(&running.child().id().to_string()) && said.contains("rig release"), "{said}");
    assert_eq!(outside.last_pulse(), None, "the servo still gets pulses");
    wait_until("the end of rig run", 20.0, || running.child().try_wait().expect("its status").is_some());
}

/// Whether `program` is here; says what is skipped where it is not.
fn is_here(program: &str, what: &str) -> bool {
    let here = Command::new(program).arg("--version").output().is_ok();
    if !here {
        eprintln!("skipped: {what} ({program} is not here)");
    }
    here
}

#[test]
fn completions_are_scripts_of_their_shells_and_every_verb_has_a_man_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = run_rig(["packaging".as_ref(), folder.path().as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    let completions = folder.path().join("completions");
    for (shell, script) in [("bash", "rig.bash"), ("zsh", "_rig"), ("fish", "rig.fish")] {
        let script = completions.join(script);
        let text = std::fs::read_to_string(&script).expect("a script");
        assert!(text.contains("calibrate") && text.contains("max-runs"), "{}", script.display());
        if is_here(shell, "a shell's look at its completions") {
            let output = Command::new(shell).arg("-n").arg(&script).output().expect("the shell starts");
            assert!(output.status.success() && output.stderr.is_empty(), "{shell}: {}", printed(&output));
        }
    }
    let typed = "source \"$0\"; COMP_WORDS=(rig daemon --max); COMP_CWORD=2; _rig rig --max daemon; echo \"${COMPREPLY[@]}\"";
    let output = Command::new("bash").args(["-c", typed]).arg(completions.join("rig.bash")).output();
    assert_eq!(String::from_utf8_lossy(&output.expect("bash starts").stdout).trim(), "--max-runs");

    let help = printed(&run_rig(["--help"]));
    let verbs = help.lines().take_while(|line| *line != "Options:");
    let verbs: Vec<&str> = verbs.filter_map(|line| line.strip_prefix("  ")?.split(' ').next()).collect();
    assert!(verbs.len() > 20 && !verbs.contains(&"packaging"), "{verbs:?}");
    for verb in verbs {
        let page = folder.path().join(format!("man/rig-{verb}.1"));
        let text =
            std::fs::read_to_string(&page).unwrap_or_else(|error| panic!("{}: {error}", page.display()));
        assert!(text.contains(".SH SYNOPSIS"), "{text}");
    }
}

#[test]
fn systemd_understands_the_unit_and_finds_it_well_shut_in() {
    if !is_here("systemd-analyze", "systemd's look at the unit") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let shipped = repository().join("rig/packaging/rig@.service");
    let unit = folder.path().join("rig@.service");
    let text = std::fs::read_to_string(shipped).expect("the unit");
    let program = rig::<[&str; 0], &str>([]).get_program().to_str().expect("a readable path").to_owned();
    std::fs::write(&unit, text.replace("/usr/bin/rig", &program)).expect("written");
    // Stands for the targets of a system that may not be here.
    for target in ["sysinit", "basic", "shutdown", "network", "time-sync", "multi-user"] {
        std::fs::write(folder.path().join(format!("{target}.target")), "[Unit]\n").expect("written");
    }
    let analyze = |arguments: &[&str]| {
        let mut analyze = Command::new("systemd-analyze");
        analyze.args(arguments).arg(&unit).env("SYSTEMD_UNIT_PATH", format!("{}:", folder.path().display()));
        analyze.output().expect("systemd-analyze starts")
    };
    let output = analyze(&["verify", "--man=no"]);
    assert!(output.status.success() && output.stderr.is_empty(), "{}", printed(&output));
    // Ten times the exposure, of 100.
    let output = analyze(&["security", "--offline=true", "--threshold=20"]);
    assert!(output.status.success(), "{}", printed(&output));
}
