//! The book of `docs/` builds, its links lead somewhere, and what its pages tell people to type can be typed: most of it is.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command as Process, Output};

use mdbook_driver::MDBook;
use system_tests::book::checks::{Help, refused_arguments, wrong_for_cargo};
use system_tests::book::commands::{Command, blocks, commands, mentions};
use system_tests::book::links::follow;
use system_tests::{changed_config, in_real_time, only_run, printed, repository, rig, set};

/// What is not run here, by how it begins, and why. Arguments of `rig` and `cargo` are checked all the same, and files must be there.
const NOT_RUN: &[(&str, &str)] = &[
    ("scripts/demo", "builds a release, minutes"),
    ("scripts/test", "runs these tests"),
    ("rig campaign", "half a minute a run; campaign runs it"),
    ("rig study", "minutes of fits, of runs that were filmed before; study runs all of its verbs"),
    ("export PATH=", "names the release that scripts/demo builds"),
    ("cargo ", "minutes long; tests of the same name go through a part"),
    ("python3 rig/python/benchmarks/rollout.py", "needs the package, and a computer that is free for it"),
    ("rig run mine/rig.toml", "as the drops before it; cli makes such a rig and has its doctor look"),
    ("rig run configs/arm8.toml", "in_mujoco runs it, 11 s of film"),
    ("rig run configs/octopus8.toml", "half a minute of film"),
    ("rig extract film.mp4", "films need ffmpeg; own_film runs it where there is one"),
    ("rig fit mine-fit.toml", "of that film"),
    ("rig diagnose mine-fit.toml", "of that film"),
    (
        "rig replay runs/20261120T101503Z-ab12cd --config rig.toml",
        "needs SAM 2's graphs; rig/tests/all/sam2.rs has some",
    ),
    ("rig fit fish/", "needs the markers; the test fish runs it where they are"),
    ("rig diagnose fish/", "needs the markers, and minutes"),
    ("python3 scripts/real-drives/independent.py", "needs numpy, scipy and a compiler"),
    ("rig fit dp/", "minutes; ident's drives runs the same laws"),
    ("python3 scripts/real-drives/double_pendulum_scores.py", "needs those fits"),
    ("rig daemon", "serves until it is ended; daemon and daemon_api run it"),
    ("rig calibrate camera", "needs pictures of a board; calibrate and aprilgrid draw some and run it"),
    ("rig calibrate servo", "half a minute of film; calibrate_servo runs it"),
    ("rig calibrate latency", "needs an LED in view; one_clock runs it"),
    ("rig firmware flash", "needs a board"),
    ("firmware-protocol/uno/build", "needs avr-gcc; the tests of firmware-protocol run it where it is"),
    ("avrdude ", "needs a board"),
    ("sudo apt-get", "installs"),
    ("pip install", "installs"),
    ("git clone", "needs a network"),
    ("scripts/paper-recipe", "needs films of minutes, and scikit-image"),
    ("python3 scripts/in-mujoco.py", "needs MuJoCo and a driven run; in_mujoco runs it"),
    ("python3 tests/cases/", "needs MuJoCo, and hours; cases makes one and tests the judge"),
    ("python3 \"$RIG_SHARED/", "measures MuJoCo, minutes"),
    ("scripts/fuzz", "builds everything with its engine, minutes; fuzz_slice meets the same targets"),
    ("scripts/package", "builds a release, minutes"),
    ("printf '\\n[schedule]", "changes the system; scripts/package-test does it in a root of its own"),
    ("sudo ", "changes the system; scripts/package-test does the same in a root of its own"),
    ("systemctl status", "needs the service; scripts/package-test starts it"),
    ("journalctl ", "needs the service; scripts/package-test starts it"),
];

