//! The queue between the program and its disk: what `rig jobs` has answered stays, whatever happens at any storage event.
//!
//! `RIG_STORAGE_SWEEP=all cargo test -p system-tests --test storage_queue -- --nocapture` goes through all events with a daemon too.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use store::Store;
use store::job::State;
use system_tests::storage::power::{Disk, Left};
use system_tests::storage::{Event, Kills, Order, Shim, kills, sweeps_all};
use system_tests::{Background, changed_config, in_real_time, printed, rig, wait_until};

/// `rig jobs` on the runs in `runs`.
fn jobs(runs: &Path, args: &[&str]) -> Command {
    rig(["jobs", "--runs-dir", runs.to_str().expect("readable")].iter().chain(args))
}

/// A folder for runs, and the words that add a run to its queue.
struct Bench {
    folder: tempfile::TempDir,
    config: String,
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let config = changed_config("chain-driven-pose-1.toml", folder.path(), |_| {});
        let config = config.to_str().expect("readable").to_owned();
        Self { folder, config }
    }

    fn runs(&self) -> PathBuf {
        self.folder.path().join("runs")
    }

    /// The runs folder is empty, or has one job in its queue.
    fn reset(&self, has_job: bool) {
        let _ = std::fs::remove_dir_all(self.runs());
        if has_job {
            assert!(jobs(&self.runs(), &self.add()).status().expect("rig starts").success());
        }
    }

    fn add(&self) -> [&str; 3] {
        ["add", "run", &self.config]
    }
}

/// The number that `rig jobs add` has answered.
fn answered(output: &Output) -> Option<i64> {
    String::from_utf8_lossy(&output.stdout).trim().strip_prefix("job ")?.parse().ok()
}

/// The states of all jobs; nothing was put aside to read them.
fn states(runs: &Path) -> Vec<(i64, State)> {
    let store = Store::open(runs).unwrap_or_else(|error| panic!("{}: {error:?}", runs.display()));
    let names =
        std::fs::read_dir(runs).expect("the folder").map(|entry| entry.expect("an entry").file_name());
    let aside: Vec<_> = names.filter(|name| name.to_string_lossy().contains("damaged")).collect();
    assert!(aside.is_empty(), "{aside:?}");
    store.jobs(99).expect("jobs").iter().map(|job| (job.id.0, job.state)).collect()
}

#[test]
fn what_the_queue_has_answered_survives_a_kill_at_each_of_its_storage_events() {
    let bench = Bench::new();
    let runs = bench.runs();
    let mut shim = Shim::before(&runs);
    let (add, cancel) = (bench.add(), ["cancel", "1"]);
    let (mut killed, mut events) = (Kills::default(), 0);
    for (has_job, words) in [(false, &add[..]), (true, &add), (true, &cancel)] {
        bench.reset(has_job);
        assert!(shim.with(jobs(&runs, words), Order::Count).status().expect("rig starts").success());
        let whole = shim.events();
        events += whole.len();
        for event in &whole {
            for &phase in event.phases() {
                bench.reset(has_job);
                let order = Order::Kill(event.number, phase);
                let output = shim.with(jobs(&runs, words), order).output().expect("rig starts");
                assert!(
                    killed.count(&shim.events()),
                    "event {} did not come: {}",
                    event.number,
                    printed(&output)
                );
                let states = states(&runs);
                let kept = |id| states.iter().find(|(known, _)| *known == id).map(|(_, state)| *state);
                let first = kept(1);
                if words == cancel {
                    assert!(matches!(first, Some(State::Queued | State::Cancelled)), "{event:?} {states:?}");
                } else if has_job {
                    assert_eq!(first, Some(State::Queued), "{event:?} {states:?}");
                }
                assert_eq!(answered(&output), None, "killed before it answered");
                // the next one needs nobody
                let next = jobs(&runs, &add).output().expect("rig starts");
                let id = answered(&next).unwrap_or_else(|| panic!("{}", printed(&next)));
                assert!(states.iter().all(|(known, _)| *known < id), "job {id} after {states:?}");
            }
        }
    }
    let [before, during, after] = killed.counts();
    println!(
        "{events} events of {} kinds: {before} kills before, {during} during, {after} after",
        killed.classes()
    );
    assert!(events > 60 && before == events && after == events && during > 20);
}

#[test]
fn what_the_queue_has_answered_survives_a_power_cut_at_each_of_its_storage_events() {
    let bench = Bench::new();
    let runs = bench.runs();
    std::fs::create_dir(&runs).expect("a folder");
    let mut shim = Shim::before(&runs);
    let mut said: Vec<(usize, i64, State)> = Vec::new();
    let mut first = true;
    for words in [&bench.add()[..], &bench.add(), &["cancel", "1"], &["retry", "1"]] {
        let command = jobs(&runs, words);
        let mut command =
            if first { shim.with(command, Order::Note) } else { shim.and(command, Order::Note) };
        first = false;
        let output = command.output().expect("rig starts");
        let at = shim.events().len();
        match answered(&output) {
            Some(id) => said.push((at, id, State::Queued)),
            None => {
                assert!(printed(&output).contains("cancelled"), "{}", printed(&output));
                said.retain(|(_, id, _)| *id != 1);
                said.push((at, 1, State::Cancelled));
            }
        }
    }
    assert_eq!(said.len(), 3, "jobs 1 to 3: {said:?}");
    let (mut disk, mut cuts) = (Disk::default(), 0);
    for (place, event) in shim.events().iter().enumerate() {
        disk.happens(event);
        for left in Left::ALL {
            let folder = tempfile::tempdir().expect("a folder");
            disk.cut(left, folder.path());
            let states = states(folder.path());
            cuts += 1;
            for (_, id, state) in said.iter().filter(|(at, ..)| *at <= place + 1) {
                assert!(
                    states.contains(&(*id, *state)),
                    "after {event:?} {left:?}: no job {id} in {states:?}"
                );
            }
        }
    }
    println!("{cuts} power cuts");
    assert!(cuts > 200);
}

