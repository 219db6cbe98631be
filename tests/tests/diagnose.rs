//! The diagnosis through the command line: every verdict, its exit code and its files.

use std::path::Path;

use sim::{Command, Integrator, Model, RolloutOptions, State, rollout};
use system_tests::{json, printed, run_rig};

const CHAIN: &str = include_str!("../../ident/tests/data/chain.xml");
/// Noise of the keypoints \[m\], about that of a camera.
const NOISE_M: f64 = 3e-4;
const FPS: f64 = 100.0;
const SECONDS: f64 = 2.0;
const RELEASE_S: f64 = 0.3;

/// Numbers of a normal variable, the same ones every time: twelve even ones make one.
fn normal(state: &mut u64) -> f64 {
    let even = |state: &mut u64| {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..12).map(|_| even(state)).sum::<f64>() - 6.0
}

/// Films drops of the chain, changed by `hide`, and writes an experiment that knows nothing of that. The camera's
/// clock shows `clock` of the true time.
fn write(
    folder: &Path,
    poses: &[[f64; 3]],
    hide: impl Fn(&mut Model),
    clock: impl Fn(f64) -> f64,
) -> std::path::PathBuf {
    let mut model = Model::from_mjcf(CHAIN).expect("the chain");
    hide(&mut model);
    let times: Vec<f64> = (0..(SECONDS * FPS) as usize).map(|i| i as f64 / FPS).collect();
    let seen: Vec<f64> = times.iter().map(|&t| clock(t)).collect();
    let mut text = String::from("model = \"chain.xml\"\n[fit]\nparameters = [\"fluidcoef\", \"damping\"]\n");
    let mut state = 20_261_121;
    for (number, pose) in poses.iter().enumerate() {
        let options = RolloutOptions {
            integrator: Some(Integrator::Rk4),
            timestep_s: Some(5e-4),
            start_s: RELEASE_S,
            ..RolloutOptions::default()
        };
        let start = State { qpos: pose.to_vec(), qvel: vec![0.0; 3] };
        let run = rollout(&model, &start, &Command::default(), &seen, &options).expect("a motion");
        let mut table = String::from("time_s");
        for name in ["P1", "P2", "P3"] {
            table.push_str(&format!(",{name}_x_m,{name}_z_m"));
        }
        table.push('\n');
        for (row, time_s) in times.iter().enumerate() {
            table.push_str(&format!("{time_s}"));
            for position in &run.position_m[3 * row..3 * row + 3] {
                for x in [position[0], position[2]] {
                    table.push_str(&format!(",{:.6}", x + NOISE_M * normal(&mut state)));
                }
            }
            table.push('\n');
        }
        std::fs::write(folder.join(format!("drop-{number}.csv")), table).expect("a file");
        text.push_str(&format!(
            "[[run]]\nid = \"drop-{number}\"\nkind = \"drop\"\ntrajectory = \"drop-{number}.csv\"\nrelease_s = {RELEASE_S}\n"
        ));
    }
    std::fs::write(folder.join("chain.xml"), CHAIN).expect("a file");
    let path = folder.join("experiment.toml");
    std::fs::write(&path, text).expect("a file");
    path
}

const POSES: [[f64; 3]; 3] = [[1.5, 0.0, 0.0], [0.9, -1.2, 1.2], [-1.2, 0.4, -0.6]];

fn diagnose(experiment: &Path, out: &Path) -> (Option<i32>, serde_json::Value, String) {
    let output = run_rig([
        "diagnose".as_ref(),
        experiment.as_os_str(),
        "--out".as_ref(),
        out.as_os_str(),
        "--exit-code".as_ref(),
    ]);
    let text = printed(&output);
    assert!(out.join("diagnosis.json").exists(), "{text}");
    (output.status.code(), json(&out.join("diagnosis.json")), text)
}