/// The pages whose commands are gone through, in the order in which a stranger reads them.
fn pages() -> Vec<PathBuf> {
    let summary = std::fs::read_to_string(repository().join("docs/SUMMARY.md")).expect("the summary");
    let named = summary.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    let pages = named.filter(|name| !name.is_empty()).map(|name| repository().join("docs").join(name));
    ["README.md", "configs/README.md"].map(|name| repository().join(name)).into_iter().chain(pages).collect()
}

fn name(page: &Path) -> String {
    page.strip_prefix(repository()).expect("in the repository").display().to_string()
}

#[test]
fn book_builds_and_its_links_lead_somewhere() {
    let folder = tempfile::tempdir().expect("a folder");
    let docs = repository().join("docs");
    let mut book = MDBook::load(&docs).expect("a book");
    let stands = docs.join(&book.config.build.build_dir);
    book.config.build.build_dir = folder.path().into();
    book.build().expect("the book builds");
    let links = follow(folder.path(), &stands).expect("the pages can be read");
    assert!(links.broken.is_empty(), "{:#?}", links.broken);
    assert!(links.sound > 900, "only {} links were found", links.sound);
    let wrong =
        links.elsewhere.iter().find(|link| !link.starts_with("https://") && !link.contains("127.0.0.1"));
    assert_eq!(wrong, None);
    println!("{} links lead somewhere; not followed: {:#?}", links.sound, links.elsewhere);

    let summary = std::fs::read_to_string(docs.join("SUMMARY.md")).expect("the summary");
    for entry in std::fs::read_dir(docs).expect("the folder") {
        let page = entry.expect("an entry").file_name().into_string().expect("a readable name");
        let is_chapter = page.ends_with(".md") && page != "SUMMARY.md";
        assert!(!is_chapter || summary.contains(&format!("]({page})")), "SUMMARY.md leaves out {page}");
    }
}

#[test]
fn links_hold_where_the_pages_are_read_as_they_are() {
    for page in pages() {
        let text = std::fs::read_to_string(&page).expect("a page");
        let links = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
        for link in links.filter(|link| !link.contains("://") && !link.starts_with('#')) {
            let file = link.split('#').next().unwrap_or_default();
            assert!(page.with_file_name(file).exists(), "{}: {link} is not there", name(&page));
        }
    }
}

#[test]
fn wire_protocol_has_every_code() {
    use firmware_protocol::{channel, event};
    let page = std::fs::read_to_string(repository().join("docs/wire-protocol.md")).expect("the page");
    let mut rows = Vec::new();
    macro_rules! rows {
        ($($kind:ty),*) => { $(rows.extend(<$kind>::ALL.iter().map(|code| (code.code(), code.text())));)* };
    }
    rows!(
        channel::ChannelKind,
        channel::SafeState,
        event::State,
        event::Fault,
        event::Occurrence,
        event::Refusal
    );
    assert!(rows.len() > 40, "{rows:?}");
    for (code, text) in rows {
        let text = text.split(';').next().unwrap_or_default();
        let listed = [format!("{code:02x} {text}"), format!("| {code:02x} | {text}")];
        assert!(listed.iter().any(|row| page.contains(row.as_str())), "no {code:02x} {text}");
    }
}

#[test]
fn traits_are_as_the_page_on_devices_has_them() {
    let source = ["rig/servo/src/lib.rs", "rig/camera/src/lib.rs"]
        .map(|file| std::fs::read_to_string(repository().join(file)).expect("a source"))
        .concat();
    let blocks = blocks(&repository().join("docs/devices.md")).expect("the page");
    let lines: Vec<&str> =
        blocks.iter().filter(|block| block.language == "rust").flat_map(|block| block.text.lines()).collect();
    assert!(lines.iter().filter(|line| line.contains("fn ")).count() >= 9, "{lines:?}");
    for line in lines {
        assert!(source.contains(line), "no longer so: {line}");
    }
}

/// A folder in which the pages' commands find what they name.
struct Workshop {
    folder: tempfile::TempDir,
    /// The commands that made its runs.
    made_by: Vec<String>,
}