#[test]
fn full_disk_and_folder_that_cannot_be_written_are_told_and_nothing_that_was_answered_is_lost() {
    let bench = Bench::new();
    let runs = bench.runs();
    bench.reset(true);
    let mut shim = Shim::before(&runs);
    shim.with(jobs(&runs, &bench.add()), Order::Count).status().expect("rig starts");
    let mut refused = 0;
    for number in 1..=shim.events().len() as u64 {
        bench.reset(true);
        let output = shim.with(jobs(&runs, &bench.add()), Order::Full(number)).output().expect("rig starts");
        let states = states(&runs);
        assert!(states.contains(&(1, State::Queued)), "event {number}: {states:?}");
        match answered(&output) {
            Some(id) => assert!(states.contains(&(id, State::Queued)), "event {number}: {states:?}"),
            None => {
                refused += 1;
                assert_eq!(output.status.code(), Some(1), "{}", printed(&output));
                assert!(printed(&output).contains("rig.sqlite"), "{}", printed(&output));
            }
        }
    }
    println!("{refused} of {} times refused", shim.events().len());
    assert!(refused > 3);

    bench.reset(true);
    let mut on = |words: &[&str]| {
        let command = rig(words.iter().chain(&["--runs-dir", runs.to_str().expect("readable")]));
        shim.with(command, Order::ReadOnly).output().expect("rig starts")
    };
    for (words, code) in [
        (&["jobs", "add", "run", bench.config.as_str()][..], 1),
        (&["run", &bench.config], 2),
        (&["daemon", &bench.config], 2),
        (&["runs", "ls"], 0),
        (&["runs", "verify"], 0),
    ] {
        let output = on(words);
        assert_eq!(output.status.code(), Some(code), "{words:?}: {}", printed(&output));
        assert!(code == 0 || printed(&output).contains("runs"), "{words:?}: {}", printed(&output));
    }
}

fn daemon(bench: &Bench) -> Command {
    rig(["daemon", &bench.config, "--runs-dir", bench.runs().to_str().expect("readable")])
}

/// Waits until all jobs are over, and ends the daemon; how it ended, where it did so by itself.
fn until_idle(command: Command, runs: &Path) -> Option<std::process::ExitStatus> {
    let mut daemon = Background::start(command);
    let mut ended = None;
    wait_until("the jobs' end", 30.0, || {
        ended = daemon.child().try_wait().expect("its status");
        ended.is_some()
            || Store::open(runs)
                .is_ok_and(|store| store.jobs(99).expect("jobs").iter().all(|job| job.state.is_over()))
    });
    if ended.is_none() {
        daemon.signal(rustix::process::Signal::TERM);
        daemon.child().wait().expect("its status");
    }
    ended
}

#[test]
fn daemon_killed_at_its_storage_events_leaves_no_job_undone_to_the_next_one() {
    let _turn = in_real_time();
    let bench = Bench::new();
    let runs = bench.runs();
    let mut shim = Shim::before(&runs);
    // soon over: there is no such run
    let replay = ["add", "replay", "20261120T101503Z-ab12cd"];
    let prepare = || {
        bench.reset(false);
        for _ in 0..2 {
            assert!(jobs(&runs, &replay).status().expect("rig starts").success());
        }
    };
    prepare();
    assert_eq!(until_idle(shim.with(daemon(&bench), Order::Count), &runs), None);
    let events: Vec<Event> = shim.events();
    let mut killed = Kills::default();
    for (number, phase) in kills(&events, 12) {
        prepare();
        let ended = until_idle(shim.with(daemon(&bench), Order::Kill(number, phase)), &runs);
        // a job's own process has events too, and which comes when is a matter of time
        let counted = killed.count(&shim.events());
        assert!(counted || ended.is_none(), "event {number} {phase:?}: {ended:?}");
        until_idle(daemon(&bench), &runs);
        let states = states(&runs);
        for id in [1, 2] {
            let state = states.iter().find(|(known, _)| *known == id).map(|(_, state)| *state);
            assert!(
                matches!(state, Some(State::Failed | State::Lost)),
                "event {number} {phase:?}: {states:?}"
            );
        }
        let journal = record::journal::read(&runs.join("daemon.jsonl")).expect("every line is whole");
        assert!(journal.iter().filter(|entry| entry.event == "started").count() >= 1);
    }
    let [before, during, after] = killed.counts();
    println!(
        "{} events, killed on {} kinds: {before} before, {during} during, {after} after",
        events.len(),
        killed.classes()
    );
    // In which phase of which event depends on when the jobs' own processes come to theirs.
    assert!(before + during + after >= 8, "{killed:?}");
    assert!(!sweeps_all() || killed.classes() > 10, "{killed:?}");
}
