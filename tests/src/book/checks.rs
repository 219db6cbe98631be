//! Whether a command could be typed: programs, verbs, options, examples and tests that are there.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::{printed, repository, rig};

/// Says what is wrong with the arguments of `rig`: whatever its own parser refuses. Tried in an empty folder, so that what is well
/// said ends for want of its files.
pub fn refused_arguments(arguments: &[String]) -> Option<String> {
    let empty = tempfile::tempdir().expect("a folder");
    let output = rig(arguments).current_dir(empty.path()).output().expect("rig starts");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code() == Some(2) && said.starts_with("error: ")).then_some(said)
}

/// The help of verbs, by verb.
#[derive(Debug, Default)]
pub struct Help(BTreeMap<String, Option<String>>);

impl Help {
    fn of(&mut self, verbs: &[&str]) -> Option<&str> {
        let help = self.0.entry(verbs.join(" ")).or_insert_with(|| {
            let output = rig(verbs.iter().chain(&["--help"])).output().expect("rig starts");
            output.status.success().then(|| printed(&output))
        });
        help.as_deref()
    }

    /// Says what is wrong with a part of a command in running text, without the word `rig`: a verb or an option that is not there.
    pub fn wrong(&mut self, words: &[String]) -> Option<String> {
        let verb = words.first()?.as_str();
        let mut verbs = vec![verb];
        let Some(own) = self.of(&verbs) else { return Some(format!("no verb {verb}")) };
        if own.contains("<COMMAND>")
            && let Some(action) = words.get(1).filter(|word| !word.starts_with('-'))
        {
            verbs.push(action);
            if self.of(&verbs).is_none() {
                return Some(format!("no {}", verbs.join(" ")));
            }
        }
        let help = self.of(&verbs).unwrap_or_default();
        let known: Vec<&str> =
            help.split(|letter: char| !(letter.is_alphanumeric() || letter == '-')).collect();
        let option = words.iter().find(|word| word.starts_with("--") && !known.contains(&word.as_str()));
        option.map(|option| format!("{} has no {option}", verbs.join(" ")))
    }
}

/// Where the crates are, by name; `None` for one that is not there.
fn crate_folder(name: &str) -> Option<PathBuf> {
    let folder = if name == "system-tests" { "tests" } else { name };
    let places = ["", "rig", "tests"].map(|room| repository().join(room).join(folder));
    places.into_iter().find(|path| path.join("Cargo.toml").exists())
}

/// The value of `option` among `words`.
fn value<'a>(words: &'a [String], option: &str) -> Option<&'a str> {
    let at = words.iter().position(|word| word == option)?;
    words.get(at + 1).map(String::as_str)
}

/// All Rust sources below `folder`, one after the other.
fn sources(folder: &Path) -> String {
    let Ok(entries) = std::fs::read_dir(folder) else { return String::new() };
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    paths
        .map(|path| match path.extension() {
            _ if path.is_dir() => sources(&path),
            Some(ending) if ending == "rs" => std::fs::read_to_string(&path).unwrap_or_default(),
            _ => String::new(),
        })
        .collect()
}

/// Says what is wrong with the arguments of `cargo`: a package, an example or a test that is not there, an option that no example
/// reads, a name that no test has.
pub fn wrong_for_cargo(words: &[String]) -> Option<String> {
    let mut sides = words.split(|word| word == "--");
    let ours = sides.next().unwrap_or_default();
    let theirs = sides.next().unwrap_or_default();
    let package = value(ours, "-p");
    let folders: Vec<PathBuf> = match package.map(crate_folder) {
        Some(Some(folder)) => vec![folder],
        Some(None) => return Some(format!("no package {package:?}")),
        None => {
            ["firmware-protocol", "sim", "ident", "rig", "tests"].map(|name| repository().join(name)).into()
        }
    };
    if let Some(example) = value(ours, "--example") {
        let file = folders[0].join(format!("examples/{example}.rs"));
        let Ok(mut text) = std::fs::read_to_string(&file) else {
            return Some(format!("no {}", file.display()));
        };
        text += &sources(&folders[0].join("src"));
        let unread = theirs.iter().find(|word| {
            word.strip_prefix("--").is_some_and(|name| {
                let field = format!(" {}:", name.replace('-', "_"));
                !text.contains(&format!("\"{word}\""))
                    && !text.contains(&format!("\"{name}\""))
                    && !text.contains(&field)
            })
        });
        return unread.map(|option| format!("{example} reads no {option}"));
    }
    if let Some(test) = value(ours, "--test") {
        // a file, or a folder of files
        let text = folders.iter().map(|folder| folder.join("tests")).find_map(|tests| {
            let folder = tests.join(test);
            let is_program = folder.join("main.rs").exists();
            std::fs::read_to_string(tests.join(format!("{test}.rs")))
                .ok()
                .or(is_program.then(|| sources(&folder)))
        });
        let Some(text) = text else { return Some(format!("no test {test}")) };
        let name = ours.iter().skip_while(|word| *word != test).nth(1).filter(|word| !word.starts_with('-'));
        return name.filter(|name| !text.contains(name.as_str())).map(|name| format!("{test} has no {name}"));
    }
    None
}
