//! A camera above a horizontal rig whose model moves in x and y: `view = "x-y"` from the calibration to the report.

use std::fmt::Write as _;
use std::path::Path;

use camera::calibration::{Plane, View};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, Normal};
use sim::Model;
use system_tests::*;
use tank::render::{Look, Renderer};

/// What the water and the joints really do; the shipped model is where the fit starts.
const TRUTH: [&str; 3] = ["0.9 0.1 1.1 0.6 0.9", "0.5 0.3 1.9 1.4 0.4", "0.8 0.2 1.3 0.9 1.2"];
const METRES_PER_PX: f64 = 0.00025;
const ORIGIN_PX: [f64; 2] = [320.0, 420.0];
/// 50 images a second.
const EVERY_S: f64 = 0.02;
const SECONDS: usize = 6;
/// Pivot to pivot, the last one to the tip \[m\].
const LENGTHS_M: [f64; 3] = [0.025, 0.025, 0.0275];
/// Noise of the sensor, 1 sigma \[grey levels\].
const NOISE_GREY: f64 = 4.0;
/// What extraction leaves of a keypoint in such pictures, root mean square \[m\]: a fifth of a pixel.
const KEYPOINT_M: f64 = 5e-5;
/// 95 % of estimates lie within 2 standard deviations; of a dozen one may lie further out, and none beyond 4.
const SIGMAS: f64 = 4.0;
/// A camera without a fault leaves so little that what pixels and steps leave counts beside it, as a share of a coefficient.
const LEFT_SHARE: f64 = 0.02;

/// The shipped chain that is driven in a horizontal plane, which moves in x and z with gravity along y.
fn in_x_and_z() -> String {
    std::fs::read_to_string(config("models/chain-driven-flat.xml")).expect("a shipped model")
}

/// The same laid flat: it moves in x and y with gravity along -z.
fn in_x_and_y() -> String {
    let turned = [
        ("gravity=\"0 9.81 0\"", "gravity=\"0 0 -9.81\""),
        ("axis=\"0 -1 0\"", "axis=\"0 0 1\""),
        ("size=\"0.005 0.0025 0.015\" pos=\"0 0 0.0125\"", "size=\"0.005 0.015 0.0025\" pos=\"0 0.0125 0\""),
        ("pos=\"0 0 0.025\"", "pos=\"0 0.025 0\""),
        ("pos=\"0 0 0.0275\"", "pos=\"0 0.0275 0\""),
    ];
    turned.into_iter().fold(in_x_and_z(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    })
}

fn with_truth(text: &str) -> String {
    let number = |text: String, i: usize| {
        text.replacen("fluidcoef=\"0.5 0.25 1.5 1 1\"", &format!("fluidcoef=\"{}\"", TRUTH[i]), 1)
    };
    (0..3).fold(text.to_owned(), number).replace("1e-06", "3e-06")
}

fn succeed(command: &mut std::process::Command) -> String {
    let output = command.output().expect("rig starts");
    let text = printed(&output);
    assert!(output.status.success(), "{text}");
    text
}

fn table(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let mut reader = csv::Reader::from_path(path).expect("a table");
    let titles = reader.headers().expect("titles").iter().map(str::to_owned).collect();
    let number = |cell: &str| cell.parse().unwrap_or(f64::NAN);
    let rows = reader.records().map(|row| row.expect("a row").iter().map(number).collect()).collect();
    (titles, rows)
}

/// How `model` moves, by the name of each column.
fn moves(at: &Path, name: &str, model: &str) -> (Vec<String>, Vec<Vec<f64>>) {
    let (path, out) = (at.join(format!("{name}.xml")), at.join(format!("{name}-moves.csv")));
    std::fs::write(&path, model).expect("a file");
    succeed(
        rig(["simulate", "--accuracy-m=1e-8"])
            .arg(path)
            .args([format!("--duration-s={SECONDS}"), format!("--every-s={EVERY_S}"), "--servo".into()])
            .arg(at.join("servo.csv"))
            .arg("--out")
            .arg(&out),
    );
    table(&out)
}

fn column<'a>(
    (titles, rows): &'a (Vec<String>, Vec<Vec<f64>>),
    title: &str,
) -> impl Iterator<Item = f64> + 'a {
    let at = titles.iter().position(|other| other == title).unwrap_or_else(|| panic!("{title}: {titles:?}"));
    rows.iter().map(move |row| row[at])
}

