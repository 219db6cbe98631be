//! The README's promises that a machine can check.

use system_tests::repository;

#[test]
fn readme_names_files_that_exist() {
    let readme = std::fs::read_to_string(repository().join("README.md")).expect("a README");
    for word in readme.split(|c: char| c.is_whitespace() || "`()".contains(c)) {
        let is_path = ["configs/", "docs/", "scripts/"].iter().any(|folder| word.starts_with(folder));
        if is_path {
            assert!(repository().join(word).exists(), "README names {word}, which is not there");
        }
    }
}
