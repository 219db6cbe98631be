//! The files and folders that a rig config names.

use std::path::{Path, PathBuf};

use toml::{Table, Value};

/// Keys of a rig config that name a file or a folder; relative paths start at the config's own folder.
const KEYS: [&[&str]; 10] = [
    &["run", "model"],
    &["mock", "tank"],
    &["replay", "run"],
    &["camera", "tank"],
    &["calibration", "file"],
    &["servo", "channel", "calibration"],
    &["vision", "static_mask"],
    &["vision", "background"],
    &["vision", "sam2", "weights"],
    &["vision", "sam2", "library"],
];
/// What `[vision] background` says that is no picture's path.
const NO_PICTURE: [&str; 3] = ["auto", "temporal", "flat"];

/// The config at `path` and the files that it names, which whoever reads it reads too. One that cannot be read names none: why, says its
/// reader.
pub fn files(path: &Path) -> Vec<PathBuf> {
    let mut config: Table =
        std::fs::read_to_string(path).ok().and_then(|text| text.parse().ok()).unwrap_or_default();
    make_absolute(&mut config, path.parent().unwrap_or(Path::new("")));
    let mut files = vec![path.to_owned()];
    for named in named(&mut config) {
        let named = PathBuf::from(named.as_str());
        let within = std::fs::read_dir(&named).into_iter().flatten().flatten().map(|entry| entry.path());
        files.extend(within.filter(|file| file.extension().is_some_and(|ending| ending == "onnx")));
        files.extend(named.is_file().then_some(named));
    }
    files
}

/// Lets the paths in `config`, which start at `folder`, be right wherever the config is.
pub fn make_absolute(config: &mut Table, folder: &Path) {
    for path in named(config) {
        *path = folder.join(path.as_str()).display().to_string();
    }
}

fn named(config: &mut Table) -> Vec<&mut String> {
    let mut found = Vec::new();
    in_table(config, &mut Vec::new(), &mut found);
    found
}

fn in_table<'c>(table: &'c mut Table, way: &mut Vec<String>, found: &mut Vec<&'c mut String>) {
    for (key, value) in table {
        way.push(key.clone());
        in_value(value, way, found);
        way.pop();
    }
}

fn in_value<'c>(value: &'c mut Value, way: &mut Vec<String>, found: &mut Vec<&'c mut String>) {
    match value {
        Value::Table(table) => in_table(table, way, found),
        Value::Array(all) => all.iter_mut().for_each(|one| in_value(one, way, found)),
        Value::String(text)
            if KEYS.iter().any(|keys| keys == way) && !NO_PICTURE.contains(&text.as_str()) =>
        {
            found.push(text);
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: &str = "
[run]
model = \"model.xml\"
name = \"model.xml\"
[[servo.channel]]
calibration = \"servo.toml\"
[[servo.channel]]
calibration = \"/abs/servo-2.toml\"
[vision]
background = \"flat\"
static_mask = \"mask.png\"
sam2 = { weights = \"graphs\" }
";

    #[test]
    fn paths_are_told_from_other_words_in_lists_and_tables() {
        let mut config: Table = CONFIG.parse().unwrap();
        make_absolute(&mut config, Path::new("/rig"));
        let text = config.to_string();
        for path in
            ["/rig/model.xml", "/rig/servo.toml", "\"/abs/servo-2.toml", "/rig/mask.png", "/rig/graphs"]
        {
            assert_eq!(text.matches(path).count(), 1, "{path} in {text}");
        }
        assert!(text.contains("\"flat\"") && text.contains("\"model.xml\""), "{text}");
    }

    #[test]
    fn files_are_those_that_are_there_and_graphs_one_by_one() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("graphs")).unwrap();
        for (name, text) in [
            ("rig.toml", CONFIG),
            ("model.xml", ""),
            ("flat", ""),
            ("graphs/a.onnx", ""),
            ("graphs/t.csv", ""),
        ] {
            std::fs::write(at(name), text).unwrap();
        }
        let mut found = files(&at("rig.toml"));
        found.sort();
        assert_eq!(found, [at("graphs/a.onnx"), at("model.xml"), at("rig.toml")]);
        assert_eq!(files(&at("none.toml")), [at("none.toml")]);
    }
}
