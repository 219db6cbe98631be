//! A run between the program and its disk: whatever happens at any storage event, the servo is safe, what was forced to the disk is
//! there, and the next run needs nobody.
//!
//! `RIG_STORAGE_SWEEP=all cargo test -p system-tests --test storage_run -- --nocapture` goes through all events, in minutes.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use app::recover;
use record::folder::RunFolder;
use record::reader::{Item, Recording};
use record::run_id::RunId;
use record::start_stop::Status;
use record::verify::{State, verify};
use system_tests::daemon::Bench;
use system_tests::outside::Outside;
use system_tests::storage::power::{Disk, Left};
use system_tests::storage::{Event, Kills, Order, Phase, Shim, kills, sweeps_all};
use system_tests::{changed_config, in_real_time, json, only_run, printed, rig, run_rig, set, wait_until};

const CONFIG: &str = "chain-driven-pose-1.toml";
const RECORDING: &str = "recording.mcap";

/// Two short strokes in few images.
fn short(config: &mut toml::Table) {
    set(config, "profile", "cycles", 1);
    set(config, "profile", "soft_start_cycles", 0);
    set(config, "profile", "ccw_s", 0.4);
    set(config, "profile", "cw_s", 0.3);
    set(config, "profile", "amplitude_rad", 0.3);
    set(config, "run", "settle_s", 0.2);
    set(config, "run", "film_s", 0.2);
    set(config, "run", "diagnose", false);
    set(config, "fit", "parameters", vec!["q2/damping".to_owned()]);
    set(config, "camera", "fps", 40.0);
}

fn film(config: &Path, runs: &Path) -> Command {
    let mut film = rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    film.arg("--film-only");
    film
}

/// The run folders in `runs`, oldest first.
fn folders(runs: &Path) -> Vec<PathBuf> {
    let listed = record::folder::list(runs).unwrap_or_default();
    listed.into_iter().map(|run| runs.join(run.id.as_str())).collect()
}

fn images(recording: &Path) -> usize {
    let Ok(recording) = Recording::open(recording) else { return 0 };
    recording.map_while(Result::ok).filter(|(_, item)| matches!(item, Item::Image(_))).count()
}

/// How many bytes of the recording of `run` were forced to the disk; that of the run before is repaired first.
fn synced_bytes(events: &[Event], run: &Path) -> u64 {
    let recording = Path::new(run.file_name().expect("a name")).join(RECORDING);
    let of_recording = |event: &&Event| event.path == recording && event.done == "done";
    let (mut written, mut synced) = (0, 0);
    for event in events.iter().filter(of_recording) {
        match event.kind.as_str() {
            "write" => written = event.offset + event.length,
            "sync" => synced = written,
            _ => {}
        }
    }
    synced
}

/// How many images the first `bytes` of a recording hold.
fn images_within(recording: &[u8], bytes: u64) -> usize {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(RECORDING);
    std::fs::write(&path, &recording[..bytes as usize]).expect("written");
    images(&path)
}

/// Runs that were cut short one after the other, and the images that each must still have.
#[derive(Default)]
struct Promised(Vec<(PathBuf, usize)>);

impl Promised {
    /// Takes in the run that was cut short last, where it came as far as a folder.
    fn add(&mut self, runs: &Path, events: &[Event]) {
        // two runs of one second are in no order
        let id = |event: &Event| {
            let first = event.path.iter().next()?.to_str()?;
            RunId::try_from(first.trim_start_matches(".new-").to_owned()).ok()
        };
        let id = events.iter().rev().find_map(id);
        let Some(run) = id.map(|id| runs.join(id.as_str())).filter(|run| run.is_dir()) else { return };
        if self.0.iter().any(|(known, _)| *known == run) {
            return;
        }
        let found = verify(&run);
        assert_ne!(found.state, State::Damaged, "{found:?}");
        let recording = std::fs::read(run.join(RECORDING)).unwrap_or_default();
        let promised = images_within(&recording, synced_bytes(events, &run));
        self.0.push((run, promised));
    }

