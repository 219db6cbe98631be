//! Names as people type them: globs, and what they may have meant.

use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};

use wildmatch::WildMatch;

use crate::spreadsheet;

/// Whether `name` matches `pattern`, where `*` stands for any run of characters and `?` for any one.
pub fn glob(pattern: &str, name: &str) -> bool {
    WildMatch::new(pattern).matches(name)
}

/// Of `known` the name nearest to `name`, if it is near enough for a slip of the keyboard.
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // A name cut short is nearer than one of as many letters.
    let distance = |k: &str| if k.starts_with(name) { 0 } else { strsim::damerau_levenshtein(name, k) };
    let (distance, nearest) = known.into_iter().map(|k| (distance(k), k)).min()?;
    (distance <= name.len().max(nearest.len()) / 2).then_some(nearest)
}

/// ` (did you mean ...?)` with the known name nearest to `name`, or the known names where none is near.
pub fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a String>) -> String {
    let known: Vec<&String> = known.into_iter().collect();
    if let Some(nearest) = nearest(name, known.iter().map(|k| k.as_str())) {
        return format!(" (did you mean `{nearest}`?)");
    }
    match known.iter().min_by_key(|k| (strsim::damerau_levenshtein(name, k), **k)) {
        Some(_) if known.len() <= MAX_LISTED_NAMES => {
            let list: Vec<String> = known.iter().map(|k| format!("`{k}`")).collect();
            format!(" (it has {})", list.join(", "))
        }
        Some(like) => format!(" (it has {} others, such as `{like}`)", known.len()),
        None => " (it has none)".to_owned(),
    }
}

/// Up to this many known names are all listed where none is near, chosen: they fit on one line.
const MAX_LISTED_NAMES: usize = 12;

/// The text of the file at `path`; where it is not there, or a folder, the error names the file that may have been meant.
pub fn read_text(path: &Path) -> Result<String, Error> {
    let bytes = std::fs::read(path).map_err(|error| match error.kind() {
        ErrorKind::NotFound => not_there(path),
        ErrorKind::IsADirectory => a_folder(path),
        _ => error,
    })?;
    spreadsheet::decoded(bytes).map_err(|what| Error::new(ErrorKind::InvalidData, what))
}

/// The error that `path` is a folder, with the files in it that may have been meant.
fn a_folder(path: &Path) -> Error {
    let entries = std::fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_config = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "toml");
    let mut found: Vec<String> = entries.filter(is_config).map(|path| path.display().to_string()).collect();
    found.sort_unstable();
    found.truncate(MAX_LISTED_NAMES);
    let hint = match found.is_empty() {
        true => String::new(),
        false => format!(" (did you mean {}?)", found.join(", or ")),
    };
    Error::new(ErrorKind::IsADirectory, format!("it is a folder, and a file is wanted{hint}"))
}

/// The error that there is no file at `path`, with the file of its folder that may have been meant.
fn not_there(path: &Path) -> Error {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Error::new(ErrorKind::NotFound, format!("there is no folder {}", folder.display()));
    };
    let names: Vec<String> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    let wanted = path.file_name().unwrap_or_default().to_string_lossy();
    // Of a folder's many files only a near one is worth naming.
    let near = |name: &&String| strsim::damerau_levenshtein(&wanted, name) <= wanted.len() / 3;
    let hint = did_you_mean(&wanted, names.iter().filter(near));
    let hint = if hint.contains("did you mean") { hint } else { String::new() };
    Error::new(ErrorKind::NotFound, format!("no such file{hint}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn star_takes_any_run_and_question_mark_any_one() {
        for (pattern, name) in
            [("a*/blunt", "a12/blunt"), ("*", ""), ("g?/b*t", "g1/blunt"), ("*b*b", "abbb")]
        {
            assert!(glob(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [("a*/blunt", "b1/blunt"), ("g?", "g"), ("g1", "g12"), ("*a", "ab")] {
            assert!(!glob(pattern, name), "{pattern} {name}");
        }
    }

    #[test]
    fn folder_in_place_of_a_file_is_told_with_the_files_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let said = || read_text(folder.path()).unwrap_err().to_string();
        assert_eq!(said(), "it is a folder, and a file is wanted");
        std::fs::write(folder.path().join("rig.toml"), "").unwrap();
        assert!(said().contains("did you mean") && said().contains("rig.toml?"), "{}", said());
    }

    #[test]
    fn nearest_name_is_offered_or_all_of_few() {
        let known = ["P1".to_owned(), "P2".to_owned()];
        assert_eq!(did_you_mean("p2", &known), " (did you mean `P2`?)");
        assert_eq!(did_you_mean("elbow", &known), " (it has `P1`, `P2`)");
        assert_eq!(did_you_mean("elbow", &[]), " (it has none)");
    }
}
