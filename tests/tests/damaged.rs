//! Runs whose files were damaged, cut or lost: nothing is shortened in silence, and what is whole is used.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Output;

use serde_json::Value;
use system_tests::daemon::Bench;
use system_tests::storage::{Order, Shim};
use system_tests::{changed_config, in_real_time, json, only_run, printed, rig, run_rig, set};

const RECORDING: &str = "recording.mcap";

/// Strokes that take a few seconds, and so a few chunks.
fn short(config: &mut toml::Table) {
    set(config, "profile", "cycles", 1);
    set(config, "profile", "soft_start_cycles", 0);
    set(config, "run", "diagnose", false);
    set(config, "run", "film_s", 2.0);
    set(config, "fit", "parameters", vec!["q2/damping".to_owned()]);
    set(config, "camera", "fps", 40.0);
}

/// A run of the mock rig, fitted, and the folder that it lies in.
struct Made {
    _folder: tempfile::TempDir,
    runs: PathBuf,
    run: PathBuf,
    images: u64,
}

impl Made {
    fn new(change: impl FnOnce(&mut toml::Table)) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let config = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
            short(config);
            change(config);
        });
        let runs = folder.path().join("runs");
        let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
        assert!(output.status.success(), "{}", printed(&output));
        let run = only_run(&runs).expect("a run");
        let images = json(&run.join("stop.json"))["images"].as_u64().expect("a number");
        Self { _folder: folder, runs, run, images }
    }

    fn recording(&self) -> Vec<u8> {
        std::fs::read(self.run.join(RECORDING)).expect("a recording")
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.run.join(name), bytes).expect("written");
    }

    fn runs(&self, words: &[&str]) -> Output {
        run_rig([&["runs", "--runs-dir", self.runs.to_str().expect("readable")], words].concat())
    }

    /// What `rig replay` makes of it, and where.
    fn replay(&self, out: &str, more: &[&str]) -> (Output, PathBuf) {
        let out = self.runs.with_file_name(out);
        let mut replay = rig(["replay".as_ref(), self.run.as_os_str(), "--out".as_ref(), out.as_os_str()]);
        (replay.args(more).output().expect("rig starts"), out)
    }

    /// A replay must say that images are lost from the recording: how many were read.
    fn replay_says_what_is_lost(&self, out: &str) -> u64 {
        let (output, out) = self.replay(out, &["--strict"]);
        assert_eq!(output.status.code(), Some(4), "{}", printed(&output));
        let rows =
            std::fs::read_to_string(out.join("frames.csv")).expect("a table").lines().count() as u64 - 1;
        let headline = format!("{} lost from the recording", self.images - rows);
        assert!(printed(&output).contains(&headline), "{headline}\n{}", printed(&output));
        let page = std::fs::read_to_string(out.join("report.html")).expect("a report");
        assert!(page.contains(&headline) && !page.contains("verdict good"), "{headline}");

        let (output, _) = self.replay("again", &["--json"]);
        assert!(output.status.success(), "{}", printed(&output));
        let said: Value = serde_json::from_slice(&output.stdout).expect("one object");
        assert!(said["warnings"].to_string().contains(&headline), "{headline}: {said}");
        rows
    }
}

/// Where the chunks of a recording lie in its file.
fn chunks(file: &[u8]) -> Vec<Range<usize>> {
    let (mut at, mut chunks) = (8, Vec::new());
    while at + 9 <= file.len() {
        let bytes = u64::from_le_bytes(file[at + 1..at + 9].try_into().expect("8 bytes")) as usize;
        let record = at..at + 9 + bytes;
        if file[at] == 6 {
            chunks.push(record.clone());
        }
        at = record.end;
    }
    chunks
}

#[test]
fn replay_of_a_cut_recording_says_how_many_images_are_lost() {
    let _turn = in_real_time();
    let made = Made::new(|_| {});
    let (output, _) = made.replay("whole", &["--strict"]);
    assert!(output.status.success(), "{}", printed(&output));

    let whole = made.recording();
    let last = chunks(&whole).pop().expect("a chunk");
    made.put(RECORDING, &whole[..last.start + last.len() / 2]);
    let read = made.replay_says_what_is_lost("cut");
    assert!(read > made.images / 2 && read < made.images, "{read} of {}", made.images);
}

