//! The octopus from film to figures, `docs/octopus.md`: `cargo run -p system-tests --example octopus -- OUT`
//!
//! Films the octopus of `configs/octopus8.toml` twice in the mock tank, fits one film and predicts the other: with nothing fitted, as the paper
//! does; with the body's drag; with the water that the body carries along; with what the film of one arm left open as well. Diagnoses the first
//! film. A third film is made in a current. Films that are in `OUT` already are taken as they are. Build the program first: `cargo build -p rig`.

#![allow(clippy::print_stdout, reason = "its output is the point")]

use std::path::{Path, PathBuf};
use std::time::Instant;

use ident::experiment::Experiment;
use ident::fit::{FittedRun, fit};
use sim::{Model, Trajectory};
use system_tests::verbs::{Result, diagnose, verb};
use system_tests::{changed_config, config, only_run, set};

/// Strokes of the films: amplitude \[rad\], counter-clockwise and clockwise stroke \[s\].
const FITTED: [f64; 3] = [0.5, 1.0, 0.5];
const PREDICTED: [f64; 3] = [0.4, 0.8, 0.4];
/// Velocity of the water in the third film, to the right and upwards \[m/s\].
const CURRENT_M_PER_S: [f64; 2] = [0.005, 0.003];
/// What the film of one arm leaves open.
const OPEN: [&str; 4] = ["a*g*/slender", "a*g*/angular", "a*g*/kutta", "a*g*/magnus"];
const SHOWN: [&str; 3] = ["P0", "a1P1", "a1P2"];

fn main() -> Result<()> {
    let out = PathBuf::from(std::env::args().nth(1).ok_or("name a folder for films and results")?);
    std::fs::create_dir_all(&out)?;
    let out = out.canonicalize()?;
    let runs = [film("fitted", FITTED, None, &out)?, film("predicted", PREDICTED, None, &out)?];
    let drifting = film("current", FITTED, Some(CURRENT_M_PER_S), &out)?;
    let still = [(runs[0].as_path(), "fit"), (runs[1].as_path(), "holdout")];

    println!("Mean error, mm; way of the body, mm, filmed and simulated\n");
    println!("| fitted | film | {} | filmed | simulated | off | s |", SHOWN.join(" | "));
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    let (drag, water) = ("hub/blunt", "added_mass/hub");
    let ways: [(&str, Vec<&str>); 4] = [
        ("nothing", Vec::new()),
        ("the body's drag", vec![drag]),
        ("the body's drag and added mass", vec![drag, water]),
        ("and four coefficients of the arms", [&[drag, water][..], &OPEN[..]].concat()),
    ];
    for (words, free) in &ways {
        let held = still.map(|(run, usage)| (run, if free.is_empty() { "holdout" } else { usage }));
        shown(words, &experiment(&words.replace(' ', "-"), &held, free, &out)?)?;
    }

    let begun = Instant::now();
    let suspect = experiment("diagnosed", &still, &[&[drag][..], &OPEN[..]].concat(), &out)?;
    let diagnosis = diagnose(&suspect, &out.join("diagnosis"))?;
    println!("\n{:?} in {:.0} s", diagnosis.verdict, begun.elapsed().as_secs_f64());
    for cause in diagnosis.causes.iter().chain(&diagnosis.partial) {
        for parameter in &cause.parameters {
            let within =
                parameter.ci95.map_or_else(String::new, |[from, to]| format!(" ({from:.3} to {to:.3})"));
            println!("{} {:.3}{within}", parameter.name, parameter.value);
        }
    }

    println!("\nIn a current of {CURRENT_M_PER_S:?} m/s\n");
    let free = [&[drag, water, "current/x", "current/z"][..], &OPEN[..]].concat();
    shown("all, and the current", &experiment("current", &[(&drifting, "fit")], &free, &out)?)
}

/// The run of the shipped config with other strokes, filmed below `out` unless it is there; in a `current` if there is one.
fn film(name: &str, strokes: [f64; 3], current: Option<[f64; 2]>, out: &Path) -> Result<PathBuf> {
    let runs = out.join(format!("film-{name}"));
    if let Some(run) = only_run(&runs) {
        return Ok(run);
    }
    std::fs::create_dir_all(&runs)?;
    let tank = current.map(|[x, z]| -> Result<String> {
        let mut tank: toml::Table = std::fs::read_to_string(config("tanks/octopus8.toml"))?.parse()?;
        tank.insert("model".into(), config("tanks/octopus8.xml").to_string_lossy().into_owned().into());
        let current: toml::Table = [("x".into(), x.into()), ("z".into(), z.into())].into_iter().collect();
        set(&mut tank, "causes", "current", current);
        let file = out.join("current-tank.toml");
        std::fs::write(&file, tank.to_string())?;
        Ok(file.to_string_lossy().into_owned())
    });
    let tank = tank.transpose()?;
    let config = changed_config("octopus8.toml", &runs, |config| {
        set(config, "run", "diagnose", false);
        for (key, value) in ["amplitude_rad", "ccw_s", "cw_s"].into_iter().zip(strokes) {
            set(config, "profile", key, value);
        }
        if let Some(tank) = tank {
            // what drifts in a current is never still
            set(config, "run", "still_share", 0.01);
            set(config, "mock", "tank", tank);
        }
    });
    verb(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()])?;
    only_run(&runs).ok_or_else(|| format!("{} holds not exactly one run", runs.display()).into())
}

