//! The daemon: the experiment on its schedule.

use rustix::process::Signal;
use system_tests::{Background, changed_config, in_real_time, printed, rig, run_rig, set, wait_until};

fn short_experiment(config: &mut toml::Table, cron: &str) {
    set(config, "profile", "cycles", 1);
    set(config, "profile", "soft_start_cycles", 0);
    set(config, "fit", "parameters", vec!["q2/damping".to_owned()]);
    set(config, "run", "diagnose", false);
    set(config, "schedule", "cron", cron);
}

#[test]
fn daemon_runs_at_its_slot_recalibrates_and_journals_the_slots_it_skips() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let runs = folder.path().join("runs");
    let config = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
        short_experiment(config, "*/2 * * * * *");
    });
    let output = run_rig([
        "daemon".as_ref(),
        config.as_os_str(),
        "--runs-dir".as_ref(),
        runs.as_os_str(),
        "--max-runs".as_ref(),
        "2".as_ref(),
    ]);
    assert!(output.status.success(), "{}", printed(&output));
    let journal = std::fs::read_to_string(runs.join("daemon.jsonl")).expect("the daemon's journal");
    assert_eq!(journal.matches("\"done\"").count(), 2, "{journal}");
    let good = runs.join("last-good");
    assert_eq!(journal.matches("\"recalibrated\"").count(), 2, "{journal}");
    let fit = system_tests::json(&good.join("fit.json"));
    assert_eq!(fit["recalibration"]["accepted"], true, "{fit}");
    assert!(good.join("model.xml").exists());
    // A run takes longer than the two seconds between slots.
    assert!(journal.contains("\"skipped\""), "{journal}");
}

#[test]
fn sigterm_ends_a_waiting_daemon_and_a_second_daemon_is_refused() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let runs = folder.path().join("runs");
    let config = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
        short_experiment(config, "0 0 1 1 *");
    });
    let args = ["daemon".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()];
    let mut daemon = Background::start(rig(args));
    let started =
        || std::fs::read_to_string(runs.join("daemon.jsonl")).is_ok_and(|text| text.contains("started"));
    wait_until("the daemon's start", 10.0, started);
    let second = run_rig(args);
    assert_eq!(second.status.code(), Some(2), "{}", printed(&second));
    assert!(printed(&second).contains(&daemon.child().id().to_string()), "{}", printed(&second));
    daemon.signal(Signal::TERM);
    wait_until("the daemon's end", 5.0, || daemon.child().try_wait().expect("its status").is_some());
    let journal = std::fs::read_to_string(runs.join("daemon.jsonl")).expect("the daemon's journal");
    assert!(journal.contains("stopped"), "{journal}");
}
