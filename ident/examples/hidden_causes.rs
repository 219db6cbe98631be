//! Hides every cause in two drops and two driven runs of the three-link chain, and lets the diagnosis find it.
//!
//! `cargo run -p ident --example hidden_causes -- [CAUSE|all|none] [TIMES] [SEEDS]` hides it at TIMES the size that these
//! runs would just show, over SEEDS seeds, and prints a line per case. Data: classical Runge-Kutta at 0.25 ms, noise of
//! 0.4 mm with correlation 0.4, rounded to 0.05 mm; the fit starts from MuJoCo's default coefficients.

#[allow(clippy::unwrap_used, unreachable_pub, reason = "shared with tests")]
#[path = "../tests/common/mod.rs"]
mod common;

use std::error::Error;

use ident::diagnose::{Diagnosed, diagnose};
use ident::experiment::{Experiment, FitConfig, Run, RunKind};
use sim::effects::{Cause, Role};
use sim::{Command, Integrator, Model, RolloutOptions, Trajectory, rollout};

const NOISE_M: f64 = 4e-4;
const CORRELATION: f64 = 0.4;
const PIXEL_M: f64 = 5e-5;
const SECONDS: f64 = 2.5;
const START_S: f64 = 0.2;

/// Strokes whose counter-clockwise part lasts twice as long, in straight pieces, after rest.
fn strokes(amplitude_rad: f64, period_s: f64) -> Command {
    let (mut time_s, mut angle_rad) = (vec![0.0, START_S], vec![0.0, 0.0]);
    let (mut t, mut up) = (START_S, true);
    while t < SECONDS {
        t += period_s * if up { 2.0 / 3.0 } else { 1.0 / 3.0 };
        time_s.push(t);
        angle_rad.push(if up { amplitude_rad } else { 0.0 });
        up = !up;
    }
    Command { actuators: vec!["servo".into()], time_s, angle_rad }
}

fn film(model: &Model, qpos: [f64; 3], command: &Command, seed: u64) -> Result<Trajectory, Box<dyn Error>> {
    let times: Vec<f64> = (0..(SECONDS * common::FPS) as usize).map(|i| i as f64 / common::FPS).collect();
    let options = RolloutOptions {
        integrator: Some(Integrator::Rk4),
        timestep_s: Some(2.5e-4),
        prescribed: true,
        start_s: START_S,
        ..RolloutOptions::default()
    };
    let mut trajectory = rollout(model, &common::still(qpos), command, &times, &options)?.trajectory();
    trajectory.position_m.iter_mut().for_each(|p| p[1] = f64::NAN);
    common::add_noise(&mut trajectory, NOISE_M, CORRELATION, seed);
    for x in trajectory.position_m.iter_mut().flatten() {
        *x = (*x / PIXEL_M).round() * PIXEL_M;
    }
    Ok(trajectory)
}

/// Two drops and two driven runs of `model`, with the phase of what differs from run to run.
fn runs(model: &Model, seed: u64) -> Result<Vec<Run>, Box<dyn Error>> {
    let mut runs = Vec::new();
    for (index, pose) in [[1.5, 0.0, 0.0], [0.9, -1.2, 1.2]].into_iter().enumerate() {
        let model = swayed(model, index);
        let trajectory = film(&model, pose, &Command::default(), 10 * seed + index as u64)?;
        let mut run = Run::new(format!("drop-{index}"), RunKind::Drop, trajectory);
        (run.release_s, run.prescribed) = (Some(START_S), true);
        runs.push(run);
    }
    for (index, (amplitude, period)) in [(0.6, 1.2), (0.9, 0.8)].into_iter().enumerate() {
        let (model, command) = (swayed(model, 2 + index), strokes(amplitude, period));
        let trajectory = film(&model, [0.0; 3], &command, 10 * seed + 5 + index as u64)?;
        let mut run = Run::new(format!("driven-{index}"), RunKind::Driven, trajectory);
        (run.command, run.prescribed) = (Some(command), true);
        runs.push(run);
    }
    Ok(runs)
}

/// Waves have another phase in each run.
fn swayed(model: &Model, run: usize) -> Model {
    let mut model = model.clone();
    if let Ok(size) = model.parameter("slosh/sin") {
        let (sin, cos) = (2.1 * run as f64 + 0.4).sin_cos();
        let _ = model.set_parameter("slosh/sin", size * sin);
        let _ = model.set_parameter("slosh/cos", size * cos);
    }
    model
}

fn experiment(runs: Vec<Run>) -> Experiment {
    let fit = FitConfig { parameters: vec!["fluidcoef".into(), "damping".into()], ..FitConfig::default() };
    let mut model = common::guess(common::driven_chain());
    // not fitted: the driven joint's own
    let _ = model.set_parameter("q1/damping", 2e-6);
    Experiment { model, noise_m: None, fit, runs }
}

