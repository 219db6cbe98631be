//! A model may be in several files of its folder, and in none outside it.

use std::path::{Path, PathBuf};

use sim::Model;
use sim::mjcf::alone;

/// A folder of the test called `name` with these files.
fn folder(name: &str, files: &[(&str, &str)]) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    for (file, text) in files {
        let path = folder.join(file);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    folder
}

fn refusal(path: &Path) -> String {
    Model::read_mjcf(path).unwrap_err().to_string()
}

const ARM: &str = r#"<mujocoinclude><body name="arm"><joint/><geom size="0.1"/></body></mujocoinclude>"#;

#[test]
fn included_files_stand_in_the_place_of_their_element() {
    let files = [
        (
            "arm.xml",
            r#"<mujoco><include file="parts/all.xml"/><worldbody><include file="parts/arm.xml"/></worldbody></mujoco>"#,
        ),
        // beside itself, and beside the model
        ("parts/all.xml", r#"<mujoco><include file="step.xml"/><include file="parts/water.xml"/></mujoco>"#),
        ("parts/step.xml", r#"<mujoco><option timestep="0.003"/></mujoco>"#),
        ("parts/water.xml", r#"<mujoco><option density="1000"/></mujoco>"#),
        ("parts/arm.xml", ARM),
    ];
    let path = folder("included", &files).join("arm.xml");
    let model = Model::read_mjcf(&path).unwrap();
    assert_eq!((model.settings.timestep_s, model.settings.density), (0.003, 1000.0));
    assert_eq!(model.bodies[1].name, "arm");
    // and all of it in one text
    let text = alone(&path).unwrap();
    assert_eq!(Model::from_mjcf(&text).unwrap().bodies, model.bodies);
    let whole = path.with_file_name("parts/arm.xml");
    assert_eq!(alone(&whole).unwrap(), ARM, "what includes nothing stays as it is");
}

#[test]
fn what_is_refused_in_an_included_file_has_its_name_and_line() {
    let files = [
        (
            "model.xml",
            "<mujoco>\n<include file=\"parts/bad.xml\"/>\n<include file=\"parts/torn.xml\"/></mujoco>",
        ),
        ("parts/bad.xml", "<mujoco>\n\n<option noslip_iterations=\"3\"/></mujoco>"),
        ("parts/torn.xml", "<mujoco>\n<option>"),
    ];
    let error = refusal(&folder("refused", &files).join("model.xml"));
    for wanted in
        ["2 things", "parts/bad.xml, line 3: <option>", "parts/torn.xml, line 1: this is not well-formed"]
    {
        assert!(error.contains(wanted), "{error}");
    }
}

#[test]
fn a_file_is_read_once_and_only_from_the_models_folder() {
    let outside = r#"<mujoco><include file="../other/x.xml"/></mujoco>"#;
    let files = [
        ("own/twice.xml", r#"<mujoco><include file="a.xml"/><include file="a.xml"/></mujoco>"#),
        ("own/a.xml", "<mujoco/>"),
        ("own/itself.xml", r#"<mujoco><include file="b.xml"/></mujoco>"#),
        ("own/b.xml", r#"<mujoco><include file="itself.xml"/></mujoco>"#),
        ("own/none.xml", r#"<mujoco><include file="c.xml"/></mujoco>"#),
        ("own/nothing.xml", r#"<mujoco><include/></mujoco>"#),
        ("own/outside.xml", outside),
        ("other/x.xml", "<mujoco/>"),
    ];
    let own = folder("once", &files).join("own");
    for (model, wanted) in [
        ("twice.xml", ["line 1", "a second time"]),
        ("itself.xml", ["b.xml, line 1", "a second time"]),
        ("none.xml", ["file=\"c.xml\"", "is not there"]),
        ("nothing.xml", ["<include>", "is needed"]),
        ("outside.xml", ["out of the model's folder", "RIG_MODEL_FOLDERS="]),
    ] {
        let error = refusal(&own.join(model));
        assert!(wanted.iter().all(|part| error.contains(part)), "{error} should say {wanted:?}");
    }
    let absolute = own.join("absolute.xml");
    let secret = own.with_file_name("other").join("x.xml");
    std::fs::write(&absolute, outside.replace("../other/x.xml", &secret.display().to_string())).unwrap();
    assert!(refusal(&absolute).contains("out of the model's folder"));
}

/// In a process of its own: the environment says which further folders may be read.
#[test]
fn whoever_starts_the_program_may_allow_further_folders() {
    const MODEL: &str = "RIG_TEST_MODEL_OUTSIDE";
    if let Some(path) = std::env::var_os(MODEL) {
        assert_eq!(Model::read_mjcf(Path::new(&path)).unwrap().settings.density, 1000.0);
        return;
    }
    let files = [
        ("own/model.xml", r#"<mujoco><include file="../shared/water.xml"/></mujoco>"#),
        ("shared/water.xml", r#"<mujoco><option density="1000"/></mujoco>"#),
    ];
    let folder = folder("allowed", &files);
    let status = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "mjcf_files::whoever_starts_the_program_may_allow_further_folders"])
        .env(MODEL, folder.join("own/model.xml"))
        .env("RIG_MODEL_FOLDERS", std::env::join_paths([folder.join("none"), folder.join("shared")]).unwrap())
        .output()
        .unwrap();
    assert!(status.status.success(), "{}", String::from_utf8_lossy(&status.stdout));
}
