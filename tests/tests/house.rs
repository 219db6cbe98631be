//! The house keeps its shape: within a crate, rooms (the modules that its `lib.rs` names) use each other one way. A scan of
//! the text for paths that start with `crate::`. And whoever writes a file does it by a handle, for which it had to ask.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// For each room, the rooms it uses.
type Arrows = BTreeMap<String, BTreeSet<String>>;

fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let mut files = Vec::new();
    for path in entries {
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            files.push(path);
        }
    }
    // What tests use is no arrow of the house.
    files.retain(|file| !file.iter().any(|part| part == "tests" || part == "tests.rs"));
    files
}

/// The code of a file without its comments and without its test module.
fn code(file: &Path) -> String {
    let text = std::fs::read_to_string(file).expect("a file of text");
    let modules =
        ["", "pub(super) ", "pub(crate) "].map(|seen_by| format!("#[cfg(test)]\n{seen_by}mod tests {{"));
    let tests = modules.iter().filter_map(|module| text.find(module));
    let end = tests.min().unwrap_or(text.len());
    text[..end].lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

fn is_word(letter: char) -> bool {
    letter.is_alphanumeric() || letter == '_'
}

/// The first names of all paths in `code` that start with `crate::`, those in braces one by one.
fn first_names(code: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for after in code.split("crate::").skip(1) {
        let Some(group) = after.strip_prefix('{') else {
            names.extend(after.split(|letter| !is_word(letter)).next().map(str::to_owned));
            continue;
        };
        let (mut depth, mut first) = (1, true);
        for (at, letter) in group.char_indices() {
            match letter {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 1 => first = true,
                _ if is_word(letter) && first => {
                    names.extend(group[at..].split(|letter| !is_word(letter)).next().map(str::to_owned));
                    first = false;
                }
                _ => {}
            }
            if depth == 0 {
                break;
            }
        }
    }
    names
}

/// The room that each name which `lib.rs` hands on comes from, and each room by its own name.
fn homes(lib: &str, rooms: &BTreeSet<String>) -> BTreeMap<String, String> {
    let mut homes: BTreeMap<String, String> = rooms.iter().map(|room| (room.clone(), room.clone())).collect();
    for handed_on in lib.split("pub use ").skip(1).filter_map(|rest| rest.split(';').next()) {
        let mut names = handed_on.split(|letter| !is_word(letter)).filter(|name| !name.is_empty());
        let Some(room) = names.next() else { continue };
        for name in names {
            homes.entry(name.into()).or_insert_with(|| room.into());
        }
    }
    homes
}

fn arrows(source: &Path) -> Arrows {
    let files = sources(source);
    let room = |file: &Path| -> Option<String> {
        let first = file.strip_prefix(source).ok()?.iter().next()?.to_str()?;
        Some(first.trim_end_matches(".rs").to_owned()).filter(|room| room != "lib" && room != "main")
    };
    let rooms: BTreeSet<String> = files.iter().filter_map(|file| room(file)).collect();
    let homes = homes(&code(&source.join("lib.rs")), &rooms);
    let mut arrows = Arrows::new();
    for file in &files {
        let Some(from) = room(file) else { continue };
        let to = first_names(&code(file)).into_iter().filter_map(|name| homes.get(&name).cloned());
        arrows.entry(from.clone()).or_default().extend(to.filter(|to| *to != from));
    }
    arrows
}

/// The rooms on circles, and between them, with those of them that they use: what is left when rooms that use none that
/// is left, or that none that is left uses, are taken away again and again.
fn tied(mut arrows: Arrows) -> Arrows {
    loop {
        let rooms = arrows.len();
        let using: BTreeSet<String> = arrows.keys().cloned().collect();
        arrows.values_mut().for_each(|uses| uses.retain(|used| using.contains(used)));
        let used: BTreeSet<String> = arrows.values().flatten().cloned().collect();
        arrows.retain(|room, uses| !uses.is_empty() && used.contains(room));
        if arrows.len() == rooms {
            return arrows;
        }
    }
}

#[test]
fn rooms_of_a_crate_use_each_other_one_way() {
    let house = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut circles = BTreeMap::new();
    for crate_name in ["firmware-protocol", "sim", "ident", "rig"] {
        let arrows = arrows(&house.join(crate_name).join("src"));
        assert!(arrows.len() > 3, "{crate_name}: found only the rooms {:?}", arrows.keys());
        circles.insert(crate_name, tied(arrows));
    }
    circles.retain(|_, tied| !tied.is_empty());
    assert!(circles.is_empty(), "rooms in a circle, and which of each other they use: {circles:#?}");
}

/// What writes a file that a path names.
const WRITERS: [&str; 6] =
    ["fs::write(", "File::create", "fs::copy(", ".save(", "write_whole(", "OpenOptions"];

/// Who of `rig` does so, and what for; all others write by an `OutputFile`, an `OutputFolder` or a run's own `RunFolder`.
const WRITE_BY_PATH: [(&str, &str); 9] = [
    ("record/", "a run's own files"),
    ("outputs/", "the handles"),
    ("claim.rs", "what one process has alone"),
    ("in_place.rs", "what a full disk must not refuse"),
    ("servo/pulse_log.rs", "a log that grows while another process reads it"),
    ("doctor/host.rs", "a file to try the disk with"),
    ("daemon/child.rs", "what a job prints"),
    ("daemon/api/token.rs", "a secret that is made once"),
    ("urgency.rs", "a switch of the system"),
];

#[test]
fn results_are_written_by_handles_that_had_to_be_asked_for() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("rig/src");
    let may = |file: &Path| {
        let name = file.strip_prefix(&source).unwrap().to_str().unwrap();
        WRITE_BY_PATH.iter().find(|(place, _)| name.starts_with(place))
    };
    let (mut allowed, mut forbidden) = (BTreeSet::new(), Vec::new());
    for file in sources(&source) {
        let code = code(&file);
        for writer in WRITERS.iter().filter(|writer| code.contains(**writer)) {
            match may(&file) {
                Some((place, _)) => drop(allowed.insert(*place)),
                None => forbidden.push(format!("{writer} in {}", file.display())),
            }
        }
    }
    assert!(forbidden.is_empty(), "ask `Outputs` for a handle instead: {forbidden:#?}");
    assert_eq!(allowed.len(), WRITE_BY_PATH.len(), "of those who may only these do: {allowed:?}");
}

#[test]
fn a_circle_is_found() {
    let uses = |pairs: &[(&str, &[&str])]| -> Arrows {
        let rooms = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        pairs.iter().map(|(from, to)| ((*from).to_owned(), rooms(to))).collect()
    };
    assert!(tied(uses(&[("a", &["b", "c"]), ("b", &["c"]), ("c", &[])])).is_empty());
    assert_eq!(tied(uses(&[("a", &["b"]), ("b", &["c"]), ("c", &["b"]), ("d", &["c"])])).len(), 2);
    let names = first_names("use crate::{one, two::{Three, four}}; crate::five::six(); use other::seven;");
    assert_eq!(names.into_iter().collect::<Vec<_>>(), ["five", "one", "two"]);
}
