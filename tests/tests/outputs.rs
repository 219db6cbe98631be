//! No output is an input or lies in a run folder: each verb that writes refuses it before it does any work. And what is written is there
//! whole, or as it was before.

use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use camera::calibration::Plane;
use clap::CommandFactory as _;
use system_tests::storage::{Order, Phase, Shim};
use system_tests::{changed_config, printed, rig};
use tank::render::{Look, Renderer};

const RUN: &str = "runs/20261120T101503Z-ab12cd";

const START: &str = r#"{"id":"20261120T101503Z-ab12cd","kind":"driven","model":"model-start.xml","prescribed":false,
"clock":{"monotonic_ns":0,"utc":"2026-11-20T10:15:03Z"},"version":"0.1.0","config":""}"#;

/// Names all that a config may name.
const EXTRACTION: &str = r#"
[run]
model = "model.xml"
[camera]
fps = 50
[calibration]
file = "camera.toml"
[vision]
static_mask = "mask.png"
background = "empty.png"
sam2 = { weights = "graphs", clicks = [] }
[[servo.channel]]
calibration = "servo.toml"
"#;

const EXPERIMENT: &str = r#"
model = "model.xml"
[[run]]
id = "own"
kind = "driven"
trajectory = "t.csv"
servo = "servo.csv"
base = "base.csv"
[[run]]
folder = "runs/20261120T101503Z-ab12cd"
"#;

/// All that verbs read. What is refused before any work needs no sense in it.
fn bench() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    for name in [RUN, "pictures", "original", "graphs", "fitted", "earlier", "made/next"] {
        std::fs::create_dir_all(at(name)).expect("a folder");
    }
    let files = [
        ("extract.toml", EXTRACTION),
        ("made/next/driven-4.toml", EXTRACTION),
        ("driven-1.toml", EXTRACTION),
        ("e.toml", EXPERIMENT),
        ("study.toml", "[[experiment]]\npaths = [\"e.toml\"]\n"),
        ("t.csv", "time_s,P1_x_m,P1_z_m\n0,0.1,0.2\n"),
    ];
    for (name, text) in files {
        std::fs::write(at(name), text).expect("written");
    }
    let senseless = [
        "film.mkv",
        "model.xml",
        "mask.png",
        "empty.png",
        "camera.toml",
        "servo.toml",
        "servo.csv",
        "base.csv",
        "tracked.csv",
        "tracked.csv.frames.csv",
        "times.csv",
        "graphs/decoder.onnx",
        "pictures/0000.png",
        "original/0001.png",
        "fitted/model.xml",
        "earlier/fit.json",
    ];
    for name in senseless {
        std::fs::write(at(name), name).expect("written");
    }
    let run = at(RUN);
    std::fs::write(run.join("start.json"), START).expect("written");
    for name in ["journal.jsonl", "recording.mcap", "trajectory.csv", "model.xml", "servo.toml", "rig.toml"] {
        std::fs::write(run.join(name), name).expect("written");
    }
    symlink(at("original/0001.png"), at("pictures/0001.png")).expect("a link");
    symlink("film.mkv", at("soft.csv")).expect("a link");
    symlink("film.mkv", at("linked.csv.frames.csv")).expect("a link");
    symlink(RUN, at("last")).expect("a link");
    std::fs::hard_link(at("film.mkv"), at("hard.csv")).expect("a link");
    changed_config("chain-driven-pose-1.toml", folder.path(), |_| {});
    folder
}

/// All files and folders, with what is in them.
fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut tree = BTreeMap::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() && !path.is_symlink() {
            tree.append(&mut self::tree(&path));
            tree.insert(path, Vec::new());
        } else {
            let content = std::fs::read(&path).unwrap_or_default();
            tree.insert(path, content);
        }
    }
    tree
}

/// A command that is refused, and what it is told.
type Case = (&'static str, &'static str);

const INPUT: &str = "is the input";
const IN_INPUT: &str = "lies in the input";
const HOLDS: &str = "is a folder that holds the input";
const IN_RUN: &str = "lies in the run folder";
const TWICE: &str = "would take each other's place";