#[test]
fn one_flipped_bit_costs_its_chunk_and_no_more_and_recover_makes_the_recording_whole() {
    let _turn = in_real_time();
    let made = Made::new(|_| {});
    let whole = made.recording();
    let chunks = chunks(&whole);
    assert!(chunks.len() > 4, "{chunks:?}");
    // one that may hold what the servo was told
    let hit = &chunks[chunks.len() / 2];
    let mut flipped = whole.clone();
    flipped[hit.start + hit.len() / 2] ^= 1;
    made.put(RECORDING, &flipped);

    let found = made.runs(&["verify"]);
    assert_eq!(found.status.code(), Some(4), "{}", printed(&found));
    let says = format!("of {} images", made.images);
    assert!(printed(&found).contains(&says) && printed(&found).contains("recover"), "{}", printed(&found));
    let read = made.replay_says_what_is_lost("flipped");
    let per_chunk = made.images / (chunks.len() as u64 - 2);
    assert!(read + 2 * per_chunk >= made.images, "{read} of {} in {} chunks", made.images, chunks.len());

    let recovered = made.runs(&["recover"]);
    assert!(recovered.status.success(), "{}", printed(&recovered));
    assert!(
        printed(&recovered).contains(&format!("{read} of its {} images", made.images)),
        "{}",
        printed(&recovered)
    );
    let found = made.runs(&["verify"]);
    assert!(printed(&found).contains("sound"), "{}", printed(&found));
    let stop = json(&made.run.join("stop.json"));
    assert_eq!((&stop["status"], &stop["images"]), (&"success".into(), &made.images.into()), "{stop}");
    assert_eq!(made.replay_says_what_is_lost("recovered"), read);
    assert!(printed(&made.runs(&["recover"])).contains("no run needs it"));
}

#[test]
fn run_with_a_garbled_stop_json_is_read_replayed_and_recovered() {
    let _turn = in_real_time();
    let made = Made::new(|_| {});
    let garbled = b"{\"status\": \"succ";
    made.put("stop.json", garbled);
    let listed = made.runs(&["ls"]);
    let says = printed(&listed);
    assert!(says.contains("incomplete") && says.contains("its stop.json cannot be read"), "{says}");
    let found = made.runs(&["verify", "--json"]);
    assert!(printed(&found).contains("\"verdict\":\"incomplete\""), "{}", printed(&found));
    let (output, out) = made.replay("garbled", &[]);
    assert!(output.status.success(), "{}", printed(&output));
    assert!(printed(&output).contains("its stop.json cannot be read"), "{}", printed(&output));
    let frames = std::fs::read(out.join("frames.csv")).expect("a table");
    assert_eq!(frames, std::fs::read(made.run.join("frames.csv")).expect("a table"));

    let recovered = made.runs(&["recover"]);
    assert!(recovered.status.success(), "{}", printed(&recovered));
    let entries = std::fs::read_dir(&made.run).expect("a folder");
    let names: Vec<_> =
        entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("text")).collect();
    let aside = names.iter().find(|name| name.starts_with("stop.json-damaged-")).expect("it is kept");
    assert!(printed(&recovered).contains(aside.as_str()), "{}", printed(&recovered));
    assert_eq!(std::fs::read(made.run.join(aside)).expect("a file"), garbled);
    let stop = json(&made.run.join("stop.json"));
    assert_eq!((&stop["status"], &stop["images"]), (&"success".into(), &made.images.into()), "{stop}");
    assert!(printed(&made.runs(&["verify"])).contains("sound"));
    // a file that had been damaged before stays known as such
    made.put("stop.json", garbled);
    made.put("journal.jsonl", b"");
    made.runs(&["recover"]);
    let found = made.runs(&["verify"]);
    assert_eq!(found.status.code(), Some(4), "{}", printed(&found));
    assert!(printed(&found).contains("journal.jsonl is not what was written"), "{}", printed(&found));
}

#[test]
fn checksums_that_list_nothing_or_not_all_do_not_verify() {
    let _turn = in_real_time();
    let made = Made::new(|_| {});
    let sums = std::fs::read_to_string(made.run.join("SHA256SUMS")).expect("the sums");
    let without = |names: &[&str]| -> String {
        let kept = |line: &&str| !names.iter().any(|name| line.ends_with(&format!("  {name}")));
        sums.lines().filter(kept).map(|line| format!("{line}\n")).collect()
    };
    for (text, says) in [
        (String::new(), "no line for start.json, stop.json, journal.jsonl, recording.mcap, model-start.xml"),
        (without(&[RECORDING]), "no line for recording.mcap"),
        (without(&["stop.json", "trajectory.csv"]), "no line for stop.json"),
    ] {
        made.put("SHA256SUMS", text.as_bytes());
        let found = made.runs(&["verify"]);
        assert_eq!(found.status.code(), Some(4), "{}", printed(&found));
        assert!(printed(&found).contains(says), "{says}: {}", printed(&found));
    }
    // an analysis that was killed before it wrote them
    made.put("SHA256SUMS", without(&["report.html", "trajectory.csv"]).as_bytes());
    let found = made.runs(&["verify", "--json"]);
    assert!(printed(&found).contains("\"verdict\":\"incomplete\""), "{}", printed(&found));
    made.put("SHA256SUMS", sums.as_bytes());
    assert!(printed(&made.runs(&["verify"])).contains("sound"));
}

