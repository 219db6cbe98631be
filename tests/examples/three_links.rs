//! The paper's Table I on films of a tank that is not what the model says, `docs/three-links.md`:
//! `cargo run -p system-tests --example three_links -- OUT`
//!
//! Films the four cases in real time (about 40 s), reads keypoints from them in both ways, and takes three rungs on one passive and one driven
//! case: the paper's recipe (thirds of the centreline, CMA-ES), least squares, and the model that the diagnosis extends, fitted again.
//! Predicts the other two cases by each. Films that are in `OUT` already are taken as they are. Where `RIG_PYTHON` names a Python with mujoco and
//! numpy, the same once more on keypoints of a tank that MuJoCo moves. Build the program first: `cargo build -p rig`.

#![allow(clippy::print_stdout, reason = "its output is the point")]

use std::path::{Path, PathBuf};
use std::time::Instant;

use ident::diagnose::Diagnosis;
use system_tests::three_links::{
    CASES, Case, CommandForm, Reading, Rung, errors_by_the_tank_mm, in_mujoco, named, noise_mm, parameters,
    table, write_experiment, write_thirds_model,
};
use system_tests::verbs::{Result, diagnose, fit};
use system_tests::{only_run, set};

/// Where a fit starts, as seen from the folders of the readings.
const MODEL: &str = "../rig/chain.xml";

fn main() -> Result<()> {
    let out = PathBuf::from(std::env::args().nth(1).ok_or("name a folder for films and results")?);
    let films = films(&out)?;
    let whole = Instant::now();
    let (thirds, links) = (out.join("thirds"), out.join("links"));
    let read_s = extract(&films, Reading::Thirds, &thirds)?;
    write_thirds_model(&thirds, &thirds.join("thirds.xml"))?;
    let mut rungs = vec![recipe(&thirds, "thirds.xml", read_s)?];
    let read_s = extract(&films, Reading::Links, &links)?;
    let diagnosis = ours(&links, read_s, &mut rungs)?;
    report(&out.join("table.md"), &rungs, &links, &diagnosis)?;
    by_the_tank(&links)?;
    engines(&links)?;
    println!("all of it, from the films to here: {:.1} s\n", whole.elapsed().as_secs_f64());

    let Some(python) = std::env::var_os("RIG_PYTHON") else {
        println!("left out: the tank that MuJoCo moves (RIG_PYTHON names no Python with mujoco and numpy)");
        return Ok(());
    };
    let moved = out.join("mujoco");
    in_mujoco(&python, &out.join("rig"), &links, &moved)?;
    let mut rungs = vec![recipe(&moved, MODEL, 0.0)?];
    let diagnosis = ours(&moved, 0.0, &mut rungs)?;
    report(&out.join("table-mujoco.md"), &rungs, &moved, &diagnosis)
}

/// The cases with their rig configs and the folders of their runs.
fn films(out: &Path) -> Result<Vec<(Case, PathBuf, PathBuf)>> {
    let film = |case: Case| {
        let config = case.write(&out.join("rig"), |_| {})?;
        let run = match only_run(&out.join(format!("{}-film", case.id))) {
            Some(run) => run,
            None => case.film(&config, out)?,
        };
        Ok((case, config, run))
    };
    CASES.into_iter().map(film).collect()
}

fn extract(films: &[(Case, PathBuf, PathBuf)], reading: Reading, folder: &Path) -> Result<f64> {
    let begun = Instant::now();
    for (case, config, run) in films {
        case.extract(config, run, reading, folder)?;
    }
    Ok(begun.elapsed().as_secs_f64())
}

fn recipe(folder: &Path, model: &str, read_s: f64) -> Result<Rung> {
    rung("the paper's recipe", read_s, &write_experiment(folder, "recipe", model, "paper", &[])?)
}