    /// All of them are whole and hold what was promised; nothing else is left over.
    fn are_kept(&self, runs: &Path) {
        for (run, promised) in &self.0 {
            let found = verify(run);
            assert_eq!(found.state, State::Sound, "{}: {found:?}", run.display());
            let stop = json(&run.join("stop.json"));
            let kept = images(&run.join(RECORDING));
            assert!(kept >= *promised, "{}: {kept} of {promised} images", run.display());
            assert_eq!(stop["images"], kept, "{stop}");
        }
        let names =
            std::fs::read_dir(runs).expect("the folder").map(|entry| entry.expect("an entry").file_name());
        let left: Vec<_> = names.filter(|name| name.to_string_lossy().starts_with(".new-")).collect();
        assert!(left.is_empty(), "{left:?}");
    }
}

/// Board and camera as processes of their own, and their rig.
fn bench(folder: &Path) -> Outside {
    let outside = Outside::new(CONFIG, folder);
    let text = std::fs::read_to_string(&outside.config).expect("the config");
    let mut config: toml::Table = text.parse().expect("TOML");
    short(&mut config);
    std::fs::write(&outside.config, config.to_string()).expect("written");
    outside
}

/// Films until it works: a machine that is busy with other things lets a camera stall.
fn filmed(mut command: impl FnMut() -> Command) -> Output {
    let mut output = command().output().expect("rig starts");
    for _ in 0..3 {
        if output.status.success() {
            break;
        }
        output = command().output().expect("rig starts");
    }
    assert!(output.status.success(), "{}", printed(&output));
    output
}

/// A shim before the folder of runs, which is gone again, and the storage events of a whole run.
fn counted(outside: &Outside) -> (Shim, Vec<Event>) {
    let mut shim = Shim::before(&outside.runs);
    filmed(|| shim.with(film(&outside.config, &outside.runs), Order::Count));
    let events = shim.events();
    std::fs::remove_dir_all(&outside.runs).expect("removed");
    (shim, events)
}

#[test]
fn run_killed_at_its_storage_events_leaves_the_servo_safe_and_the_next_run_needs_nobody() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let outside = bench(folder.path());
    let (mut shim, events) = counted(&outside);
    let (mut killed, mut promised) = (Kills::default(), Promised::default());
    for (number, phase) in kills(&events, 24) {
        let order = Order::Kill(number, phase);
        let output = shim.with(film(&outside.config, &outside.runs), order).output().expect("rig starts");
        let events = shim.events();
        assert!(killed.count(&events) || output.status.code().is_some(), "{}", printed(&output));
        // the dead-man's time in tests, and a margin
        wait_until("the servo's stop", 6.0, || outside.last_pulse().is_none());
        promised.add(&outside.runs, &events);
    }
    // each run has made the one before whole, and this one the last
    let last = filmed(|| film(&outside.config, &outside.runs));
    promised.are_kept(&outside.runs);
    let listed = run_rig(["runs".as_ref(), "ls".as_ref(), "--runs-dir".as_ref(), outside.runs.as_os_str()]);
    let listed = printed(&listed);
    assert!(!listed.contains("incomplete") && !listed.contains("unreadable"), "{listed}{}", printed(&last));
    let [before, during, after] = killed.counts();
    println!(
        "{} events; killed on {} kinds: {before} before, {during} during, {after} after; {} runs were cut short with {} images on the \
         disk, and kept {}",
        events.len(),
        killed.classes(),
        promised.0.len(),
        promised.0.iter().map(|(_, images)| images).sum::<usize>(),
        promised.0.iter().map(|(run, _)| images(&run.join(RECORDING))).sum::<usize>(),
    );
    assert!(before >= 3 && during >= 2 && after >= 3, "{killed:?}");

    let Some((run, _)) = promised.0.iter().max_by_key(|(_, images)| *images) else {
        panic!("no run was cut short")
    };
    let out = folder.path().join("again");
    let output = run_rig(["replay".as_ref(), run.as_os_str(), "--out".as_ref(), out.as_os_str()]);
    // what moved too little, or not yet, cannot be fitted, and where it hardly moved the mechanism may not be told from its background: all
    // images have been read for either
    assert!(matches!(output.status.code(), Some(0 | 4)), "{}", printed(&output));
    let is_read = out.join("frames.csv").exists() || printed(&output).contains("images that were looked at");
    assert!(is_read, "{}", printed(&output));
}