/// The values with which `cause` is hidden, `times` as large as these runs would just show.
fn hide(cause: Cause, times: f64, clean: &Diagnosed, seed: u64) -> Result<Model, Box<dyn Error>> {
    let mut model = common::driven_chain();
    model.add_effect(cause.name())?;
    let effect = model.effects()[0].clone();
    let sign = if seed.is_multiple_of(2) { 1.0 } else { -1.0 };
    for (name, info) in effect.names().iter().zip(effect.parameters()) {
        match info.role {
            Role::Size => {
                let limit = clean.diagnosis.detectable.iter().find(|d| d.name == *name);
                let limit = limit.and_then(|d| d.smallest).unwrap_or(info.typical);
                let sign = if info.bounds[0] < 0.0 { sign } else { 1.0 };
                let shared = effect.parameters().filter(|p| p.role == Role::Size).count() as f64;
                let size = sign * times * limit / shared.sqrt();
                model.set_parameter(name, size.clamp(info.bounds[0], info.bounds[1]))?;
            }
            Role::Switch => model.set_parameter(name, 1.0)?,
            Role::Hidden(_) if name == "servo_rate_limit/rate" => {
                model.set_parameter(name, 2.0 / times.sqrt())?
            }
            Role::Hidden(grid) => model.set_parameter(name, 1.04 * grid[grid.len() / 2])?,
            Role::Choice(_) | Role::Detail => {}
        }
    }
    Ok(model)
}

#[expect(clippy::print_stdout, reason = "the lines are what it is for")]
fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let which = arguments.next().unwrap_or_else(|| "all".into());
    let times: f64 = arguments.next().map_or(Ok(5.0), |text| text.parse())?;
    let seeds: u64 = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let mut right = 0;
    let mut cases = 0;
    for seed in 1..=seeds {
        let clean = diagnose(&experiment(runs(&common::driven_chain(), seed)?), &mut ())?;
        line(&format!("nothing {seed}"), &clean);
        if which == "none" {
            continue;
        }
        if seed == 1 {
            for d in &clean.diagnosis.detectable {
                println!("    {:32} {:>12.3e} {}", d.name, d.smallest.unwrap_or(f64::NAN), d.unit);
            }
        }
        for cause in Cause::ALL.iter().filter(|cause| which == "all" || cause.name() == which) {
            let model = hide(*cause, times, &clean, seed)?;
            let hidden: Vec<String> = model.effects()[0]
                .names()
                .iter()
                .zip(model.effects()[0].values())
                .filter(|(_, v)| **v != 0.0)
                .map(|(n, v)| format!("{n}={v:.3e}"))
                .collect();
            let diagnosed = diagnose(&experiment(runs(&model, seed)?), &mut ())?;
            cases += 1;
            let named = &diagnosed.diagnosis.causes;
            let hit = named.len() == 1
                && diagnosed.diagnosis.alternatives.is_empty()
                && (named[0].name == cause.name()
                    || named[0].aliases.iter().any(|alias| alias == cause.name()));
            right += usize::from(hit);
            line(
                &format!("{} {} {}", if hit { "ok  " } else { "MISS" }, cause.name(), hidden.join(" ")),
                &diagnosed,
            );
        }
    }
    println!("{right} of {cases} named");
    Ok(())
}

#[expect(clippy::print_stdout, reason = "the lines are what it is for")]
fn line(title: &str, diagnosed: &Diagnosed) {
    let d = &diagnosed.diagnosis;
    let values: Vec<String> = d
        .causes
        .iter()
        .chain(&d.partial)
        .flat_map(|cause| &cause.parameters)
        .map(|p| {
            let [lower, upper] = p.ci95.unwrap_or([f64::NAN; 2]);
            format!("{}={:.3e} [{lower:.2e},{upper:.2e}]", p.name, p.value)
        })
        .collect();
    let alternatives: Vec<String> =
        d.alternatives.iter().map(|a| format!("{}({:.0})", a.names.join("+"), a.delta_bic)).collect();
    println!(
        "{title}: {} | {} | alt {} | z {:.1} -> {:.1}, p {:.0e}, dBIC {:?}, floor {:.4} mm rho {:.2}, gain {:?} {} | {:.2} s, {} rollouts {:?}",
        d.verdict.name(),
        values.join(" "),
        alternatives.join(" "),
        d.whiteness.before.z,
        d.whiteness.after.z,
        d.whiteness.after.portmanteau_p,
        d.causes.iter().chain(&d.partial).map(|c| c.delta_bic.round()).collect::<Vec<_>>(),
        d.noise_m * 1e3,
        d.noise.correlation,
        d.heldout.as_ref().map(|h| (h.gain * 1e3).round() / 1e3),
        d.remarks.join("; "),
        diagnosed.timing.wall.as_secs_f64(),
        diagnosed.rollouts,
        d.bent.iter().take(2).map(|b| b.name.clone()).collect::<Vec<_>>(),
    );
}