/// Both of our rungs on the keypoints in `folder`, and what the diagnosis between them says.
fn ours(folder: &Path, read_s: f64, rungs: &mut Vec<Rung>) -> Result<Diagnosis> {
    let before = write_experiment(folder, "before", MODEL, "least-squares", &[])?;
    rungs.push(rung("ours, before diagnosis", read_s, &before)?);
    let begun = Instant::now();
    let diagnosis = diagnose(&before, &folder.join("diagnosed"))?;
    let beside = parameters(named(&diagnosis));
    let after = write_experiment(folder, "after", "diagnosed/model.xml", "least-squares", &beside)?;
    rungs.push(rung("ours, after diagnosis", read_s + begun.elapsed().as_secs_f64(), &after)?);
    Ok(diagnosis)
}

fn rung(name: &'static str, before_s: f64, experiment: &Path) -> Result<Rung> {
    let begun = Instant::now();
    let fit = fit(experiment)?;
    Ok(Rung { name, fit, wall_s: before_s + begun.elapsed().as_secs_f64() })
}

/// Prints how far the keypoints in `folder` are from where the tank's own model has them.
fn by_the_tank(folder: &Path) -> Result<()> {
    for case in CASES.iter().filter(|case| case.centre_rad.is_some()) {
        for (form, words) in
            [(CommandForm::Profile, "as the profile says"), (CommandForm::Pulses, "in whole pulses")]
        {
            let errors_mm =
                errors_by_the_tank_mm(case, folder, form)?.map(|mm| format!("{mm:.3}")).join(", ");
            println!("{} by the tank's own model, its servo told {words}: {errors_mm} mm", case.words);
        }
    }
    Ok(())
}

/// Prints what one set of coefficients for all links comes to in MuJoCo before 3.14, in which small links have no Kutta lift, and after: what the
/// tank has beside the model fitted in both.
fn engines(folder: &Path) -> Result<()> {
    let old = "chain-before-3.14.xml";
    let mark = "<custom><text name=\"kutta_lift\" data=\"before-3.14\"/></custom>\n  <worldbody>";
    std::fs::write(folder.join(old), system_tests::three_links::MODEL.replacen("<worldbody>", mark, 1))?;
    let beside =
        ["added_mass/scale", "current/x", "camera_delay/delay", "servo_delay/delay"].map(str::to_owned);
    let coefficients = ["blunt", "slender", "angular", "kutta", "magnus"];
    for (words, name, model) in [("from 3.14 on", "engine-new", MODEL), ("before 3.14", "engine-old", old)] {
        let path = write_experiment(folder, name, model, "least-squares", &beside)?;
        let mut experiment: toml::Table = std::fs::read_to_string(&path)?.parse()?;
        let ties = coefficients.map(|name| toml::Value::from(vec![format!("*/{name}")]));
        set(&mut experiment, "fit", "tie", ties.to_vec());
        std::fs::write(&path, experiment.to_string())?;
        let rung = rung(words, 0.0, &path)?;
        println!("MuJoCo {words}:");
        for parameter in &rung.fit.parameters {
            if parameter.name.starts_with("g1/") {
                println!("  {} = {:.3} +- {:.3}", parameter.name, parameter.value, parameter.std);
            }
        }
        for case in CASES {
            let errors_mm =
                rung.errors_mm(&case).map(|errors| errors.map(|mm| format!("{mm:.3}")).join(", "));
            println!("  {}: {} mm", case.words, errors_mm.unwrap_or_default());
        }
    }
    Ok(())
}

/// Prints the table, which goes to `path` too, and what is said of the keypoints in `folder`.
fn report(path: &Path, rungs: &[Rung], folder: &Path, diagnosis: &Diagnosis) -> Result<()> {
    let mut noise = Vec::new();
    for case in CASES {
        noise.push(noise_mm(&case, folder, diagnosis)?);
    }
    let table = table(rungs, &noise);
    std::fs::write(path, &table)?;
    println!("{table}\n{}: {}", diagnosis.verdict.name(), diagnosis.sentence);
    for parameter in named(diagnosis).iter().flat_map(|cause| &cause.parameters) {
        let within =
            parameter.ci95.map_or_else(String::new, |[low, high]| format!(" ({low:.3e} to {high:.3e})"));
        println!("{} = {:.3e}{within} {}", parameter.name, parameter.value, parameter.unit);
    }
    for remark in &diagnosis.remarks {
        println!("- {remark}");
    }
    Ok(())
}
