//! Campaigns on mock tanks, through `rig campaign`: `cargo run -p system-tests --example campaigns -- OUT [--tanks 20] [--goals]`, in real
//! time, some 40 s a tank. Build the program first: `cargo build -p rig`.
//!
//! Each tank hides a servo that lags or acts late, in water of its own, behind a first run that is too gentle to tell; a campaign of at most
//! four runs has to name it. With `--goals` nothing is hidden: a parameter is to be known three times as well as the first run lets it, and
//! runs of a campaign are counted beside those of repeating the first one. Every finished tank is a line of `OUT/outcomes.jsonl`; started
//! again, it goes on where it stopped.

#![allow(clippy::print_stdout, reason = "its output is the point")]

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;
use system_tests::campaign::{Hidden, Tank};
use system_tests::journal::Journal;
use system_tests::{json, printed, run_rig};

/// How a tank went.
#[derive(Debug, Serialize, Deserialize)]
struct Outcome {
    tank: u64,
    /// What was hidden, or the goal.
    asked: String,
    /// What the first run said.
    first: String,
    /// What was said in the end.
    last: String,
    runs: usize,
    /// Of the rival that repeats the first run; 0 where there is none.
    repeated: usize,
    right: bool,
}

/// The most runs that a campaign to resolve something may make.
const MOST_RUNS: &str = "4";
/// The most runs that repeating may take.
const MOST_REPEATED: usize = 20;
/// By so much the goal is below what the first run leaves open.
const SHARPER: f64 = 3.0;
/// The parameter of the goals.
const PARAMETER: &str = "q2/damping";

fn resolved(tank: u64, folder: &Path) -> Result<Outcome, String> {
    let hidden = Hidden::drawn(tank);
    let rig = Tank::new(folder, Some(hidden), tank);
    let output = rig.campaign(&["--resolve", "--max-runs", MOST_RUNS]).output().map_err(|e| e.to_string())?;
    let code = output.status.code();
    if !matches!(code, Some(0 | 4)) {
        return Err(printed(&output));
    }
    let record = rig.record();
    if record["state"] == "running" {
        return Err(printed(&output));
    }
    let steps = record["steps"].as_array().cloned().unwrap_or_default();
    let verdict = |step: Option<&Value>| -> String {
        step.and_then(|step| step["verdict"].as_str()).unwrap_or_default().into()
    };
    let named = rig.named().iter().map(|names| names[0].clone()).collect::<Vec<_>>();
    Ok(Outcome {
        tank,
        asked: format!("{hidden:?}"),
        first: verdict(steps.first()),
        last: format!("{} {}", verdict(steps.last()), named.join(" + ")),
        runs: steps.len(),
        repeated: 0,
        right: code == Some(0) && rig.names(hidden),
    })
}

/// Value and standard deviation of [`PARAMETER`] in a `fit.json`.
fn known(fit: &Path) -> Option<(f64, f64)> {
    let fit = json(fit);
    let found = fit["parameters"].as_array()?.iter().find(|one| one["name"] == PARAMETER)?;
    Some((found["value"].as_f64()?, found["std"].as_f64()?))
}

fn sharpened(tank: u64, folder: &Path) -> Result<Outcome, String> {
    let rig = Tank::new(folder, None, tank);
    let config = rig.config.display().to_string();
    let repeats = folder.join("repeated").display().to_string();
    let ran = |output: std::process::Output| {
        if output.status.success() { Ok(output) } else { Err(printed(&output)) }
    };
    let mut first = None;
    let repeated = loop {
        ran(run_rig(["run", &config, "--runs-dir", &repeats]))?;
        let runs = folders(Path::new(&repeats));
        let experiment = folder.join("experiment.toml").display().to_string();
        let out = folder.join("fit").display().to_string();
        let all = runs.iter().map(String::as_str);
        ran(run_rig(["experiment"].into_iter().chain(all).chain(["--out", &experiment])))?;
        ran(run_rig(["fit", &experiment, "--out", &out]))?;
        let (value, std) = known(&Path::new(&out).join("fit.json")).ok_or("no such parameter")?;
        let first = *first.get_or_insert(std);
        println!("tank {tank}: {} runs repeated: {value:.3e} ± {std:.2e}", runs.len());
        if std <= first / SHARPER || runs.len() == MOST_REPEATED {
            break runs.len();
        }
    };
    let goal = format!("{PARAMETER} {}", first.ok_or("no run")? / SHARPER);
    let output = rig.campaign(&["--goal", &goal, "--max-runs", "12"]).output().map_err(|e| e.to_string())?;
    if !matches!(output.status.code(), Some(0 | 4)) {
        return Err(printed(&output));
    }
    let steps = rig.record()["steps"].as_array().cloned().unwrap_or_default();
    let said = |step: Option<&Value>| -> String {
        step.map_or_else(String::new, |step| {
            let number = |key: &str| step["known"][0][key].as_f64().unwrap_or(f64::NAN);
            format!("{:.3e} ± {:.2e}", number("value"), number("std"))
        })
    };
    Ok(Outcome {
        tank,
        asked: goal,
        first: said(steps.first()),
        last: said(steps.last()),
        runs: steps.len(),
        repeated,
        right: output.status.success() && 2 * steps.len() <= repeated,
    })
}

fn folders(path: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut list: Vec<PathBuf> = entries.filter(|path| path.join("start.json").exists()).collect();
    list.sort();
    list.iter().map(|path| path.display().to_string()).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (mut out, mut tanks, mut goals) = (PathBuf::new(), 20, false);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match word.as_str() {
            "--tanks" => tanks = words.next().ok_or("--tanks wants a number")?.parse()?,
            "--goals" => goals = true,
            _ => out = word.into(),
        }
    }
    if out.as_os_str().is_empty() {
        return Err("name a folder for the outcomes".into());
    }
    std::fs::create_dir_all(&out)?;
    let (journal, mut outcomes) = Journal::<Outcome>::open(&out.join("outcomes.jsonl"))?;
    for tank in (0..tanks).filter(|tank| outcomes.iter().all(|outcome| outcome.tank != *tank)) {
        let folder = out.join(format!("tank-{tank}"));
        if folder.exists() {
            std::fs::remove_dir_all(&folder)?;
        }
        std::fs::create_dir_all(&folder)?;
        match if goals { sharpened(tank, &folder) } else { resolved(tank, &folder) } {
            Ok(outcome) => {
                println!("{outcome:?}");
                journal.add(outcome);
            }
            // a machine that is too busy for a run in real time: it is done when this is started again
            Err(said) => println!("tank {tank} did not come to an end: {said}"),
        }
    }
    outcomes.extend(journal.added());
    let right = outcomes.iter().filter(|outcome| outcome.right).count();
    println!("{right} of {} right", outcomes.len());
    Ok(())
}