/// Strokes of growing size, the counter-clockwise one twice as long.
fn write_servo(at: &Path) {
    let mut text = String::from("time_s,servo_rad\n");
    for step in 0..=SECONDS * 100 {
        let time_s = step as f64 * 0.01;
        let phase = (time_s - 0.3).max(0.0) % 1.2;
        let share = if phase < 0.8 { phase / 0.8 } else { (1.2 - phase) / 0.4 };
        let amplitude = if time_s < 1.5 { 0.5 } else { 1.0 };
        let _ =
            writeln!(text, "{time_s:.2},{}", amplitude * (1.0 - (std::f64::consts::PI * share).cos()) / 2.0);
    }
    std::fs::write(at.join("servo.csv"), text).expect("a file");
}

/// The calibration file that a camera square to the plane comes to.
fn write_calibration(at: &Path, view: &str) {
    let ([column, row], s) = (ORIGIN_PX, METRES_PER_PX);
    let text = format!(
        "view = \"{view}\"\nmetres_from_pixels = [\n    [{s:?}, 0.0, {:?}],\n    [0.0, {:?}, {:?}],\n    [0.0, 0.0, 1.0],\n]\n\
         radial_centre_px = [319.5, 239.5]\nradial_per_px2 = 0.0\npicture_px = [640, 480]\n",
        -s * column,
        -s,
        s * row
    );
    std::fs::write(at.join(format!("tank-{view}.toml")), text).expect("a file");
    let config = format!(
        "[calibration]\nfile = \"tank-{view}.toml\"\n[camera]\nfps = {}\n[mechanism]\nmount = \"horizontal\"\n\
         [vision]\ncamera_distance_m = 100.0 # drawn without perspective\n",
        1.0 / EVERY_S
    );
    std::fs::write(at.join(format!("mine-{view}.toml")), config).expect("a file");
}

fn extract(at: &Path, view: &str) -> std::process::Command {
    let mut command = rig(["extract"]);
    command.arg(at.join("frames")).arg("--config").arg(at.join(format!("mine-{view}.toml")));
    command.arg("--model").arg(at.join("chain.xml")).arg("--out").arg(at.join("t.csv"));
    command.arg("--centreline").arg(at.join("lines.csv"));
    command
}

