//! Names as people type them: globs, and what they may have meant.

use std::path::Path;

/// Whether `name` matches `pattern`, where `*` stands for any run of characters and `?` for any one.
pub(crate) fn glob(pattern: &str, name: &str) -> bool {
    let (pattern, name): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    let (mut p, mut n) = (0, 0);
    // Where to go on after giving the last star one more character.
    let mut retry = None;
    while n < name.len() {
        match pattern.get(p) {
            Some('*') => {
                retry = Some((p, n));
                p += 1;
            }
            Some(&c) if c == '?' || c == name[n] => {
                p += 1;
                n += 1;
            }
            _ => match retry {
                Some((star, taken)) => {
                    retry = Some((star, taken + 1));
                    p = star + 1;
                    n = taken + 1;
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|&c| c == '*')
}

/// ` (did you mean ...?)` with the known name nearest to `name`, or the known names where none is near.
pub(crate) fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a String>) -> String {
    let known: Vec<&String> = known.into_iter().collect();
    // A name cut short is nearer than one of as many letters.
    let distance = |k: &str| if k.starts_with(name) { 0 } else { strsim::damerau_levenshtein(name, k) };
    let nearest = known.iter().map(|&k| (distance(k), k)).min();
    match nearest {
        Some((distance, nearest)) if distance <= name.len().max(nearest.len()) / 2 => {
            format!(" (did you mean `{nearest}`?)")
        }
        Some(_) if known.len() <= 12 => {
            let list: Vec<String> = known.iter().map(|k| format!("`{k}`")).collect();
            format!(" (it has {})", list.join(", "))
        }
        Some((_, nearest)) => format!(" (it has {} others, such as `{nearest}`)", known.len()),
        None => " (it has none)".to_owned(),
    }
}

/// `error`, which opening `path` gave, with the file of its folder that may have been meant.
pub(crate) fn not_there(error: std::io::Error, path: &Path) -> std::io::Error {
    if error.kind() != std::io::ErrorKind::NotFound {
        return error;
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = std::fs::read_dir(folder) else {
        return std::io::Error::new(error.kind(), format!("there is no folder {}", folder.display()));
    };
    let names: Vec<String> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    let wanted = path.file_name().unwrap_or_default().to_string_lossy();
    // Of a folder's many files only a near one is worth naming.
    let near = |name: &&String| strsim::damerau_levenshtein(&wanted, name) <= wanted.len() / 3;
    let hint = did_you_mean(&wanted, names.iter().filter(near));
    let hint = if hint.contains("did you mean") { hint } else { String::new() };
    std::io::Error::new(error.kind(), format!("no such file{hint}"))
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
    fn nearest_name_is_offered_or_all_of_few() {
        let known = ["P1".to_owned(), "P2".to_owned()];
        assert_eq!(did_you_mean("p2", &known), " (did you mean `P2`?)");
        assert_eq!(did_you_mean("elbow", &known), " (it has `P1`, `P2`)");
        assert_eq!(did_you_mean("elbow", &[]), " (it has none)");
    }
}
