//! The shipped configs, and what happens to wrong ones.

use std::path::{Path, PathBuf};

use config::RigConfig;
use servo::profile::Profile;
use system_tests::{changed_config, printed, repository, run_rig, set};
use vision::{Mode, Outline};

fn toml_files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .expect("the folder")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .collect();
    files.sort();
    files
}

#[test]
fn every_shipped_rig_config_can_be_run() {
    let configs = repository().join("configs");
    let mut files = toml_files(&configs);
    files.extend(toml_files(&configs.join("hardware")));
    files.retain(|path| path.file_name().is_some_and(|name| name != "worm.toml"));
    assert!(files.len() >= 10, "{files:?}");
    for path in files {
        let config = RigConfig::read(&path).unwrap_or_else(|error| panic!("{error}"));
        let model_path = path.with_file_name("").join(&config.run.model);
        let text = std::fs::read_to_string(&model_path)
            .unwrap_or_else(|error| panic!("{}: {error}", model_path.display()));
        let model =
            sim::Model::from_mjcf(&text).unwrap_or_else(|error| panic!("{}: {error}", model_path.display()));
        let outline = Outline::new(&config.vision, Some(&model));
        let outline = outline.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        if !outline.mode.is_free() {
            assert!(outline.base_m.is_some(), "{}: nothing says where P0 is", path.display());
            assert!(
                outline.mode == Mode::Arc || outline.overhang_m.is_some(),
                "{}: {outline:?}",
                path.display()
            );
        }
        if let (Some(profile), Some(servo)) = (&config.profile, &config.servo) {
            let profile = Profile::new(profile).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            profile.pulses(servo).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            for (_, actuator) in servo.driven() {
                assert!(text.contains(&format!("name=\"{actuator}\"")), "{}: {actuator}", path.display());
            }
        }
    }
}

#[test]
fn fitted_models_never_are_the_tanks() {
    let configs = repository().join("configs");
    let table = |path: &Path| -> toml::Table {
        std::fs::read_to_string(path).expect("a config").parse().expect("TOML")
    };
    for path in toml_files(&configs) {
        let config = table(&path);
        let Some(tank) = config.get("mock").and_then(|mock| mock["tank"].as_str()) else { continue };
        let tank = configs.join(tank);
        let name = table(&tank)["model"].as_str().expect("a model").to_owned();
        let truth = std::fs::read_to_string(tank.with_file_name(&name)).expect("the tank's model");
        let nominal = configs.join(config["run"]["model"].as_str().expect("a model"));
        let nominal = std::fs::read_to_string(nominal).expect("the nominal model");
        let [truth, nominal] = [truth, nominal].map(|text| sim::Model::from_mjcf(&text).expect("MJCF"));
        let differing = truth
            .parameter_names()
            .iter()
            .filter(|name| {
                truth.parameter(name).expect("named") != nominal.parameter(name).expect("the same names")
            })
            .count();
        assert!(differing > truth.parameter_names().len() / 2, "{name}: only {differing} parameters differ");
    }
}

#[test]
fn octopus_simulates_and_renders() {
    let models = repository().join("configs/models");
    let text = std::fs::read_to_string(models.join("octopus8.xml")).expect("the model");
    let model = sim::Model::from_mjcf(&text).expect("MJCF");
    let stroke = ident::table::read_command(&models.join("octopus8-stroke.csv")).expect("the stroke");
    let options = sim::RolloutOptions { timestep_s: Some(0.00025), ..Default::default() };
    let times = [0.0, 0.25, 0.5];
    let swim = sim::rollout(&model, &model.rest_state(), &stroke, &times, &options).expect("a rollout");
    let plane = camera::calibration::Plane::square(0.001, [320.0, 200.0]);
    let renderer = tank::render::Renderer::new(plane, tank::render::Look::plain(640, 480));
    let dark = |instant: usize| {
        let qpos = &swim.qpos[instant * model.nq()..(instant + 1) * model.nq()];
        let image = renderer.draw(&model, qpos);
        image.pixels().map(|pixel| pixel.0[0] < 100).collect::<Vec<bool>>()
    };
    let (first, last) = (dark(0), dark(2));
    let area = |picture: &[bool]| picture.iter().filter(|&&inside| inside).count();
    // The hub alone is 80 mm by 40 mm: 2500 pixels of 1 mm.
    assert!(area(&first) > 4000, "{} dark pixels", area(&first));
    assert!(first.iter().zip(&last).filter(|(a, b)| a != b).count() > 200, "nothing moved");
}

/// Runs a config changed by `change` and gives back what was printed; it must be refused as wrong input.
fn refusal(change: impl FnOnce(&mut toml::Table)) -> String {
    let folder = tempfile::tempdir().expect("a folder");
    let config = changed_config("chain-driven-pose-1.toml", folder.path(), change);
    let runs = folder.path().join("runs");
    let output = run_rig(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()]);
    assert_eq!(output.status.code(), Some(2), "{}", printed(&output));
    printed(&output)
}

#[test]
fn wrong_configs_are_refused_with_file_line_caret_and_remedy() {
    let unknown = refusal(|config| set(config, "profile", "amplitud_rad", 0.5));
    assert!(
        unknown.contains("rig.toml") && unknown.contains("line ") && unknown.contains("^^^"),
        "{unknown}"
    );
    assert!(unknown.contains("did you mean `amplitude_rad`?"), "{unknown}");

    let wrong_type = refusal(|config| set(config, "camera", "fps", "fast"));
    assert!(wrong_type.contains("invalid type") && wrong_type.contains('^'), "{wrong_type}");

    for (table, key, value, must_be) in [
        ("profile", "ccw_s", f64::NAN, "must be finite"),
        ("camera", "fps", -1.0, "must be finite"),
        ("run", "film_s", f64::INFINITY, "at most 31622400 s, a year"),
    ] {
        let refused = refusal(|config| set(config, table, key, value));
        assert!(refused.contains(must_be) && refused.contains(key), "{refused}");
    }

    let too_far = refusal(|config| set(config, "profile", "amplitude_rad", 2.0));
    assert!(too_far.contains("µs"), "{too_far}");

    let too_fast = refusal(|config| {
        set(config, "profile", "ccw_s", 0.1);
        set(config, "profile", "cw_s", 0.05);
    });
    assert!(too_fast.contains("4000"), "{too_fast}");

    // Before anything moves: what is filmed with it would be worth nothing.
    let folder = tempfile::tempdir().expect("a folder");
    let camera = folder.path().join("camera.yaml");
    std::fs::write(&camera, "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n").expect("a file");
    let in_air = refusal(|config| {
        let path = camera.to_str().expect("a readable path");
        config["calibration"] = toml::Table::from_iter([("file".into(), path.into())]).into();
    });
    assert!(in_air.contains("8 to 15 % wrong under water"), "{in_air}");

    for (table, key, name, meant) in
        [("fit", "parameters", "fluidcoeff", "fluidcoef"), ("diagnose", "exclude", "tehter", "tether")]
    {
        let refused = refusal(|config| set(config, table, key, vec![name]));
        assert!(refused.contains(name) && refused.contains(&format!("`{meant}`")), "{refused}");
        assert!(!refused.contains("filmed"), "{refused}");
    }

    let no_tank = refusal(|config| drop(config.remove("mock")));
    assert!(no_tank.contains("[mock]"), "{no_tank}");
}