#[test]
fn tables_of_a_run_appear_whole_or_not_at_all() {
    let _turn = in_real_time();
    let made = Made::new(|_| {});
    let out = made.runs.with_file_name("replayed");
    let mut shim = Shim::before(&out);
    let replay = rig(["replay".as_ref(), made.run.as_os_str(), "--out".as_ref(), out.as_os_str()]);
    let output = shim.with(replay, Order::Count).output().expect("rig starts");
    assert!(output.status.success(), "{}", printed(&output));
    let events = shim.events();
    for name in
        ["frames.csv", "servo.csv", "trajectory.csv", "simulated.csv", "fit.json", "report.html", "stop.json"]
    {
        let renamed = events.iter().any(|event| event.kind == "rename" && event.path2 == Path::new(name));
        let written = events.iter().any(|event| event.kind == "write" && event.path == Path::new(name));
        assert!(renamed && !written, "{name}: {events:?}");
    }
}

/// A camera that loses a good part of the images while the mechanism moves.
fn intermittent(config: &mut toml::Table) {
    let fault: toml::Table = "at_s = 1.0\nkind = \"camera-intermittent\"".parse().expect("a table");
    set(config, "mock", "faults", toml::Value::Array(vec![fault.into()]));
}

#[test]
fn run_that_lost_too_many_images_is_degraded_and_promoted_nowhere() {
    let _turn = in_real_time();
    let bench = Bench::quiet();
    bench.change(|config| {
        short(config);
        intermittent(config);
    });
    let _daemon = bench.start(&[]);
    bench.add_run();
    bench.wait(1, &["done"], 120.0);
    // what follows from it
    let line = bench.wait(2, &["done"], 60.0);
    assert!(line.contains("recalibrate") && line.contains("kept"), "{line}");
    let run = only_run(&bench.runs).expect("a run");
    let stop = json(&run.join("stop.json"));
    assert!(stop["status"] == "success" && stop["images_lost"].as_u64() > Some(3), "{stop}");
    let kept = json(&run.join("recalibration.json"));
    assert_eq!((&kept["updated"], &kept["degraded"]), (&false.into(), &true.into()), "{kept}");
    assert!(!bench.runs.join("last-good").exists());
    let journal = bench.journal();
    let alerts: Vec<&str> = journal.lines().filter(|line| line.contains("\"alert\"")).collect();
    assert!(alerts.len() == 1 && alerts[0].contains("images-lost"), "{alerts:?}");

    let listed = printed(&run_rig(["runs", "ls", "--runs-dir", bench.runs.to_str().expect("readable")]));
    assert!(
        listed.contains(&format!("  {}  ", stop["images_lost"])) && listed.contains("degraded: "),
        "{listed}"
    );
    let recalibrate =
        ["recalibrate".as_ref(), run.as_os_str(), "--runs-dir".as_ref(), bench.runs.as_os_str()];
    let output = rig(recalibrate).arg("--strict").output().expect("rig starts");
    assert_eq!(output.status.code(), Some(4), "{}", printed(&output));
    assert!(printed(&output).contains("max_lost_share"), "{}", printed(&output));
    assert!(!bench.runs.join("last-good").exists());
}

#[test]
fn runs_are_listed_on_a_full_disk() {
    let _turn = in_real_time();
    let made = Made::new(|_| {});
    let list = || rig(["runs".as_ref(), "ls".as_ref(), "--runs-dir".as_ref(), made.runs.as_os_str()]);
    let mut shim = Shim::before(&made.runs);
    let mut lists = |why: &str| {
        let output = shim.with(list(), Order::Full(1)).output().expect("rig starts");
        let says = printed(&output);
        assert!(output.status.success() && says.contains("success"), "{why}: {says}");
        says
    };
    let says = lists("without an index");
    assert!(says.contains("the runs are read from their folders"), "{says}");
    assert!(list().output().expect("rig starts").status.success());
    // an index that is there, and a run that it does not know yet as it is now
    std::fs::write(made.run.join("notes.txt"), "water was murky").expect("written");
    let says = lists("with an index");
    assert!(says.contains("WARN"), "{says}");
}