#[test]
fn nothing_hidden_is_nothing_detectable_with_what_would_have_been_seen() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = write(folder.path(), &POSES[..2], |_| (), |t| t);
    let (code, diagnosis, text) = diagnose(&experiment, &folder.path().join("out"));
    assert_eq!((code, diagnosis["verdict"].as_str()), (Some(0), Some("nothing-detectable")), "{text}");
    assert!(diagnosis["causes"].as_array().is_some_and(Vec::is_empty));
    let noise_m = diagnosis["noise_m"].as_f64().expect("a noise");
    assert!((noise_m / NOISE_M - 1.0).abs() < 0.1, "{noise_m}");
    let detectable = diagnosis["detectable"].as_array().expect("a list");
    let smallest = |name: &str| {
        let entry = detectable.iter().find(|entry| entry["name"] == name).expect("every cause is listed");
        entry["smallest"].as_f64()
    };
    assert!(smallest("stiffness/stiffness").is_some_and(|size| (1e-7..1e-4).contains(&size)));
    assert_eq!(smallest("servo_lag/time"), None, "no servo moves in a drop");
    assert_eq!(diagnosis["fitted"], serde_json::json!(["joint_damping"]));
}

#[test]
fn hidden_stiffness_is_named_with_its_value_and_the_model_extended() {
    let folder = tempfile::tempdir().expect("a folder");
    let hidden = 3e-5;
    let hide = |model: &mut Model| {
        model.add_cause("stiffness").expect("a cause");
        model.set_parameter("stiffness/stiffness", hidden).expect("its size");
    };
    let experiment = write(folder.path(), &POSES, hide, |t| t);
    let out = folder.path().join("out");
    let (code, diagnosis, text) = diagnose(&experiment, &out);
    assert_eq!((code, diagnosis["verdict"].as_str()), (Some(10), Some("cause")), "{text}");
    let cause = &diagnosis["causes"][0];
    assert_eq!(cause["name"], "stiffness", "{text}");
    let parameter = &cause["parameters"][0];
    let value = parameter["value"].as_f64().expect("a value");
    assert!((value / hidden - 1.0).abs() < 0.1, "{value}");
    assert!(diagnosis["heldout"]["gain"].as_f64().is_some_and(|gain| gain > 0.2), "{text}");
    let model =
        Model::from_mjcf(&std::fs::read_to_string(out.join("model.xml")).expect("a model")).expect("MJCF");
    // a size is a mean over all likely sets of causes, a model holds one
    let held = model.parameter("stiffness/stiffness").expect("the cause");
    assert!((held / value - 1.0).abs() < 1e-3, "{held} {value}");
    let page = std::fs::read_to_string(out.join("report.html")).expect("a report");
    assert!(page.contains("stiffness/stiffness") && page.contains("Gain on runs not fitted to"));
}

/// A small swing leaves the drag open, so that the numbers found there miss a large one, whatever else is right.
#[test]
fn what_the_fit_leaves_open_is_no_objection_of_held_out_runs() {
    let folder = tempfile::tempdir().expect("a folder");
    let hide = |model: &mut Model| {
        model.add_cause("keypoint_slip").expect("a cause");
        model.set_parameter("keypoint_slip/P2", 0.001).expect("its size");
        for geom in ["g1", "g2", "g3"] {
            model.set_parameter(&format!("{geom}/blunt"), 1.1).expect("its drag");
        }
    };
    let experiment = write(folder.path(), &[[0.15, 0.05, -0.05], POSES[0]], hide, |t| t);
    let text = std::fs::read_to_string(&experiment).expect("an experiment");
    std::fs::write(&experiment, text + "use = \"holdout\"\n").expect("a file");
    let (_, diagnosis, text) = diagnose(&experiment, &folder.path().join("out"));
    assert_eq!(
        (diagnosis["verdict"].as_str(), &diagnosis["causes"][0]["name"]),
        (Some("cause"), &"keypoint_slip".into()),
        "{text}"
    );
    let heldout = |name: &str| diagnosis["heldout"][name].as_f64().expect("a figure");
    assert!(heldout("rms_after_m") > 1.5 * heldout("noise_floor_m"), "{text}");
}