impl Workshop {
    /// Copies configs, films two drops as [first-run.md](../../docs/first-run.md) says, only shorter, and puts beside them what else
    /// is named.
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let base = folder.path();
        copy(&repository().join("configs"), &base.join("configs"));
        let mut made_by = Vec::new();
        for (shipped, run) in
            [("chain-passive-horizontal.toml", "A"), ("chain-passive-right-angle.toml", "B")]
        {
            let short = changed_config(shipped, base, |config| {
                set(config, "run", "film_s", 1.5);
                set(config, "run", "diagnose", false);
                set(config, "diagnose", "limit_s", 2.0);
            });
            std::fs::rename(short, base.join("configs").join(shipped)).expect("a short config");
            let typed = format!("rig run configs/{shipped}");
            let output = shell(&typed, base);
            assert!(output.status.success(), "{}", printed(&output));
            let made = only_run(&base.join("runs")).expect("a run folder");
            std::fs::rename(made, base.join(run)).expect("moved");
            made_by.push(typed);
        }
        let runs = base.join("runs");
        for run in ["A", "B"] {
            std::fs::rename(base.join(run), runs.join(run)).expect("moved");
        }
        link(&runs.join("A"), &runs.join("20261120T101503Z-ab12cd"));
        // A third run, but for its name the second one.
        copy(&runs.join("B"), &runs.join("C"));
        let start = std::fs::read_to_string(runs.join("B/start.json")).expect("the start");
        let id = system_tests::json(&runs.join("B/start.json"))["id"].as_str().expect("an id").to_owned();
        std::fs::write(runs.join("C/start.json"), start.replace(&id, "20261120T101503Z-third0"))
            .expect("written");
        Self { folder, made_by }
    }

    /// A folder of its own for a page's commands.
    fn room(&self, page: &str) -> PathBuf {
        let base = self.folder.path();
        let room = base.join(page.replace('/', "-"));
        std::fs::create_dir(&room).expect("a folder");
        copy(&base.join("configs"), &room.join("configs"));
        std::fs::create_dir(room.join("runs")).expect("a folder");
        for run in ["A", "B", "C", "20261120T101503Z-ab12cd"] {
            link(&base.join("runs").join(run), &room.join("runs").join(run));
        }
        link(&base.join("runs/A"), &room.join("RUN"));
        link(&repository().join("scripts"), &room.join("scripts"));
        let config = changed_config("chain-passive-horizontal.toml", &room, |_| {});
        std::fs::rename(config, room.join("CONFIG")).expect("moved");
        let calibration =
            "[camera]\nfps = 100.0\n[calibration]\nmetres_per_pixel = 0.00025\norigin_px = [320, 60]\n";
        std::fs::write(room.join("mine.toml"), calibration).expect("written");
        let mut tracked = String::from(
            "scorer,me,me,me,me,me,me,me,me,me\nbodyparts,base,base,base,elbow,elbow,elbow,tip,tip,tip\n",
        );
        tracked += "coords,x,y,likelihood,x,y,likelihood,x,y,likelihood\n";
        for image in 0..5 {
            tracked += &format!("{image},320,60,1,{},160,0.9,{},260,0.95\n", 330 + image, 340 + 2 * image);
        }
        std::fs::write(room.join("tracked.csv"), tracked).expect("written");
        room
    }
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir(to).expect("a folder");
    for entry in std::fs::read_dir(from).expect("a folder") {
        let path = entry.expect("an entry").path();
        let copied = to.join(path.file_name().expect("a name"));
        if path.is_dir() {
            copy(&path, &copied);
        } else {
            std::fs::copy(&path, &copied).expect("copied");
        }
    }
}

fn link(to: &Path, at: &Path) {
    std::os::unix::fs::symlink(to, at).expect("a link");
}

