//! What `rig export mcap` writes is what Foxglove's own definitions say, read by other people's code.

use std::process::Command;

use system_tests::python::python;
use system_tests::{changed_config, in_real_time, only_run, printed, repository, run_rig, set};

#[test]
fn an_exported_run_is_what_foxglove_reads() {
    let modules = ["mcap", "jsonschema", "foxglove_schemas_protobuf.SceneUpdate_pb2"];
    let Some(python) = python("an export in Foxglove's own reader", &modules) else { return };
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
    let out = folder.path().join("run-foxglove.mcap");
    let output =
        run_rig(["export".as_ref(), "mcap".as_ref(), run.as_os_str(), "--out".as_ref(), out.as_os_str()]);
    assert!(output.status.success(), "{}", printed(&output));

    let script = repository().join("tests/tests/in_foxglove.py");
    let files = ["trajectory.csv", "servo.csv", "fit.json"].map(|name| run.join(name));
    let read = Command::new(python).arg(script).arg(&out).args(files).output().expect("Python starts");
    let text = printed(&read);
    assert!(read.status.success(), "{text}");
    for topic in [
        "/camera/image foxglove.CompressedImage",
        "/camera/calibration foxglove.CameraCalibration",
        "/camera/annotations foxglove.ImageAnnotations",
        "/frames foxglove.FrameTransforms",
        "/simulated foxglove.SceneUpdate",
        "/measured foxglove.SceneUpdate",
        "/journal foxglove.Log",
        "/servo rig.Servo",
        "/keypoints rig.Keypoints",
    ] {
        assert!(text.contains(topic), "no {topic} in\n{text}");
    }
}