/// The experiment of `runs`, each with its use, with `free` parameters, written below `out`.
fn experiment(name: &str, runs: &[(&Path, &str)], free: &[&str], out: &Path) -> Result<PathBuf> {
    let shipped: toml::Table = std::fs::read_to_string(config("octopus8.toml"))?.parse()?;
    let mut experiment = toml::Table::new();
    let model = config("models/octopus8.xml").to_string_lossy().into_owned();
    experiment.insert("model".into(), model.into());
    for table in ["fit", "diagnose"] {
        experiment.insert(table.into(), shipped[table].clone());
    }
    let ties: Vec<toml::Value> =
        free.iter().filter(|name| OPEN.contains(name)).map(|name| vec![(*name).to_owned()].into()).collect();
    set(&mut experiment, "fit", "tie", ties);
    set(&mut experiment, "fit", "parameters", free.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
    let runs = runs.iter().map(|(folder, usage)| {
        let folder = folder.to_string_lossy().into_owned();
        let pairs = [("folder".into(), folder.into()), ("use".into(), (*usage).to_owned().into())];
        toml::Value::Table(pairs.into_iter().collect())
    });
    experiment.insert("run".into(), runs.collect::<Vec<_>>().into());
    let path = out.join(format!("{name}.toml"));
    std::fs::write(&path, experiment.to_string())?;
    Ok(path)
}

/// Fits `path` and prints its rows, and what was found beside what the tank has.
fn shown(words: &str, path: &Path) -> Result<()> {
    let experiment = Experiment::read(path)?;
    let fitted = fit(&experiment, &mut ())?;
    let seconds = fitted.timing.wall.as_secs_f64();
    for (run, of) in fitted.runs.iter().zip(&fitted.fit.runs) {
        let filmed = experiment.runs.iter().find(|filmed| filmed.id == run.id).ok_or("a run is lost")?;
        let begins_s = filmed.first_motion_s().ok_or("the servos never move")?;
        let [seen, simulated] = ways_m(&filmed.trajectory, &run.simulated, begins_s);
        let errors = SHOWN.map(|name| {
            let error = of.keypoints.iter().find(|keypoint| keypoint.name == name);
            error.map_or_else(String::new, |error| format!("{:.2}", 1e3 * error.mean_error_m))
        });
        println!(
            "| {words} | {} | {} | {:.1} | {:.1} | {:+.1} % | {seconds:.0} |",
            if is_fitted(run) { "fitted" } else { "held out" },
            errors.join(" | "),
            1e3 * seen,
            1e3 * simulated,
            100.0 * (simulated / seen - 1.0)
        );
    }
    let tank = Model::from_mjcf(&std::fs::read_to_string(config("tanks/octopus8.xml"))?)?;
    let mut shown: Vec<&str> = Vec::new();
    for parameter in &fitted.fit.parameters {
        // of those that are tied, one
        let kind = parameter.name.rsplit('/').next().unwrap_or_default();
        if parameter.name.starts_with('a') && parameter.name.contains('g') && shown.contains(&kind) {
            continue;
        }
        shown.push(kind);
        let known =
            tank.parameter(&parameter.name).map_or_else(|_| String::new(), |value| format!(", tank {value}"));
        println!("  {} {:.4} +- {:.4}{known}", parameter.name, parameter.value, parameter.std);
    }
    Ok(())
}

fn is_fitted(run: &FittedRun) -> bool {
    run.usage == ident::experiment::Use::Fit
}

/// How far the body rises from `begins_s` to the last image that shows it, as filmed and as `simulated` \[m\].
fn ways_m(filmed: &Trajectory, simulated: &Trajectory, begins_s: f64) -> [f64; 2] {
    let Some(body) = filmed.keypoints.iter().position(|name| name == "P0") else { return [f64::NAN; 2] };
    let seen = |row: &usize| filmed.time_s[*row] >= begins_s && filmed.at(*row, body)[2].is_finite();
    let rows: Vec<usize> = (0..filmed.time_s.len()).filter(seen).collect();
    let (Some(&first), Some(&last)) = (rows.first(), rows.last()) else { return [f64::NAN; 2] };
    [filmed, simulated].map(|trajectory| trajectory.at(last, body)[2] - trajectory.at(first, body)[2])
}