#[test]
fn full_disk_at_a_storage_event_of_a_run_stops_the_servo_and_the_next_run_needs_nobody() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let outside = bench(folder.path());
    let (mut shim, events) = counted(&outside);
    let takes_room = |event: &&Event| ["write", "create", "make-folder"].contains(&event.kind.as_str());
    let before: Vec<Event> = events.iter().filter(takes_room).cloned().collect();
    let mut numbers: Vec<u64> = kills(&before, 14).iter().map(|(number, _)| *number).collect();
    numbers.dedup();
    let (mut promised, mut codes) = (Promised::default(), Vec::new());
    for number in numbers {
        let mut film = shim.with(film(&outside.config, &outside.runs), Order::Full(number));
        // a daemon's job has its log on the same disk
        std::fs::create_dir_all(&outside.runs).expect("a folder");
        film.stderr(std::fs::File::create(outside.runs.join("log")).expect("a log"));
        let output = film.output().expect("rig starts");
        let events = shim.events();
        let refused = events.iter().filter(|event| event.done == "full").count();
        assert!(refused == 0 || !output.status.success(), "{}", printed(&output));
        // it was told to stop before the program ended
        assert_eq!(outside.last_pulse(), None, "{}", printed(&output));
        codes.push(output.status.code());
        promised.add(&outside.runs, &events);
    }
    filmed(|| film(&outside.config, &outside.runs));
    promised.are_kept(&outside.runs);
    println!("exit codes {codes:?}");
    assert!(codes.iter().all(|code| matches!(code, Some(0..=3))) && codes.contains(&Some(3)), "{codes:?}");
}

#[test]
fn power_cut_at_a_storage_event_of_a_run_leaves_all_that_was_forced_to_the_disk() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let config = changed_config(CONFIG, folder.path(), short);
    let runs = folder.path().join("runs");
    std::fs::create_dir(&runs).expect("a folder");
    let mut shim = Shim::before(&runs);
    filmed(|| {
        std::fs::remove_dir_all(&runs).expect("removed");
        std::fs::create_dir(&runs).expect("a folder");
        shim.with(film(&config, &runs), Order::Note)
    });
    let run = only_run(&runs).expect("a run");
    let whole = std::fs::read(run.join(RECORDING)).expect("a recording");
    let events = shim.events();
    let cuts: Vec<u64> =
        kills(&events, 60).iter().filter(|kill| kill.1 == Phase::After).map(|kill| kill.0).collect();
    let (mut disk, mut done, mut recovered, mut least) = (Disk::default(), 0, 0, usize::MAX);
    for (place, event) in events.iter().enumerate() {
        disk.happens(event);
        if !cuts.contains(&event.number) {
            continue;
        }
        let promised = images_within(&whole, synced_bytes(&events[..=place], &run));
        let is_over = events[..=place].iter().any(|event| event.path2.ends_with("stop.json"))
            && events[place].kind == "sync-folder";
        for left in Left::ALL {
            let folder = tempfile::tempdir().expect("a folder");
            let after = folder.path().join("runs");
            disk.cut(left, &after);
            let claim = recover::claim(&after).expect("nobody films");
            recover::all(&after, &claim, |_: &RunId, said| {
                assert!(!said.contains("cannot be recovered"), "after {event:?} {left:?}: {said}");
                recovered += 1;
            });
            done += 1;
            let kept = folders(&after);
            assert!(promised == 0 || kept.len() == 1, "after {event:?} {left:?}: no run");
            for run in &kept {
                let found = verify(run);
                assert_eq!(found.state, State::Sound, "after {event:?} {left:?}: {found:?}");
                let kept = images(&run.join(RECORDING));
                assert!(kept >= promised, "after {event:?} {left:?}: {kept} of {promised} images");
                least = least.min(kept - promised);
                let stop = RunFolder::open(run).expect("a run").stop().cloned().expect("an end");
                assert!(!is_over || stop.status == Status::Success && stop.recovered.is_none(), "{stop:?}");
            }
        }
    }
    println!("{} events, {done} power cuts, {recovered} runs recovered", events.len());
    assert!(done >= 60 && recovered > 20 && least == 0);
    assert!(!sweeps_all() || done >= 4 * events.len());
}

