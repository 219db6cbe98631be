//! What is most often set up wrong, through `rig diagnose`: the mistake is named with its value, however large it is.

use std::path::Path;

use system_tests::hidden::cases;
use system_tests::hidden::limit::Benches;
use system_tests::hidden::write::{Film, write};
use system_tests::{json, printed, rig};

/// A case that hides nothing but the mistake.
const CASE: &str = "nothing-s54";

/// The tables of the case whose names end as the servo's do, or not, every cell after the time changed.
fn change(folder: &Path, servo: bool, cell: impl Fn(f64) -> f64, time: impl Fn(f64) -> f64) {
    for entry in std::fs::read_dir(folder).expect("the case's folder") {
        let path = entry.expect("an entry").path();
        let name = path.to_string_lossy().into_owned();
        if !name.ends_with(".csv") || name.ends_with("-servo.csv") != servo {
            continue;
        }
        let text = std::fs::read_to_string(&path).expect("a table");
        let (header, rows) = text.split_once('\n').expect("a header");
        let changed = rows.lines().map(|row| {
            let numbers = row.split(',').map(|cell| cell.parse::<f64>().expect("a number")).enumerate();
            let cells = numbers.map(|(k, x)| if k == 0 { time(x) } else { cell(x) }.to_string());
            cells.collect::<Vec<_>>().join(",") + "\n"
        });
        std::fs::write(&path, format!("{header}\n{}", changed.collect::<String>())).expect("the table");
    }
}

/// The diagnosis of the case with `mistake` made in its folder.
fn diagnosed(mistake: impl Fn(&Path)) -> serde_json::Value {
    let case = cases::all(&cases::HIDDEN, 1, &[]).into_iter().find(|case| case.id == CASE).expect("the case");
    let folder = tempfile::tempdir().expect("a folder");
    let made = case.make(&mut Benches::default()).expect("a case without anything");
    let experiment = write(&case, &made, Film::default(), folder.path()).expect("the case's files");
    mistake(folder.path());
    let out = folder.path().join("out");
    let output = rig(["diagnose".as_ref(), experiment.as_os_str(), "--out".as_ref(), out.as_os_str()])
        .output()
        .expect("rig starts");
    eprintln!("{}", printed(&output));
    json(&out.join("diagnosis.json"))
}

/// `mistake` made in the case's folder is named as `parameter`, within `within` of `value`.
fn is_named(mistake: impl Fn(&Path), parameter: &str, value: f64, within: f64) {
    let diagnosis = diagnosed(mistake);
    let causes = diagnosis["causes"].as_array().expect("a list");
    assert_eq!((diagnosis["verdict"].as_str(), causes.len()), (Some("cause"), 1), "{parameter}");
    let found = &causes[0]["parameters"][0];
    assert_eq!(found["name"], parameter);
    let found = found["value"].as_f64().expect("a value");
    assert!((found - value).abs() < within, "{parameter} = {found} instead of {value}");
}

#[test]
fn a_model_without_buoyancy_is_named() {
    let forget = |folder: &Path| {
        let path = folder.join("chain.xml");
        let model = std::fs::read_to_string(&path).expect("the model");
        std::fs::write(&path, model.replace(" gravcomp=\"0.806452\"", "")).expect("the model");
    };
    // the model's bodies displace what its boxes do
    is_named(forget, "buoyancy/scale", 1.0, 0.005);
}

#[test]
fn a_servo_that_turns_the_other_way_is_named() {
    let diagnosis = diagnosed(|folder| change(folder, true, |angle| -angle, |time| time));
    assert_eq!(diagnosis["suspects"].as_array().map(Vec::len), Some(1), "{diagnosis}");
    let said = diagnosis["suspects"][0]["sentence"].as_str().expect("a sentence");
    // which of the two it is no film tells
    assert!(said.contains("the servo turns the other way") && said.contains("x is mirrored"), "{said}");
    assert_eq!(diagnosis["causes"].as_array().map(Vec::len), Some(0), "nothing else is wrong");
}

#[test]
fn a_scale_that_is_a_tenth_too_large_is_named() {
    is_named(|folder| change(folder, false, |x| 1.1 * x, |time| time), "camera_scale/scale", 0.1, 0.003);
}

#[test]
fn a_clock_that_is_80_ms_late_is_named() {
    is_named(|folder| change(folder, false, |x| x, |time| time + 0.08), "camera_delay/delay", -0.08, 0.002);
}