/// Everything that a user may give as an output and should not. `FILM` stands for an extraction of the film, `RUN` for a run folder.
const CASES: &[Case] = &[
    ("FILM --out film.mkv", INPUT),
    ("FILM --out ./film.mkv", INPUT),
    ("FILM --out nowhere/../film.mkv", INPUT),
    ("FILM --out soft.csv", INPUT),
    ("FILM --out hard.csv", INPUT),
    ("FILM --out linked.csv", INPUT),
    ("FILM --out extract.toml", INPUT),
    ("FILM --out model.xml", INPUT),
    ("FILM --out mask.png", INPUT),
    ("FILM --out empty.png", INPUT),
    ("FILM --out camera.toml", INPUT),
    ("FILM --out servo.toml", INPUT),
    ("FILM --out graphs/decoder.onnx", INPUT),
    ("FILM --out RUN/start.json", IN_RUN),
    ("FILM --out RUN/new/t.csv", IN_RUN),
    ("FILM --out last/t.csv", IN_RUN),
    ("FILM --out made", "is a folder: give the name of a file"),
    ("FILM --out /dev/null", "is a device or a pipe"),
    ("FILM --out new.csv --overlays film.mkv", INPUT),
    ("FILM --out new.csv --overlays .", HOLDS),
    ("FILM --out new.csv --overlays RUN/look", IN_RUN),
    ("FILM --out new.csv --overlays RUN/look.mp4", IN_RUN),
    ("FILM --out look/new.csv --overlays look", TWICE),
    ("FILM --out new.csv --centreline film.mkv", INPUT),
    ("FILM --out new.csv --centreline nowhere/../new.csv", TWICE),
    ("FILM --out new.csv --contact-sheet mask.png", INPUT),
    ("FILM --out new.csv --contact-sheet new.csv.frames.csv", TWICE),
    ("extract pictures --config extract.toml --out new.csv --overlays pictures", INPUT),
    ("extract pictures --config extract.toml --out new.csv --overlays original", HOLDS),
    ("extract pictures --config extract.toml --out pictures/0000.png", IN_INPUT),
    ("extract pictures --config extract.toml --out pictures/t.csv", IN_INPUT),
    ("extract pictures --config extract.toml --out original/0001.png", INPUT),
    ("extract RUN --config extract.toml --out RUN/trajectory.csv", IN_INPUT),
    ("import dlc tracked.csv --config extract.toml --out tracked.csv", INPUT),
    ("import dlc tracked.csv --config extract.toml --out tracked.csv.frames.csv", INPUT),
    ("import dlc tracked.csv --config extract.toml --times times.csv --out times.csv", INPUT),
    ("import dlc tracked.csv --config extract.toml --model model.xml --out model.xml", INPUT),
    ("import dlc tracked.csv --config extract.toml --out extract.toml", INPUT),
    ("import dlc tracked.csv --config extract.toml --out RUN/t.csv", IN_RUN),
    ("simulate model.xml --out model.xml", INPUT),
    ("simulate model.xml --servo servo.csv --out servo.csv", INPUT),
    ("simulate model.xml --base base.csv --out made/../base.csv", INPUT),
    ("simulate model.xml --out RUN/o.csv", IN_RUN),
    ("export csv RUN --out RUN/start.json", IN_RUN),
    ("export csv RUN --out last/start.json", IN_RUN),
    ("export csv t.csv --out t.csv", INPUT),
    ("export mjcf fitted --out fitted/model.xml", INPUT),
    ("export mjcf RUN --out RUN/for-mujoco.xml", IN_RUN),
    ("export mcap RUN --out RUN/run.mcap", IN_INPUT),
    ("export bluesky RUN --out RUN/documents.jsonl", IN_INPUT),
    ("export dlc t.csv --config extract.toml --out extract.toml", INPUT),
    ("export dlc t.csv --config extract.toml --out camera.toml", INPUT),
    ("export wcon t.csv --out t.csv", INPUT),
    ("experiment RUN --out RUN/e.toml", IN_INPUT),
    ("experiment RUN --model model.xml --out model.xml", INPUT),
    ("fit e.toml --out .", HOLDS),
    ("fit e.toml --out RUN", IN_RUN),
    ("fit e.toml --out RUN/fitted", IN_RUN),
    ("fit e.toml --out runs", HOLDS),
    ("fit e.toml --out film.mkv", "is a file: give the name of a folder"),
    ("fit e.toml --prior earlier/fit.json --out earlier", HOLDS),
    ("diagnose e.toml --out .", HOLDS),
    ("diagnose e.toml --out last", IN_RUN),
    ("diagnose e.toml --config made/next/driven-4.toml --out made", HOLDS),
    ("design e.toml --config driven-1.toml --out .", HOLDS),
    ("design e.toml --config driven-1.toml --out RUN", IN_RUN),
    ("replay RUN --out RUN", IN_RUN),
    ("replay RUN --out last", IN_RUN),
    ("replay RUN --out RUN/again", IN_RUN),
    ("replay RUN --out runs", HOLDS),
    ("replay RUN --out new --overlay RUN/film.mp4", IN_INPUT),
    ("replay RUN --out new --overlay new/report.html", TWICE),
    (
        "calibrate camera pictures --board chessboard:5x4:0.02 --origin-px 1,1 --out pictures/0000.png",
        IN_INPUT,
    ),
    ("calibrate camera empty.png --board chessboard:5x4:0.02 --origin-px 1,1 --out empty.png", INPUT),
    ("calibrate latency rig.toml --write RUN/rig.toml", IN_RUN),
    ("calibrate servo RUN --write RUN/servo.toml", IN_RUN),
    ("preview RUN/rig.toml", IN_RUN),
    ("new RUN/mine --mock", IN_RUN),
    ("campaign rig.toml --resolve --out RUN", IN_RUN),
    ("campaign rig.toml --resolve --out RUN/campaign", IN_RUN),
    ("study study.toml --out RUN", IN_RUN),
    ("study study.toml --out RUN/study", IN_RUN),
    ("mock-board --tank RUN", IN_RUN),
    ("packaging RUN/packaging", IN_RUN),
];