/// The environment's `PATH` with the `rig` of this build in front.
fn path() -> std::ffi::OsString {
    let program = rig::<[&str; 0], &str>([]).get_program().to_owned();
    let mut folders = vec![Path::new(&program).parent().expect("a folder").to_owned()];
    folders.extend(std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()));
    std::env::join_paths(folders).expect("folders without colons")
}

/// Runs what a page tells people to type.
fn shell(typed: &str, folder: &Path) -> Output {
    let mut shell = Process::new("sh");
    shell.args(["-euc", typed]).current_dir(folder).env("PATH", path()).stdin(std::process::Stdio::null());
    shell.output().expect("sh starts")
}

/// What a command that is not run must name rightly.
fn wrong(command: &Command) -> Option<String> {
    let words = command.words();
    let (program, arguments) = words.split_first()?;
    match program.as_str() {
        "rig" => refused_arguments(arguments),
        "cargo" => wrong_for_cargo(arguments),
        "python3" => arguments
            .first()
            .filter(|file| !file.starts_with('$') && !repository().join(file).exists())
            .map(|file| format!("no {file}")),
        script if script.contains('/') => {
            (!repository().join(script).exists()).then(|| format!("no {script}"))
        }
        _ => None,
    }
}

#[test]
fn commands_of_the_pages_run() {
    let _turn = in_real_time();
    let workshop = Workshop::new();
    let (mut run, mut checked, mut untried) = (0, 0, BTreeMap::new());
    let mut used = vec![false; NOT_RUN.len()];
    let mut wrongs = Vec::new();
    for page in pages() {
        let mut room = None;
        for block in blocks(&page).expect("a page").iter().filter(|block| block.language == "sh") {
            for command in commands(&name(&page), block) {
                let place = format!("{}:{}: {}", command.page, command.line, command.text);
                if workshop.made_by.contains(&command.text) {
                    run += 1;
                    continue;
                }
                let reason = NOT_RUN.iter().position(|(start, _)| {
                    command.text.starts_with(start) || command.words().join(" ").starts_with(start)
                });
                if let Some(reason) = reason {
                    used[reason] = true;
                    wrongs.extend(wrong(&command).map(|why| format!("{place}: {why}")));
                    if ["rig", "cargo"].contains(&command.words()[0].as_str()) {
                        checked += 1;
                    } else {
                        untried.insert(place, NOT_RUN[reason].1);
                    }
                    continue;
                }
                let room = room.get_or_insert_with(|| workshop.room(&name(&page)));
                let output = shell(&command.text, room);
                if !output.status.success() {
                    wrongs.push(format!("{place}: {}", printed(&output)));
                }
                run += 1;
            }
        }
    }
    assert!(wrongs.is_empty(), "{}", wrongs.join("\n"));
    let idle: Vec<_> =
        NOT_RUN.iter().zip(&used).filter(|(_, used)| !**used).map(|(rule, _)| rule.0).collect();
    assert!(idle.is_empty(), "reasons for commands that no page has: {idle:?}");
    assert!(run >= 20, "only {run} commands were run");
    println!("{run} commands were run, {checked} had their arguments checked; neither: {untried:#?}");
}

#[test]
fn verbs_and_options_in_running_text_are_there() {
    let mut help = Help::default();
    let (mut looked_up, mut wrongs) = (0, Vec::new());
    for page in pages() {
        let page_name = name(&page);
        for words in mentions(&page, "rig").expect("a page") {
            looked_up += 1;
            wrongs
                .extend(help.wrong(&words).map(|why| format!("{page_name}: rig {}: {why}", words.join(" "))));
        }
        for words in mentions(&page, "cargo").expect("a page") {
            looked_up += 1;
            wrongs.extend(
                wrong_for_cargo(&words).map(|why| format!("{page_name}: cargo {}: {why}", words.join(" "))),
            );
        }
    }
    assert!(wrongs.is_empty(), "{}", wrongs.join("\n"));
    assert!(looked_up > 60, "only {looked_up} commands in running text");
    println!("{looked_up} commands in running text have verbs, options, examples and tests that are there");
}
