//! Identifies the fluid coefficients of the three-link chain, to stand beside MuJoCo doing the same.
//!
//! `cargo run --release -p ident --example identify_chain -- DATA` works on what the benchmark's
//! `run.py --write-data DATA` writes and prints one JSON line per problem and method: `case`, `method`,
//! `evaluations`, `rollouts`, `wall_s`, `loss_mm2`, `threads`, `stop_reason`. A further argument names one method.

use std::error::Error;
use std::path::{Path, PathBuf};

use ground::strict::Finite;
use ident::experiment::{Experiment, FitConfig, Method, Run, RunKind};
use ident::fit::fit;
use ident::table::read_trajectory;
use serde::Deserialize;
use sim::{Model, State};

#[derive(Deserialize)]
struct Problem {
    name: String,
    model: PathBuf,
    runs: Vec<Drop>,
    bounds: [f64; 2],
    start: Vec<f64>,
    noise_m: f64,
}

#[derive(Deserialize)]
struct Drop {
    trajectory: PathBuf,
    qpos: Vec<f64>,
    qvel: Vec<f64>,
}

#[expect(clippy::print_stdout, reason = "the lines are what it is for")]
fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("usage: identify_chain DATA [METHOD]")?);
    let only = arguments.next();
    let problems: Vec<Problem> =
        serde_json::from_str(&std::fs::read_to_string(folder.join("problem.json"))?)?;
    for problem in &problems {
        for method in [Method::LeastSquares, Method::Hybrid, Method::Paper] {
            if only.as_ref().is_some_and(|only| only != method.name()) {
                continue;
            }
            let fitted = fit(&experiment(&folder, problem, method)?, &mut ())?;
            let line = serde_json::json!({
                "case": problem.name,
                "method": method.name(),
                "evaluations": fitted.fit.evaluations,
                "rollouts": fitted.fit.rollouts,
                "wall_s": fitted.timing.wall.as_secs_f64(),
                "loss_mm2": fitted.fit.loss_m2 * 1e6,
                "threads": fitted.timing.threads,
                "stop_reason": fitted.fit.stop_reason,
            });
            println!("{line}");
        }
    }
    Ok(())
}

/// The problem as an experiment: initial states known exactly, only the fluid coefficients free.
fn experiment(folder: &Path, problem: &Problem, method: Method) -> Result<Experiment, Box<dyn Error>> {
    let mut model = Model::from_mjcf(&std::fs::read_to_string(folder.join(&problem.model))?)?;
    let fluid = ["blunt", "slender", "angular", "kutta", "magnus"];
    let names: Vec<String> =
        model.parameter_names().into_iter().filter(|name| fluid.iter().any(|f| name.ends_with(f))).collect();
    for (name, &value) in names.iter().zip(&problem.start) {
        model.set_parameter(name, value)?;
    }
    let mut runs = Vec::new();
    for drop in &problem.runs {
        let trajectory = read_trajectory(&folder.join(&drop.trajectory))?;
        let mut run = Run::new(drop.trajectory.display().to_string(), RunKind::Drop, trajectory);
        run.release_s = Some(0.0);
        run.initial = Some(State { qpos: drop.qpos.clone(), qvel: drop.qvel.clone() });
        runs.push(run);
    }
    let bounds = problem.bounds.map(Finite::new);
    let [Some(lower), Some(upper)] = bounds else { return Err("bounds are not finite".into()) };
    let fit = FitConfig {
        parameters: vec!["fluidcoef".into()],
        bounds: [("fluidcoef".into(), [lower, upper])].into(),
        method,
        seed: 7,
        ..FitConfig::default()
    };
    Ok(Experiment { noise_m: Some(problem.noise_m), ..Experiment::new(model, fit, runs) })
}
