//! Paths with `*` and `?` in them.

use std::path::{Component, Path, PathBuf};

use wildmatch::WildMatch;

/// Everything that `pattern` names, seen from the folder `from`, in the order of the names. `*` stands for any letters of one name, `?` for one
/// letter; neither for a leading dot.
pub(crate) fn matching(pattern: &str, from: &Path) -> Vec<PathBuf> {
    let whole = from.join(pattern);
    let mut found = vec![PathBuf::new()];
    for component in whole.components() {
        let name = component.as_os_str();
        let is_pattern = matches!(component, Component::Normal(_))
            && name.as_encoded_bytes().iter().any(|byte| b"*?".contains(byte));
        if !is_pattern {
            found.iter_mut().for_each(|path| path.push(name));
            continue;
        }
        let wanted = WildMatch::new(&name.to_string_lossy());
        let below = |folder: PathBuf| {
            let entries = std::fs::read_dir(&folder).into_iter().flatten().flatten();
            let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
            let mut names: Vec<String> =
                names.filter(|name| !name.starts_with('.') && wanted.matches(name)).collect();
            names.sort();
            names.into_iter().map(move |name| folder.join(name))
        };
        found = found.into_iter().flat_map(below).collect();
    }
    found.retain(|path| path.exists());
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_match_within_one_name_in_order_and_never_hidden_ones() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["runs/b/start.json", "runs/a/start.json", "runs/.part-a/start.json", "other/c.toml"] {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        let names = |pattern: &str| -> Vec<PathBuf> {
            let strip = |path: PathBuf| path.strip_prefix(folder.path()).unwrap().to_owned();
            matching(pattern, folder.path()).into_iter().map(strip).collect()
        };
        assert_eq!(names("runs/*"), [Path::new("runs/a"), Path::new("runs/b")]);
        assert_eq!(names("*/c.toml"), [Path::new("other/c.toml")]);
        assert_eq!(names("runs/a"), [Path::new("runs/a")]);
        assert!(names("runs/d").is_empty() && names("*").len() == 2);
    }
}