#[test]
fn a_clock_that_wanders_is_unexplained_and_nothing_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let wander = |t: f64| t + 0.012 * (std::f64::consts::TAU * 1.7 * t * t).sin() * f64::from(t > RELEASE_S);
    let experiment = write(folder.path(), &POSES, |_| (), wander);
    let (code, diagnosis, text) = diagnose(&experiment, &folder.path().join("out"));
    assert_eq!((code, diagnosis["verdict"].as_str()), (Some(12), Some("unexplained")), "{text}");
    assert!(diagnosis["causes"].as_array().is_some_and(Vec::is_empty));
}

/// The commands in what was printed, each in its words.
fn commands_in(text: &str) -> Vec<Vec<String>> {
    let commands = text.lines().filter_map(|line| line.find("rig ").map(|at| &line[at..]));
    let words = |command: &str| {
        command.split("  ").next().unwrap_or_default().split(' ').map(str::to_owned).collect::<Vec<String>>()
    };
    commands
        .map(words)
        .filter(|words| ["run", "design", "fit", "diagnose"].contains(&words[1].as_str()))
        .collect()
}

#[test]
fn every_command_that_is_told_names_files_that_are_there() {
    let folder = tempfile::tempdir().expect("a folder");
    let hide = |model: &mut Model| {
        model.add_cause("stiffness").expect("a cause");
        model.set_parameter("stiffness/stiffness", 3e-5).expect("its size");
    };
    let experiment = write(folder.path(), &POSES[..1], hide, |t| t);
    let config = system_tests::config("chain-driven-hanging.toml");
    let [experiment, config] = [&experiment, &config].map(|path| path.to_str().expect("a readable path"));
    let typed = |args: &[&str]| {
        let output = system_tests::rig(args).current_dir(folder.path()).output().expect("rig starts");
        assert!(output.status.success(), "{}", printed(&output));
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let without = typed(&["diagnose", experiment, "--out", "out"]);
    assert!(without.contains("- Next: ") && without.contains("With --config"), "{without}");
    assert_eq!(commands_in(&without), Vec::<Vec<String>>::new(), "nobody said which rig");

    let with = typed(&["diagnose", experiment, "--out", "out", "--config", config]);
    let designed = typed(&["design", experiment, "--out", "next", "--config", config]);
    for text in [with, designed] {
        let commands = commands_in(&text);
        println!("{commands:?}");
        assert!(!commands.is_empty(), "{text}");
        for command in commands {
            let path = Path::new(&command[2]);
            assert!(path.is_absolute() && path.is_file(), "{command:?}");
            config::RigConfig::read(path).expect("a rig's config");
        }
    }
    let said = json(&folder.path().join("out/diagnosis.json"));
    let next = said["next_experiments"].as_array().expect("a list");
    let commands =
        next.iter().map(|next| next["command"].as_str().expect("a command")).filter(|c| !c.is_empty());
    assert!(commands.into_iter().all(|command| command.starts_with("rig run /")), "{next:?}");
}

#[test]
fn same_input_gives_the_same_bytes_for_any_number_of_threads() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = write(folder.path(), &POSES[..1], |_| (), |t| t);
    let bytes = |threads: &str| {
        let out = folder.path().join(threads);
        let output = run_rig([
            "diagnose".as_ref(),
            experiment.as_os_str(),
            "--out".as_ref(),
            out.as_os_str(),
            "--threads".as_ref(),
            threads.as_ref(),
        ]);
        assert!(output.status.success(), "{}", printed(&output));
        std::fs::read(out.join("diagnosis.json")).expect("a diagnosis")
    };
    assert!(bytes("1") == bytes("2"));
}
