//! How fast the reference models step, and how exactly: one JSON line per model, way of stepping and instruction set.
//!
//! `cargo run --release -p sim --example throughput [-- MODEL]`, beside MuJoCo's own figures on the same machine. One
//! thread; `seconds_per_10_s_run` is per candidate. MuJoCo's own steppers come first (the same numbers as MuJoCo to
//! rounding, so their `max_error_m` is MuJoCo's too), then ours at the longest step that is as exact as asked for.
#![allow(clippy::print_stdout, reason = "its output is the point")]

mod cases;

use std::time::Instant;

use cases::{Case, METHODS, MODELS};
use sim::{Integrator, Isa, RolloutOptions, Steps, batch, rollout};

const MUJOCO: [(Integrator, &str, f64); 4] = [
    (Integrator::Euler, "euler", 0.001),
    (Integrator::ImplicitFast, "implicitfast", 0.001),
    (Integrator::Rk4, "rk4", 0.001),
    (Integrator::Rk4, "rk4", 0.010),
];
/// Wanted accuracies \[m\], beside MuJoCo's own at Euler 1 ms.
const WANTED_M: [f64; 2] = [1e-4, 1e-5];
/// Two references of which the coarser is this close to the finer are good enough \[m\].
const REFERENCE_M: f64 = 1e-7;
/// The best of so many runs is the figure: the others shared the machine.
const REPEATS: usize = 5;

/// Every site's positions each 20 ms; `None` when it diverges.
fn positions(case: &Case, options: &RolloutOptions) -> Option<Vec<[f64; 3]>> {
    let run = rollout(&case.model, &case.state, &case.command, &case.samples(), options).ok()?;
    let sites = |qpos: &[f64]| case.model.poses(qpos).site_pos;
    Some(run.qpos.chunks(case.model.nq()).flat_map(sites).map(|at| at.0).collect())
}

/// The motion itself, by Rosenbrock's method or, where that does not settle, by Runge-Kutta: steps halved until the sites no
/// longer move.
fn reference(case: &Case) -> Option<Vec<[f64; 3]>> {
    METHODS.into_iter().rev().find_map(|(method, _)| {
        let mut longest_s = 0.0005;
        let mut coarse = positions(case, &Case::ours(method, longest_s));
        while longest_s > 2e-5 {
            longest_s /= 2.0;
            let fine = positions(case, &Case::ours(method, longest_s));
            if let (Some(a), Some(b)) = (&coarse, &fine)
                && worst(a, b) < REFERENCE_M
            {
                return fine;
            }
            coarse = fine;
        }
        None
    })
}

/// Wall time of one candidate's run on one thread \[s\], every lane at work.
fn seconds(case: &Case, options: &RolloutOptions, isa: Isa) -> f64 {
    let candidates = case.candidates(isa.candidates());
    let samples = [case.duration_s];
    let best = |best: f64, _| {
        let start = Instant::now();
        let positions =
            batch::positions(&case.model, &[], &candidates, &case.command, &samples, options, isa);
        std::hint::black_box(positions.is_ok());
        best.min(start.elapsed().as_secs_f64())
    };
    (0..REPEATS).fold(f64::INFINITY, best) / candidates.len() as f64
}

fn worst(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let distance = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    a.iter().zip(b).map(|(a, b)| distance(a, b)).fold(0.0, f64::max)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let wanted = std::env::args().nth(1);
    for (name, text, amplitude_rad) in MODELS {
        if wanted.as_ref().is_some_and(|wanted| wanted != name) {
            continue;
        }
        let case = Case::new(name, text, amplitude_rad)?;
        let reference = reference(&case);
        let error_m = |options: &RolloutOptions| {
            let positions = positions(&case, options)?;
            Some(worst(&positions, reference.as_ref()?))
        };
        let line = |called: &str, timestep_s: f64, options: &RolloutOptions, error_m: Option<f64>| {
            for isa in Isa::available() {
                let seconds = seconds(&case, options, isa);
                let line = serde_json::json!({
                    "model": name,
                    "integrator": called,
                    "timestep_s": timestep_s,
                    "lanes": isa.candidates(),
                    "threads": 1,
                    "isa": isa.name(),
                    "steps_per_s": case.duration_s / timestep_s / seconds,
                    "seconds_per_10_s_run": seconds * 10.0 / case.duration_s,
                    "max_error_m": error_m,
                });
                println!("{line}");
            }
        };
        let mut wanted_m = WANTED_M.to_vec();
        for (integrator, called, timestep_s) in MUJOCO {
            let options = Case::mujoco(integrator, timestep_s);
            let Some(error_m) = error_m(&options) else { continue };
            if (called, timestep_s) == ("euler", 0.001) {
                wanted_m.insert(0, error_m);
            }
            line(called, timestep_s, &options, Some(error_m));
        }
        for wanted_m in wanted_m {
            let Some((steps, error_m)) = planned(&case, wanted_m, error_m) else { continue };
            let called = METHODS.into_iter().find(|(method, _)| *method == steps.method).map_or("", |m| m.1);
            let mean_s = case.duration_s / steps.ends_s.len() as f64;
            line(
                called,
                mean_s,
                &RolloutOptions { steps: Some(steps), ..RolloutOptions::default() },
                Some(error_m),
            );
        }
    }
    Ok(())
}

/// The cheapest steps found whose error is at most `wanted_m` \[m\], and their error.
fn planned(
    case: &Case,
    wanted_m: f64,
    error_m: impl Fn(&RolloutOptions) -> Option<f64>,
) -> Option<(Steps, f64)> {
    let mut asked_m = wanted_m * 1.5;
    while asked_m > wanted_m * 0.1 {
        let steps = case.plan(asked_m).ok()?.steps;
        let error_m = error_m(&RolloutOptions { steps: Some(steps.clone()), ..RolloutOptions::default() })?;
        if error_m <= wanted_m {
            return Some((steps, error_m));
        }
        asked_m *= 0.8;
    }
    None
}
