//! How fast the reference models step: one JSON line per model, integrator and step.
//!
//! `cargo run --release -p sim --example throughput`, beside MuJoCo's own figures on the same machine.
#![allow(clippy::print_stdout, reason = "its output is the point")]

use std::time::Instant;

use sim::{Command, Integrator, Model, RolloutOptions, State, rollout};

const MODELS: [(&str, &str, f64); 5] = [
    ("chain_passive", include_str!("../tests/data/chain_passive.xml"), 0.0),
    ("chain_friction", include_str!("../tests/data/chain_friction.xml"), 0.0),
    ("chain_active", include_str!("../tests/data/chain_active.xml"), 0.6),
    ("arm8", include_str!("../tests/data/arm8.xml"), 0.6),
    ("octopus8", include_str!("../tests/data/octopus8.xml"), 0.5),
];
const STEPPERS: [(Integrator, &str, f64); 5] = [
    (Integrator::Euler, "euler", 0.001),
    (Integrator::Euler, "euler", 0.002),
    (Integrator::ImplicitFast, "implicitfast", 0.001),
    (Integrator::Rk4, "rk4", 0.001),
    (Integrator::Rk4, "rk4", 0.010),
];
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

    /// Every site's positions each 20 ms; `None` when it diverges.
    fn positions(&self, integrator: Integrator, timestep_s: f64) -> Option<Vec<[f64; 3]>> {
        let samples: Vec<f64> = (0..=(self.duration_s * 50.0) as u32).map(|k| f64::from(k) * 0.02).collect();
        let run = self.run(integrator, timestep_s, &samples)?;
        let nq = self.model.nq();
        Some(
            run.chunks(nq)
                .flat_map(|qpos| self.model.poses(qpos).site_pos.into_iter().map(|at| at.0))
                .collect(),
        )
    }

    fn run(&self, integrator: Integrator, timestep_s: f64, samples: &[f64]) -> Option<Vec<f64>> {
        let options = RolloutOptions {
            integrator: Some(integrator),
            timestep_s: Some(timestep_s),
            ..RolloutOptions::default()
        };
        rollout(&self.model, &self.state, &self.command, samples, &options).ok().map(|run| run.qpos)
    }

    /// The motion itself: Runge-Kutta, or the finest stable method, halved until it no longer moves.
    fn reference(&self) -> Option<Vec<[f64; 3]>> {
        let mut timestep_s = 0.0005;
        let mut coarse = self.positions(Integrator::Rk4, timestep_s);
        while timestep_s > 1e-5 {
            timestep_s /= 2.0;
            let fine = self.positions(Integrator::Rk4, timestep_s);
            if let (Some(a), Some(b)) = (&coarse, &fine)
                && worst(a, b) < REFERENCE_M
            {
                return fine;
            }
            coarse = fine;
        }
        None
    }

    fn seconds(&self, integrator: Integrator, timestep_s: f64) -> f64 {
        let best = |best: f64, _| {
            let start = Instant::now();
            std::hint::black_box(self.run(integrator, timestep_s, &[self.duration_s]));
            best.min(start.elapsed().as_secs_f64())
        };
        (0..REPEATS).fold(f64::INFINITY, best)
    }
}

fn worst(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let distance = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    a.iter().zip(b).map(|(a, b)| distance(a, b)).fold(0.0, f64::max)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for (name, text, amplitude_rad) in MODELS {
        let case = Case::new(name, text, amplitude_rad)?;
        let reference = case.reference();
        for (integrator, called, timestep_s) in STEPPERS {
            let Some(positions) = case.positions(integrator, timestep_s) else { continue };
            let error_m = reference.as_ref().map(|reference| worst(&positions, reference));
            let seconds = case.seconds(integrator, timestep_s);
            let line = serde_json::json!({
                "model": name,
                "integrator": called,
                "timestep_s": timestep_s,
                "lanes": 1,
                "threads": 1,
                "isa": std::env::consts::ARCH,
                "steps_per_s": case.duration_s / timestep_s / seconds,
                "seconds_per_10_s_run": seconds * 10.0 / case.duration_s,
                "max_error_m": error_m,
            });
            println!("{line}");
        }
    }
    Ok(())
}
