//! The soft arm from film to figures, `docs/soft-arm.md`: `cargo run -p system-tests --example soft_arm -- OUT`
//!
//! Films the arm of `configs/arm8.toml` twice in the mock tank, fits one film and predicts the other: with nothing fitted but springs, damping and
//! the servo's delay, the water's coefficients being MuJoCo's own or those of a three-link chain filmed in the same way; and with all of them.
//! Films that are in `OUT` already are taken as they are. Build the program first: `cargo build -p rig`.

#![allow(clippy::print_stdout, reason = "its output is the point")]

use std::path::{Path, PathBuf};
use std::time::Instant;

use ident::fit::Fit;
use ident::table::{read_command, read_trajectory};
use sim::{Model, RolloutOptions, rollout};
use system_tests::soft_arm::bend_degrees;
use system_tests::verbs::{Result, fit, verb};
use system_tests::{changed_config, config, only_run, set};

const LENGTH_MM: f64 = 160.0;
const COEFFICIENTS: [&str; 5] = ["blunt", "slender", "angular", "kutta", "magnus"];
/// Of each group of springs and dampers the one whose value is shown.
const OTHERS: [&str; 4] = ["q2/stiffness", "one_sided_stiffness/q2", "q2/damping", "servo_delay/delay"];
/// The strokes of the film that is fitted, and of the one that is predicted: amplitude \[rad\], counter-clockwise and clockwise stroke \[s\].
const STROKES: [(&str, [f64; 3]); 2] = [("fitted", [0.6, 1.0, 0.5]), ("predicted", [0.45, 0.8, 0.4])];

fn main() -> Result<()> {
    let out = PathBuf::from(std::env::args().nth(1).ok_or("name a folder for films and results")?);
    std::fs::create_dir_all(&out)?;
    let out = out.canonicalize()?;
    let runs = STROKES.map(|(name, strokes)| film("arm8.toml", name, Some(strokes), &out));
    let [fitted, predicted] = runs;
    let runs = [fitted?, predicted?];
    let chain = film("chain-driven-hanging.toml", "chain", None, &out)?;

    let begun = Instant::now();
    let links = fit(&chain_experiment(&chain, &out)?)?;
    let carried = COEFFICIENTS.map(|name| value(&links, &format!("g1/{name}")));
    let arm = Model::from_mjcf(&std::fs::read_to_string(config("models/arm8.xml"))?)?;
    let started = COEFFICIENTS.map(|name| arm.parameter(&format!("g1/{name}")).unwrap_or(f64::NAN));
    let ways = [
        ("MuJoCo's own", fit(&experiment("own", &runs, Some(started), &out)?)?),
        ("carried over from three links", fit(&experiment("carried", &runs, Some(carried), &out)?)?),
        ("fitted", fit(&experiment("all", &runs, None, &out)?)?),
    ];
    let fits_s = begun.elapsed().as_secs_f64();

    println!("Mean error, mm (percent of {LENGTH_MM} mm)\n");
    println!("| the water's coefficients | film | P1 | P2 |\n| --- | --- | --- | --- |");
    for (words, fit) in &ways {
        for (run, (name, _)) in fit.runs.iter().zip(STROKES) {
            let errors = run.keypoints.iter().filter(|keypoint| keypoint.name != "P0");
            let cell = |mm: f64| format!("{mm:.2} ({:.2} %)", 100.0 * mm / LENGTH_MM);
            let cells: Vec<String> = errors.map(|keypoint| cell(1e3 * keypoint.mean_error_m)).collect();
            println!("| {words} | {name} | {} |", cells.join(" | "));
        }
    }
    truth(&ways[2].1, &carried)?;
    bends(&runs, &out)?;
    println!("\n{fits_s:.1} s for the four fits");
    Ok(())
}

/// The run of the shipped config `shipped`, filmed and fitted below `out` unless it is there.
fn film(shipped: &str, name: &str, strokes: Option<[f64; 3]>, out: &Path) -> Result<PathBuf> {
    let runs = out.join(format!("film-{name}"));
    if let Some(run) = only_run(&runs) {
        return Ok(run);
    }
    std::fs::create_dir_all(&runs)?;
    let config = changed_config(shipped, &runs, |config| {
        set(config, "run", "diagnose", false);
        if let Some([amplitude_rad, ccw_s, cw_s]) = strokes {
            set(config, "profile", "amplitude_rad", amplitude_rad);
            set(config, "profile", "ccw_s", ccw_s);
            set(config, "profile", "cw_s", cw_s);
        }
    });
    verb(["run".as_ref(), config.as_os_str(), "--runs-dir".as_ref(), runs.as_os_str()])?;
    only_run(&runs).ok_or_else(|| format!("{} holds not exactly one run", runs.display()).into())
}