fn words(line: &str) -> Vec<String> {
    let line = line.replace("FILM", "extract film.mkv --config extract.toml --model model.xml");
    line.replace("RUN", RUN).split(' ').map(str::to_owned).collect()
}

#[test]
fn an_output_that_is_an_input_or_in_a_run_folder_is_refused_before_any_work() {
    let folder = bench();
    let before = tree(folder.path());
    for (line, wanted) in CASES {
        let output = rig(words(line)).current_dir(folder.path()).output().expect("rig starts");
        let said = printed(&output);
        assert_eq!(output.status.code(), Some(2), "rig {line}: {said}");
        assert!(said.contains(wanted), "rig {line}: {wanted:?} is not in {said}");
        assert!(tree(folder.path()) == before, "rig {line} has changed something: {said}");
    }
}

/// Options and arguments that say where to write.
const OUTPUTS: [&str; 7] = ["out", "overlays", "overlay", "centreline", "contact_sheet", "write", "dir"];

fn outputs_of(command: &clap::Command, verb: &str, found: &mut BTreeSet<(String, String)>) {
    for argument in command.get_arguments().filter(|one| OUTPUTS.contains(&one.get_id().as_str())) {
        let option = argument.get_long().map_or(String::new(), |long| format!(" --{long} "));
        found.insert((verb.to_owned(), option));
    }
    for under in command.get_subcommands() {
        outputs_of(under, format!("{verb} {}", under.get_name()).trim(), found);
    }
}

