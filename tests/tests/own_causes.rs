//! A cause that somebody writes down, from `experiment.toml` to the report: hidden by the generator that shares no code with the
//! simulation, named by `rig diagnose`, fitted by `rig fit`, and refused where it is wrong.

use std::path::{Path, PathBuf};

use serde_json::Value;
use system_tests::hidden::cases::{Case, Kind, Made};
use system_tests::hidden::terms::Hidden;
use system_tests::hidden::three_links;
use system_tests::hidden::write::{Film, write};
use system_tests::{json, printed, run_rig};

/// Torque of the detent in the second hinge \[N m\]: a tenth of what the links' weight makes there.
const DETENT_N_M: f64 = 1e-5;
/// Greatest pull of the magnet on the tip \[N\].
const MAGNET_N: f64 = 4e-4;

const DETENT: &str = r#"
[[cause]]
name = "detent"
sentence = "the second hinge catches in eight notches a turn"
joint = "q2"
torque = "-size * sin(8 * q)"
parameters = { size = { unit = "N m", bounds = [0.0, 1e-2], typical = 1e-5 } }
"#;

/// A pull towards a place that is not known but for a guess, weaker with the distance.
const MAGNET: &str = r#"
[[cause]]
name = "magnet"
body = "link3"
point = [0.0, 0.0, -0.0275]
force_x = "size * (x0 - x) / sqrt((x0 - x)^2 + (z0 - z)^2 + 1e-6) / (1 + (((x0 - x)^2 + (z0 - z)^2) / 0.02^2)^2)"
force_z = "size * (z0 - z) / sqrt((x0 - x)^2 + (z0 - z)^2 + 1e-6) / (1 + (((x0 - x)^2 + (z0 - z)^2) / 0.02^2)^2)"

[cause.parameters]
size = { unit = "N", bounds = [-1.0, 1.0], typical = 1e-3 }
x0 = { unit = "m", bounds = [-0.1, 0.1], typical = 0.02, hidden = [-0.04, 0.04] }
z0 = { unit = "m", bounds = [-0.1, 0.1], typical = 0.02, hidden = [-0.05] }
"#;

/// Writes the runs of a chain with what is `hidden`, and an experiment that knows `causes`; its path.
fn experiment(folder: &Path, hidden: Hidden, causes: &str) -> PathBuf {
    std::fs::create_dir_all(folder).expect("a folder");
    let made = Made { bench: three_links::draw(1, true), hidden, truth: Vec::new() };
    let case = Case { id: "own".into(), seed: 1, kind: Kind::Nothing };
    let path = write(&case, &made, Film::default(), folder).expect("the case's files");
    let text = std::fs::read_to_string(&path).expect("the experiment");
    std::fs::write(&path, text + causes).expect("the experiment");
    path
}

fn diagnosis(experiment: &Path) -> Value {
    let out = experiment.with_file_name("out");
    let output = run_rig(["diagnose".as_ref(), experiment.as_os_str(), "--out".as_ref(), out.as_os_str()]);
    let text = printed(&output);
    eprintln!("{text}");
    assert!(output.status.success(), "{text}");
    json(&out.join("diagnosis.json"))
}

fn names(diagnosis: &Value) -> Vec<&str> {
    diagnosis["causes"].as_array().into_iter().flatten().filter_map(|cause| cause["name"].as_str()).collect()
}

/// Value and interval of the parameter called `name` of the first cause.
fn found(diagnosis: &Value, name: &str) -> [f64; 3] {
    let parameters = diagnosis["causes"][0]["parameters"].as_array().expect("parameters");
    let parameter = parameters.iter().find(|parameter| parameter["name"] == name).expect("the parameter");
    [&parameter["value"], &parameter["ci95"][0], &parameter["ci95"][1]].map(|x| x.as_f64().expect("a number"))
}

#[test]
fn a_detent_is_named_by_whoever_writes_it_down_and_mistaken_for_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let hidden = || Hidden::default().with("detent/q2", DETENT_N_M);
    let with = experiment(&folder.path().join("with"), hidden(), DETENT);
    let diagnosed = diagnosis(&with);
    assert_eq!((diagnosed["verdict"].as_str(), names(&diagnosed)), (Some("cause"), vec!["detent"]));
    let [value, low, high] = found(&diagnosed, "detent/size");
    println!("{value:e} in {low:e}..{high:e}, hidden {DETENT_N_M:e}");
    assert!(low < DETENT_N_M && DETENT_N_M < high && high - low < 0.2 * DETENT_N_M);
    let cause = &diagnosed["causes"][0];
    assert_eq!(cause["formula"], "torque = -size * sin(8 * q) at joint `q2`");
    assert_eq!(cause["sentence"], "the second hinge catches in eight notches a turn");
    // over the best that lacks it, an unknown force that follows the joint's angle among it
    assert!(cause["probability"].as_f64().is_some_and(|probability| probability > 0.999), "{cause}");
    let text = |file: &str| std::fs::read_to_string(with.with_file_name("out").join(file)).expect("a file");
    assert!(text("report.html").contains("-size * sin(8 * q)"));
    assert!(
        text("model.xml").contains("its numbers go with [[cause]] torque = -size * sin(8 * q) at joint `q2`")
    );

    // what a diagnosis says that does not know it
    let without = experiment(&folder.path().join("without"), hidden(), "");
    let diagnosed = diagnosis(&without);
    println!("without: {} {:?}", diagnosed["verdict"], names(&diagnosed));
    assert_eq!(diagnosed["verdict"], "unexplained");
    assert!(names(&diagnosed).is_empty());
}