/// The experiment of the two `runs` of the arm, its water's coefficients free or `held`, written below `out`.
fn experiment(name: &str, runs: &[PathBuf; 2], held: Option<[f64; 5]>, out: &Path) -> Result<PathBuf> {
    let shipped: toml::Table = std::fs::read_to_string(config("arm8.toml"))?.parse()?;
    let mut experiment = toml::Table::new();
    let mut model = Model::from_mjcf(&std::fs::read_to_string(config("models/arm8.xml"))?)?;
    experiment.insert("fit".into(), shipped["fit"].clone());
    if let Some(held) = held {
        for (name, value) in COEFFICIENTS.iter().zip(held) {
            for link in 1..=8 {
                model.set_parameter(&format!("g{link}/{name}"), value)?;
            }
        }
        let fitted = ["stiffness", "damping", "one_sided_stiffness/q*", "servo_delay/delay"];
        set(&mut experiment, "fit", "parameters", fitted.map(str::to_owned).to_vec());
        set(&mut experiment, "fit", "tie", Vec::<toml::Value>::new());
        set(&mut experiment, "fit", "bounds", toml::Table::new());
    }
    let file = format!("{name}.xml");
    std::fs::write(out.join(&file), model.to_mjcf(""))?;
    experiment.insert("model".into(), file.into());
    let runs = runs.iter().zip(["fit", "holdout"]).map(|(folder, usage)| {
        let folder = folder.to_string_lossy().into_owned();
        toml::Value::Table(
            [("folder".into(), folder.into()), ("use".into(), usage.into())].into_iter().collect(),
        )
    });
    experiment.insert("run".into(), runs.collect::<Vec<_>>().into());
    written(&out.join(format!("{name}.toml")), &experiment)
}

/// The experiment of the chain's run, one set of coefficients for its three links.
fn chain_experiment(run: &Path, out: &Path) -> Result<PathBuf> {
    let mut experiment = toml::Table::new();
    let model = config("models/chain-driven-hanging.xml").to_string_lossy().into_owned();
    experiment.insert("model".into(), model.into());
    let fitted = ["fluidcoef", "damping", "frictionloss", "servo_delay/delay"].map(str::to_owned).to_vec();
    set(&mut experiment, "fit", "parameters", fitted);
    let ties = COEFFICIENTS.map(|name| toml::Value::from(vec![format!("g*/{name}")])).to_vec();
    set(&mut experiment, "fit", "tie", ties);
    let folder = run.to_string_lossy().into_owned();
    let run = toml::Value::Table([("folder".into(), folder.into())].into_iter().collect());
    experiment.insert("run".into(), vec![run].into());
    written(&out.join("chain.toml"), &experiment)
}

fn written(path: &Path, table: &toml::Table) -> Result<PathBuf> {
    std::fs::write(path, table.to_string())?;
    Ok(path.into())
}

fn value(fit: &Fit, name: &str) -> f64 {
    fit.parameters.iter().find(|parameter| parameter.name == name).map_or(f64::NAN, |found| found.value)
}

/// What was found, beside what the tank has.
fn truth(fit: &Fit, carried: &[f64; 5]) -> Result<()> {
    let tank = Model::from_mjcf(&std::fs::read_to_string(config("tanks/arm8.xml"))?)?;
    println!("\n| number | tank | three links | found | 1 sigma | |\n| --- | --- | --- | --- | --- | --- |");
    let coefficients =
        COEFFICIENTS.iter().zip(carried).map(|(name, carried)| (format!("g1/{name}"), Some(carried)));
    for (name, carried) in coefficients.chain(OTHERS.map(|name| (name.to_owned(), None))) {
        let Some(found) = fit.parameters.iter().find(|parameter| parameter.name == name) else { continue };
        let shown = |value: f64| if value < 0.01 { format!("{value:.3e}") } else { format!("{value:.3}") };
        let known = |value: Option<f64>| value.map_or(String::new(), shown);
        let remark = match (found.determined, found.at_bound) {
            (_, true) => "at its bound",
            (false, _) => "left open",
            (true, _) => "determined",
        };
        println!(
            "| {name} | {} | {} | {} | {} | {remark} |",
            known(tank.parameter(&name).ok()),
            known(carried.copied()),
            shown(found.value),
            shown(found.std)
        );
    }
    Ok(())
}

/// Bends of the arm in both strokes, as filmed and as the fitted `model` has them.
fn bends(runs: &[PathBuf; 2], out: &Path) -> Result<()> {
    println!(
        "\nBend from the first half's chord to the second half's, degrees, median of the middle third of the last strokes\n"
    );
    println!("| film | stroke | filmed | simulated |\n| --- | --- | --- | --- |");
    let model = Model::from_mjcf(&std::fs::read_to_string(out.join("all/model.xml"))?)?;
    for (run, (name, _)) in runs.iter().zip(STROKES) {
        let filmed = read_trajectory(&run.join("trajectory.csv"))?;
        let command = read_command(&run.join("servo.csv"))?;
        let simulated =
            rollout(&model, &model.rest_state(), &command, &filmed.time_s, &RolloutOptions::default())?;
        let simulated = simulated.trajectory();
        for (stroke, rising) in [("counter-clockwise, slow", true), ("clockwise, quick", false)] {
            let [filmed, simulated] =
                [&filmed, &simulated].map(|trajectory| bend_degrees(trajectory, &command, rising));
            println!("| {name} | {stroke} | {filmed:.1} | {simulated:.1} |");
        }
    }
    Ok(())
}
