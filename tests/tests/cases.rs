//! Experiments nearer to real ones: what their judge counts as right, and that a seed always makes the same files.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use system_tests::python::python;
use system_tests::{printed, repository};

#[test]
fn the_judge_counts_as_its_page_says() {
    let Some(python) = python("the judge of the cases", &["unittest"]) else { return };
    let output = run(&python, &["-m", "unittest"]);
    assert!(output.status.success(), "{}", printed(&output));
}

#[test]
fn a_number_always_makes_the_same_case() {
    let Some(python) = python("cases that MuJoCo moves", &["mujoco", "numpy"]) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let made = ["once", "again"].map(|name| {
        let out = folder.path().join(name);
        let arguments = ["generate.py", "--family", "several", "--count", "1"];
        let output = run(&python, &[&arguments[..], &[out.to_str().expect("a readable path")]].concat());
        assert!(output.status.success(), "{}", printed(&output));
        ["case-2000/model.xml", "case-2000/experiment.toml", "case-2000/drop-1.csv", "hidden/case-2000.json"]
            .map(|file| std::fs::read_to_string(out.join(file)).expect("the case's file"))
    });
    assert_eq!(made[0], made[1]);
    // nothing that a program is given tells what is hidden
    let hidden: serde_json::Value = serde_json::from_str(&made[0][3]).expect("a table of what is hidden");
    for fault in hidden["faults"].as_array().expect("faults") {
        let cause = fault["cause"].as_str().expect("a name");
        assert!(!made[0][..2].iter().any(|text| text.contains(cause)), "{cause}");
    }
}

/// Runs Python in the folder of the cases.
fn run(python: &Path, arguments: &[&str]) -> Output {
    let folder: PathBuf = repository().join("tests/cases");
    let mut command = Command::new(python);
    command.args(arguments).current_dir(folder).env("PYTHONDONTWRITEBYTECODE", "1");
    command.output().expect("Python starts")
}
