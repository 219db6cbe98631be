//! The README's promises that a machine can check.

use system_tests::repository;

#[test]
fn readme_names_files_that_exist() {
    let readme = std::fs::read_to_string(repository().join("README.md")).expect("a README");
    for word in readme.split(|c: char| c.is_whitespace() || "`()".contains(c)) {
        let is_path = ["configs/", "docs/", "scripts/"].iter().any(|folder| word.starts_with(folder));
        if is_path {
            let file = word.split('#').next().unwrap_or(word);
            assert!(repository().join(file).exists(), "README names {word}, which is not there");
        }
    }
}