#[test]
fn every_verb_that_writes_is_tried() {
    let mut outputs = BTreeSet::new();
    outputs_of(&rig::cli::Cli::command(), "", &mut outputs);
    assert!(outputs.len() > 15, "{outputs:?}");
    let lines: Vec<String> = CASES.iter().map(|(line, _)| words(line).join(" ")).collect();
    outputs
        .retain(|(verb, option)| !lines.iter().any(|line| line.starts_with(verb) && line.contains(option)));
    assert!(outputs.is_empty(), "no case for {outputs:?}");
}

/// Two pictures of a bar 80 px long, and a config for them.
fn film(folder: &Path) {
    let renderer = Renderer::new(Plane::square(0.001, [50.0, 20.0]), Look::plain(100, 130));
    let bar = [[45.0, 20.0], [55.0, 20.0], [55.0, 100.0], [45.0, 100.0]];
    std::fs::create_dir(folder.join("pictures")).expect("a folder");
    for (name, shape) in [("a.png", vec![bar.to_vec()]), ("b.png", vec![]), ("c.png", vec![bar.to_vec()])] {
        renderer.draw_polygons(&shape).save(folder.join("pictures").join(name)).expect("a picture");
    }
    let config = "[camera]\nfps = 20.0\n[calibration]\nmetres_per_pixel = 0.001\norigin_px = [50.0, 20.0]\n\
                  [vision]\nlinks = 2\nmode = \"arc\"\nbase_px = [50.0, 20.0]\n";
    std::fs::write(folder.join("rig.toml"), config).expect("written");
}

#[test]
fn a_full_disk_or_a_kill_leaves_an_output_as_it_was_or_whole() {
    const OUTS: [&str; 5] = ["t.csv", "t.csv.frames.csv", "lines.csv", "sheet.png", "look/a.png"];
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    film(folder.path());
    let mut shim = Shim::before(folder.path());
    let extract = || {
        let line = "extract pictures --config rig.toml --out t.csv --centreline lines.csv --contact-sheet sheet.png --overlays look";
        let mut command = rig(line.split(' '));
        command.current_dir(folder.path());
        command
    };
    // the first one makes the folder too, which is an event
    for _ in 0..2 {
        let output = shim.with(extract(), Order::Count).output().expect("rig starts");
        assert!(output.status.success(), "{}", printed(&output));
    }
    let events = shim.events();
    let whole: Vec<Vec<u8>> = OUTS.iter().map(|name| std::fs::read(at(name)).expect("an output")).collect();
    let old = |name: &str| format!("what {name} was before").into_bytes();
    let names = tree(folder.path()).into_keys().collect::<Vec<_>>();

    let renames: Vec<u64> =
        events.iter().filter(|event| event.kind == "rename").map(|event| event.number).collect();
    assert!(renames.len() > OUTS.len(), "{events:?}");
    let writes: Vec<u64> =
        events.iter().filter(|event| event.kind == "write").map(|event| event.number).collect();
    let orders = writes.iter().map(|&number| Order::Full(number));
    let orders = orders.chain(renames.iter().map(|&number| Order::Kill(number, Phase::Before)));
    let orders = orders.chain(writes.iter().map(|&number| Order::Kill(number, Phase::During)));
    let mut as_before = 0;
    for order in orders {
        for name in OUTS {
            std::fs::write(at(name), old(name)).expect("written");
        }
        let output = shim.with(extract(), order).output().expect("rig starts");
        assert!(!output.status.success(), "{order:?}: {}", printed(&output));
        for (name, whole) in OUTS.iter().zip(&whole) {
            let now = std::fs::read(at(name)).expect("it is there");
            as_before += usize::from(now == old(name));
            assert!(now == old(name) || now == *whole, "{order:?}: {name} is neither old nor new");
        }
        if matches!(order, Order::Full(_)) {
            assert_eq!(tree(folder.path()).into_keys().collect::<Vec<_>>(), names, "{order:?}");
            assert!(printed(&output).contains("No space left on device"), "{}", printed(&output));
        } else {
            for part in tree(folder.path()).into_keys().filter(|path| !names.contains(path)) {
                std::fs::remove_file(part).expect("removed");
            }
        }
    }
    assert!(as_before > OUTS.len(), "{as_before}");
}