#[test]
fn chain_that_moves_in_x_and_y_is_filmed_extracted_and_fitted_from_above() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    write_servo(at);
    let truth = moves(at, "truth", &with_truth(&in_x_and_y()));
    // The same water, seen from the side of a model that lies in x and z: y stands for z, counter-clockwise stays positive.
    let beside = moves(at, "beside", &with_truth(&in_x_and_z()));
    for (above, side) in [("P3_x_m", "P3_x_m"), ("P3_y_m", "P3_z_m"), ("q2", "q2")] {
        let off = column(&truth, above).zip(column(&beside, side)).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f64::max) < 1e-9, "{above} {side}");
    }

    let model = Model::from_mjcf(&with_truth(&in_x_and_y())).expect("a model");
    let plane = Plane::square(METRES_PER_PX, ORIGIN_PX).viewed(View::Xy);
    let renderer = Renderer::new(plane, Look::plain(640, 480));
    let frames = at.join("frames");
    std::fs::create_dir(&frames).expect("a folder");
    let angles: Vec<Vec<f64>> = ["q0", "q1", "q2"].map(|q| column(&truth, q).collect()).into();
    let (noise, mut random) =
        (Normal::new(0.0, NOISE_GREY).expect("a deviation"), ChaCha8Rng::seed_from_u64(3));
    for image in 0..truth.1.len() {
        let qpos: Vec<f64> = angles.iter().map(|q| q[image]).collect();
        let mut picture = renderer.draw(&model, &qpos);
        for grey in picture.iter_mut() {
            *grey = (f64::from(*grey) + noise.sample(&mut random)).round().clamp(0.0, 255.0) as u8;
        }
        picture.save(frames.join(format!("{image:05}.png"))).expect("a picture");
    }
    std::fs::write(at.join("chain.xml"), in_x_and_y()).expect("a file");
    write_calibration(at, "x-y");
    succeed(&mut extract(at, "x-y"));

    let seen = table(&at.join("t.csv"));
    assert!(seen.0.starts_with(&["time_s", "P0_x_m", "P0_y_m"].map(str::to_owned)), "{:?}", seen.0);
    assert!(table(&at.join("lines.csv")).0[1..3] == ["c0_x_m", "c0_y_m"]);
    for k in 1..=3 {
        for axis in ["x", "y"] {
            let title = format!("P{k}_{axis}_m");
            let squares = column(&seen, &title).zip(column(&truth, &title)).map(|(a, b)| (a - b).powi(2));
            let rms_m = (squares.sum::<f64>() / seen.1.len() as f64).sqrt();
            eprintln!("{title}: rms {:.1} um", rms_m * 1e6);
            assert!(rms_m < KEYPOINT_M, "{title}: {rms_m}");
        }
    }
    for (k, length_m) in LENGTHS_M.iter().enumerate() {
        let side = |axis: &str| {
            let (from, to) = (format!("P{k}_{axis}_m"), format!("P{}_{axis}_m", k + 1));
            column(&seen, &to).zip(column(&seen, &from)).map(|(a, b)| a - b).collect::<Vec<f64>>()
        };
        let lengths = side("x").into_iter().zip(side("y")).map(|(x, y)| x.hypot(y));
        let mean_m = lengths.sum::<f64>() / seen.1.len() as f64;
        eprintln!("link {}: {:.3} mm", k + 1, mean_m * 1e3);
        assert!((mean_m - length_m).abs() < KEYPOINT_M, "{mean_m} {length_m}");
    }

    coefficients_are_recovered(&fit(at));
    let report = std::fs::read_to_string(at.join("fitted/report.html")).expect("a report");
    assert!(report.contains("y [mm]") && !report.contains("z [mm]"));

    // There and back by another program's file, which knows pixels only.
    let config = at.join("mine-x-y.toml");
    for (verb, from, to) in [("export", "t.csv", "dlc.csv"), ("import", "dlc.csv", "back.csv")] {
        let (from, to) = (at.join(from), at.join(to));
        succeed(rig([verb, "dlc"]).arg(from).arg("--config").arg(&config).arg("--out").arg(to));
    }
    let back = table(&at.join("back.csv"));
    for title in ["P3_x_m", "P3_y_m"] {
        let off = column(&seen, title).zip(column(&back, title)).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f64::max) < 1e-9, "{title}");
    }

    // The same pictures by a calibration that takes them for a camera at the side: not of this model, but of its twin.
    write_calibration(at, "x-z");
    let refused = extract(at, "x-z").output().expect("rig starts");
    let text = printed(&refused);
    assert!(refused.status.code() == Some(2) && text.contains("none of its hinges turns there"), "{text}");
    std::fs::write(at.join("chain.xml"), in_x_and_z()).expect("a file");
    succeed(&mut extract(at, "x-z"));
    let titles: Vec<String> = seen.0.iter().map(|title| title.replace("_y_m", "_z_m")).collect();
    assert_eq!(table(&at.join("t.csv")), (titles, seen.1));
}

/// A fitted coefficient.
#[derive(Debug)]
struct Fitted {
    name: String,
    value: f64,
    std: f64,
    determined: bool,
}

fn fit(at: &Path) -> Vec<Fitted> {
    let (experiment, out) = (at.join("experiment.toml"), at.join("fitted"));
    let text = "model = \"chain.xml\"\n[[run]]\nid = \"strokes\"\nkind = \"driven\"\ntrajectory = \"t.csv\"\nservo = \"servo.csv\"\n";
    std::fs::write(&experiment, text).expect("a file");
    succeed(rig(["fit"]).arg(experiment).arg("--out").arg(&out));
    let text = std::fs::read_to_string(out.join("fit.json")).expect("a fit");
    let fit: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let parameter = |parameter: &serde_json::Value| Fitted {
        name: parameter["name"].as_str().expect("a name").into(),
        value: parameter["value"].as_f64().expect("a value"),
        std: parameter["std"].as_f64().expect("a deviation"),
        determined: parameter["determined"] == true && parameter["at_bound"] == false,
    };
    fit["parameters"].as_array().expect("a list").iter().map(parameter).collect()
}

fn coefficients_are_recovered(fitted: &[Fitted]) {
    let truth = Model::from_mjcf(&with_truth(&in_x_and_y())).expect("a model");
    let mut determined = 0;
    for Fitted { name, value, std, determined: known } in fitted {
        let true_value = truth.parameter(name).expect("a parameter of the model");
        eprintln!("{name}: {value:.3e}, true {true_value:.3e}, std {std:.1e}, {known}");
        if *known {
            determined += 1;
            let off = (value - true_value).abs();
            assert!(
                off < f64::max(SIGMAS * std, LEFT_SHARE * true_value),
                "{name} {value} {true_value} {std}"
            );
        }
    }
    assert!(determined >= 10, "{determined}");
}
