//! The page of faults names tests that exist, and says of each whether it needs the guest of `scripts/kernel-test`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use system_tests::repository;

fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let (folders, files): (Vec<_>, Vec<_>) = entries.partition(|path| path.is_dir());
    let rust = files.into_iter().filter(|file| file.extension().is_some_and(|ending| ending == "rs"));
    rust.chain(folders.iter().flat_map(|folder| sources(folder))).collect()
}

/// Every test of these sources: its name, and whether it is one of the guest's.
fn tests() -> BTreeMap<String, bool> {
    let mut tests = BTreeMap::new();
    for folder in ["firmware-protocol/src", "firmware-protocol/tests", "rig", "tests/tests"] {
        for file in sources(&repository().join(folder)) {
            let text = std::fs::read_to_string(&file).expect("text");
            // In the text between its attribute and its body a test has its name; proptest's have attributes of their own before.
            for after in text.split("#[test]").skip(1) {
                let name = after.split("fn ").nth(1).and_then(|rest| rest.split('(').next());
                let is_guests = file.ancestors().any(|folder| folder.ends_with("tests/tests/kernel"));
                tests.insert(name.expect("a test has a name").to_owned(), is_guests);
            }
        }
    }
    tests
}

#[test]
fn page_of_faults_names_tests_that_exist() {
    let tests = tests();
    let page = std::fs::read_to_string(repository().join("docs/faults.md")).expect("the page");
    let rows: Vec<&str> =
        page.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| ---")).collect();
    let mut named = Vec::new();
    for row in rows {
        let last = row.trim_end_matches(" |").rsplit("| ").next().expect("a column");
        if last == "shown by" {
            continue;
        }
        let mut words = last.split('`');
        words.next();
        let mut in_row = 0;
        while let (Some(name), Some(after)) = (words.next(), words.next()) {
            let is_guests = tests.get(name).unwrap_or_else(|| panic!("no test {name} in {row}"));
            assert_eq!(after.starts_with('*'), *is_guests, "{name}: a star is for the guest's tests");
            named.push(name.to_owned());
            in_row += 1;
        }
        assert!(in_row > 0 || last.starts_with("no test: "), "neither test nor reason: {row}");
    }
    let forgotten: Vec<_> =
        tests.iter().filter(|(name, is_guests)| **is_guests && !named.contains(name)).collect();
    assert!(forgotten.is_empty(), "tests of the guest that the page does not name: {forgotten:?}");
}