#[test]
fn slow_disk_loses_no_image() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let outside = bench(folder.path());
    let mut shim = Shim::before(&outside.runs);
    filmed(|| shim.with(film(&outside.config, &outside.runs), Order::Slow(150)));
    let stop = json(&folders(&outside.runs).pop().expect("a run").join("stop.json"));
    assert_eq!((&stop["status"], &stop["messages_dropped"]), (&"success".into(), &0.into()), "{stop}");
    assert_eq!(outside.last_pulse(), None);
}

#[test]
fn camera_that_hangs_in_a_daemons_job_fails_that_job_alone() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    let hung = tempfile::tempdir().expect("a folder");
    let config = changed_config(CONFIG, hung.path(), |config| {
        short(config);
        let fault: toml::Table = "at_s = 1.0\nkind = \"camera-slow\"".parse().expect("a table");
        set(config, "mock", "faults", toml::Value::Array(vec![fault.into()]));
    });
    bench.jobs(&["add", "run", config.to_str().expect("readable"), "--film-only"]);
    bench.jobs(&["add", "run", bench.config.to_str().expect("readable"), "--film-only"]);
    let _daemon = bench.start(&[]);
    let line = bench.wait(1, &["failed"], 30.0);
    assert!(line.contains("no image for"), "{line}");
    let stop = json(&folders(&bench.runs)[0].join("stop.json"));
    assert_eq!((&stop["status"], &stop["servo"]), (&"fail".into(), &"acknowledged".into()), "{stop}");
    bench.wait(2, &["done"], 60.0);
}

#[test]
fn verify_tells_what_is_not_what_was_written_and_so_does_sha256sum() {
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let config = changed_config(CONFIG, folder.path(), short);
    let runs = folder.path().join("runs");
    filmed(|| {
        let _ = std::fs::remove_dir_all(&runs);
        rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()])
    });
    let run = only_run(&runs).expect("a run");
    let verify = |more: &[&str]| {
        let runs = ["runs", "verify", "--runs-dir", runs.to_str().expect("readable")];
        run_rig(runs.iter().chain(more))
    };
    let sound = verify(&["--json"]);
    assert!(printed(&sound).contains("\"verdict\":\"sound\""), "{}", printed(&sound));
    let sums = std::fs::read_to_string(run.join("SHA256SUMS")).expect("the sums");
    for name in ["recording.mcap", "start.json", "stop.json", "journal.jsonl", "fit.json", "report.html"] {
        assert!(sums.contains(&format!("  {name}\n")), "no {name} in\n{sums}");
    }
    if let Ok(output) =
        Command::new("sha256sum").args(["-c", "--quiet", "SHA256SUMS"]).current_dir(&run).output()
    {
        assert!(output.status.success(), "{}", printed(&output));
    }
    for (name, says) in [
        ("recording.mcap", "images"),
        ("journal.jsonl", "not what was written"),
        ("trajectory.csv", "`rig replay` makes it again"),
    ] {
        let path = run.join(name);
        let bytes = std::fs::read(&path).expect("a file");
        let mut flipped = bytes.clone();
        flipped[bytes.len() / 2] ^= 1;
        std::fs::write(&path, flipped).expect("written");
        let damaged = verify(&[]);
        assert_eq!(damaged.status.code(), Some(4), "{}", printed(&damaged));
        assert!(
            printed(&damaged).contains(name) && printed(&damaged).contains(says),
            "{}",
            printed(&damaged)
        );
        std::fs::remove_file(&path).expect("removed");
        assert!(printed(&verify(&[])).contains(&format!("{name} is missing")));
        std::fs::write(&path, bytes).expect("written");
        assert!(verify(&[]).status.success());
    }
    std::fs::write(run.join("notes.txt"), "water was murky").expect("written");
    assert!(verify(&[]).status.success(), "what somebody adds is no damage");
}
