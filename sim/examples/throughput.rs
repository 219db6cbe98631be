//! How fast the reference models step, and how exactly: one JSON line per model, way of stepping and instruction set.
//!
//! `cargo run --release -p sim --example throughput [-- MODEL]`, beside MuJoCo's own figures on the same machine. One
//! thread; `seconds_per_10_s_run` is per candidate. MuJoCo's own steppers come first (the same numbers as MuJoCo to
//! rounding, so their `max_error_m` is MuJoCo's too), then ours at the longest step that is as exact as asked for.
#![allow(clippy::print_stdout, reason = "its output is the point")]

use std::time::Instant;

use sim::batch::{self, Candidate};
use sim::{Command, Integrator, Isa, Method, Model, RolloutOptions, State, Steps, rollout};

const MODELS: [(&str, &str, f64); 5] = [
    ("chain_passive", include_str!("../tests/data/chain_passive.xml"), 0.0),
    ("chain_friction", include_str!("../tests/data/chain_friction.xml"), 0.0),
    ("chain_active", include_str!("../tests/data/chain_active.xml"), 0.6),
    ("arm8", include_str!("../tests/data/arm8.xml"), 0.6),
    ("octopus8", include_str!("../tests/data/octopus8.xml"), 0.5),
];
const MUJOCO: [(Integrator, &str, f64); 4] = [
    (Integrator::Euler, "euler", 0.001),
    (Integrator::ImplicitFast, "implicitfast", 0.001),
    (Integrator::Rk4, "rk4", 0.001),
    (Integrator::Rk4, "rk4", 0.010),
];
const OURS: [(Method, &str); 2] =
    [(Method::RungeKutta, "runge-kutta"), (Method::Extrapolation, "extrapolation")];
/// Longest steps tried, each three quarters of the one before \[s\].
const LONGEST_S: f64 = 0.05;
/// Wanted accuracies \[m\], beside MuJoCo's own at Euler 1 ms.
const WANTED_M: [f64; 2] = [1e-4, 1e-5];
/// Two references of which the coarser is this close to the finer are good enough \[m\].
const REFERENCE_M: f64 = 1e-7;
/// The best of so many runs is the figure: the others shared the machine.
const REPEATS: usize = 5;

/// One model's run: a passive chain drops from horizontal, the others follow the 2:1 stroke.
struct Case {
    model: Model,
    state: State,
    command: Command,
    duration_s: f64,
}

impl Case {
    fn new(name: &str, text: &str, amplitude_rad: f64) -> Result<Self, Box<dyn std::error::Error>> {
        let model = Model::from_mjcf(text)?;
        let mut state = model.rest_state();
        if model.actuators.is_empty() {
            state.qpos[0] = std::f64::consts::FRAC_PI_2;
        }
        // the stroke's corners are among these: up for 1 s, down for 0.5 s, at 0 first
        let time_s: Vec<f64> = (0..=20).map(|k| 0.5 * f64::from(k)).collect();
        let angle = |t: f64| match (t + 0.5) % 1.5 {
            p if p < 1.0 => amplitude_rad * (2.0 * p - 1.0),
            p => amplitude_rad * (5.0 - 4.0 * p),
        };
        let actuators: Vec<String> = model.actuators.iter().map(|actuator| actuator.name.clone()).collect();
        let angle_rad = time_s.iter().flat_map(|&t| std::iter::repeat_n(angle(t), actuators.len())).collect();
        let duration_s = if name == "octopus8" { 1.0 } else { 10.0 };
        Ok(Self { model, state, command: Command { actuators, time_s, angle_rad }, duration_s })
    }

    fn mujoco(integrator: Integrator, timestep_s: f64) -> RolloutOptions {
        RolloutOptions {
            integrator: Some(integrator),
            timestep_s: Some(timestep_s),
            ..RolloutOptions::default()
        }
    }

    fn ours(method: Method, longest_s: f64) -> RolloutOptions {
        RolloutOptions { steps: Some(Steps { method, longest_s }), ..RolloutOptions::default() }
    }

    /// Every site's positions each 20 ms; `None` when it diverges.
    fn positions(&self, options: &RolloutOptions) -> Option<Vec<[f64; 3]>> {
        let samples: Vec<f64> = (0..=(self.duration_s * 50.0) as u32).map(|k| f64::from(k) * 0.02).collect();
        let run = rollout(&self.model, &self.state, &self.command, &samples, options).ok()?;
        let sites = |qpos: &[f64]| self.model.poses(qpos).site_pos;
        Some(run.qpos.chunks(self.model.nq()).flat_map(sites).map(|at| at.0).collect())
    }

    /// The motion itself, by Runge-Kutta or, where that is not stable, by extrapolation: steps halved until the sites no
    /// longer move.
    fn reference(&self) -> Option<Vec<[f64; 3]>> {
        OURS.into_iter().find_map(|(method, _)| {
            let mut longest_s = 0.0005;
            let mut coarse = self.positions(&Self::ours(method, longest_s));
            while longest_s > 2e-5 {
                longest_s /= 2.0;
                let fine = self.positions(&Self::ours(method, longest_s));
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
    fn seconds(&self, options: &RolloutOptions, isa: Isa) -> f64 {
        let candidate = Candidate { values: Vec::new(), state: self.state.clone(), start_s: 0.0 };
        let candidates = vec![candidate; isa.candidates()];
        let samples = [self.duration_s];
        let best = |best: f64, _| {
            let start = Instant::now();
            let positions =
                batch::positions(&self.model, &[], &candidates, &self.command, &samples, options, isa);
            std::hint::black_box(positions.is_ok());
            best.min(start.elapsed().as_secs_f64())
        };
        (0..REPEATS).fold(f64::INFINITY, best) / candidates.len() as f64
    }
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
        let reference = case.reference();
        let error_m = |options: &RolloutOptions| {
            let positions = case.positions(options)?;
            Some(worst(&positions, reference.as_ref()?))
        };
        let line = |called: &str, timestep_s: f64, options: &RolloutOptions, error_m: Option<f64>| {
            for isa in Isa::available() {
                let seconds = case.seconds(options, isa);
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
        for (method, called) in OURS {
            let mut longest_s = LONGEST_S;
            for &wanted_m in &wanted_m {
                // once a step is as exact as wanted, so are all shorter ones
                while longest_s > 1e-4 {
                    let options = Case::ours(method, longest_s);
                    match error_m(&options) {
                        Some(error_m) if error_m <= wanted_m => {
                            line(called, longest_s, &options, Some(error_m));
                            break;
                        }
                        _ => longest_s *= 0.75,
                    }
                }
            }
        }
    }
    Ok(())
}