#[test]
fn a_magnet_is_found_with_its_place() {
    let folder = tempfile::tempdir().expect("a folder");
    let hidden = Hidden::default().with("magnet/force", MAGNET_N);
    let path = experiment(&folder.path().join("magnet"), hidden, MAGNET);
    let diagnosed = diagnosis(&path);
    assert_eq!((diagnosed["verdict"].as_str(), names(&diagnosed)), (Some("cause"), vec!["magnet"]));
    for (name, truth) in [("magnet/size", MAGNET_N), ("magnet/x0", 0.05), ("magnet/z0", -0.06)] {
        let [value, low, high] = found(&diagnosed, name);
        println!("{name}: {value:e} in {low:e}..{high:e}, hidden {truth:e}");
        assert!(low < truth && truth < high && low * high > 0.0, "{name}: {value:e} in {low:e}..{high:e}");
        // how strong it is trades with how far it is, where it is does not
        let is_place = name != "magnet/size";
        assert!(!is_place || high - low < 0.02, "{name}: {low:e}..{high:e}");
    }
}

#[test]
fn nothing_hidden_is_no_detent() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = experiment(&folder.path().join("nothing"), Hidden::default(), DETENT);
    let diagnosed = diagnosis(&path);
    assert_eq!((diagnosed["verdict"].as_str(), names(&diagnosed)), (Some("nothing-detectable"), vec![]));
    let detectable = diagnosed["detectable"].as_array().expect("a list");
    let own = detectable.iter().find(|entry| entry["name"] == "detent/size").expect("it is listed");
    assert!(own["smallest"].as_f64().is_some_and(|size| size < 0.3 * DETENT_N_M), "{own}");
}

#[test]
fn its_size_is_fitted_by_name_and_survives_the_way_through_the_model() {
    let folder = tempfile::tempdir().expect("a folder");
    let hidden = Hidden::default().with("detent/q2", DETENT_N_M);
    let path = experiment(folder.path(), hidden, DETENT);
    let text = std::fs::read_to_string(&path).expect("the experiment");
    std::fs::write(&path, text.replace("\"damping\"]", "\"damping\", \"detent/size\"]"))
        .expect("the experiment");
    let out = folder.path().join("out");
    let fit = |out: &Path| {
        let output = run_rig(["fit".as_ref(), path.as_os_str(), "--out".as_ref(), out.as_os_str()]);
        assert!(output.status.success(), "{}", printed(&output));
        json(&out.join("fit.json"))
    };
    let fitted = fit(&out);
    let parameters = fitted["parameters"].as_array().expect("parameters");
    let size = parameters.iter().find(|parameter| parameter["name"] == "detent/size").expect("the size");
    let [value, std] = ["value", "std"].map(|key| size[key].as_f64().expect("a number"));
    println!("{value:e} +- {std:e}");
    assert!((value - DETENT_N_M).abs() < 4.0 * std && std < 0.05 * DETENT_N_M, "{value:e} {std:e}");

    // a fit that goes on from the calibrated model begins at its number
    let text = std::fs::read_to_string(&path).expect("the experiment");
    let text = text.replace("model = \"chain.xml\"", "model = \"out/model.xml\"");
    let text = text.replace("\"damping\", \"detent/size\"]", "\"damping\"]");
    std::fs::write(&path, text).expect("the experiment");
    let again = fit(&folder.path().join("again"));
    let loss = |fit: &Value| fit["loss_m2"].as_f64().expect("a loss");
    assert!(loss(&again) < 1.02 * loss(&fitted), "{:e} {:e}", loss(&again), loss(&fitted));
}

#[test]
fn what_is_wrong_with_it_is_shown_in_the_experiment_where_it_stands() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = experiment(folder.path(), Hidden::default(), DETENT);
    let good = std::fs::read_to_string(&path).expect("the experiment");
    let cases = [
        (
            "-size *",
            "-siz *",
            "there is no number called `siz` (did you mean `size`?)",
            "torque = \"-siz * sin(8 * q)\"",
            "^^^",
        ),
        ("sin(8 * q)\"", "sin(8 * q\"", "this `(` is never closed", "torque = \"-size * sin(8 * q\"", "^"),
        (
            "joint = \"q2\"",
            "joint = \"q4\"",
            "the model has no hinge or slide `q4` (did you mean `q1`?)",
            "joint = \"q4\"",
            "^^",
        ),
        ("8 * q)", "8 * q + command)", "no actuator drives the joint `q2`", "torque = ", "^^^^^^^"),
        ("sin(8 * q)", "sin(8 * q) + 1e-7", "it must vanish there", "torque = ", "^^^^"),
        ("name = \"detent\"", "name = \"wall\"", "a known cause is called that", "name = \"wall\"", "^^^^"),
        ("torque =", "torqe =", "did you mean `torque`?", "torqe = ", "^^^^^"),
        ("[0.0, 1e-2]", "[0.0, 1.0, 2.0]", "bounds are [lower, upper], not 3 numbers", "bounds", "^"),
    ];
    for (old, new, reason, line, carets) in cases {
        assert!(good.contains(old), "{old}");
        std::fs::write(&path, good.replace(old, new)).expect("the experiment");
        let out = folder.path().join("out");
        let output = run_rig(["diagnose".as_ref(), path.as_os_str(), "--out".as_ref(), out.as_os_str()]);
        let text = printed(&output);
        println!("{text}");
        assert!(!output.status.success(), "{text}");
        let number =
            good.replace(old, new).lines().position(|text| text.contains(line)).map(|index| index + 1);
        let shown = format!("line {}", number.expect("the line"));
        for part in [reason, line, carets, &shown] {
            assert!(text.contains(part), "{part} is missing in {text}");
        }
    }
}
