//! What `rig export bluesky` writes is what Bluesky's event model says, read by its own code.

use std::process::Command;

use system_tests::python::python;
use system_tests::{changed_config, in_real_time, only_run, printed, repository, run_rig, set};

#[test]
fn an_exported_run_is_what_bluesky_reads() {
    let Some(python) = python("an export in Bluesky's own schemas", &["event_model", "pandas"]) else {
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let runs = folder.path().join("runs");
    let run = {
        let _turn = in_real_time();
        let config = changed_config("chain-driven-pose-1.toml", folder.path(), |config| {
            set(config, "profile", "cycles", 1);
            set(config, "profile", "soft_start_cycles", 0);
            set(config, "run", "diagnose", false);
        });
        let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
        assert!(output.status.success(), "{}", printed(&output));
        only_run(&runs).expect("one run folder")
    };
    let out = folder.path().join("run.jsonl");
    let output =
        run_rig(["export".as_ref(), "bluesky".as_ref(), run.as_os_str(), "--out".as_ref(), out.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));

    let script = repository().join("tests/tests/in_bluesky.py");
    let read = Command::new(&python).arg(script).arg(&out).arg(&run).output().expect("Python starts");
    let text = printed(&read);
    assert!(read.status.success(), "{text}");
    for unit in ["'P3_x_m': 'm'", "'servo_rad': 'rad'", "'stamp_ns': 'ns'"] {
        assert!(text.contains(unit), "no {unit} in\n{text}");
    }

    let page = std::fs::read_to_string(repository().join("docs/exchange.md")).expect("the page");
    let block = page.split("```python\n").skip(1).find(|block| block.contains("run.jsonl"));
    let block = block.and_then(|block| block.split("```").next()).expect("the page reads such a file");
    let script = format!("{block}\nprint(points.columns.tolist(), len(points))");
    let read = Command::new(&python).args(["-c", &script]).current_dir(folder.path()).output();
    let text = printed(&read.expect("Python starts"));
    assert!(text.contains("'P3_x_m', 'P3_z_m'"), "{text}");
}
