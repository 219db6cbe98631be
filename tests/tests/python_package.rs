//! The Python package before its own tests, on a run and with the program of this build.

use std::process::Command;

use system_tests::python::python;
use system_tests::{changed_config, in_real_time, only_run, printed, program, repository, run_rig, set};

#[test]
fn the_python_package_passes_its_tests() {
    let Some(python) = python("the Python package", &["tankrig", "pytest"]) else { return };
    let _turn = in_real_time();
    let folder = tempfile::tempdir().expect("a folder");
    let config = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
        set(config, "profile", "cycles", 1);
        set(config, "profile", "soft_start_cycles", 0);
        set(config, "run", "diagnose", false);
    });
    let runs = folder.path().join("runs");
    let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));
    let run = only_run(&runs).expect("one run folder");
    let tests = Command::new(&python)
        .args(["-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"])
        .current_dir(repository().join("rig/python"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("RIG_RUN", &run)
        .env("RIG_PROGRAM", program())
        .env("RIG_CONFIG", &config)
        .output()
        .expect("Python starts");
    assert!(tests.status.success(), "{}", printed(&tests));
    let example = Command::new(&python)
        .arg(repository().join("rig/python/examples/coefficients.py"))
        .arg(&run)
        .current_dir(folder.path())
        .output()
        .expect("Python starts");
    assert!(example.status.success() && printed(&example).contains("rms"), "{}", printed(&example));
}
