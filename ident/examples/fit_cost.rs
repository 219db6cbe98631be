//! What a fit costs, against the number of its runs, parameters and images.
//!
//! `cargo run --release -p ident --example fit_cost -- [SVG]` fits drops of a three-link chain by least squares, one quantity
//! varied at a time, prints a JSON line for each (`varied`, `runs`, `parameters`, `images`, `wall_s`, `evaluations`,
//! `rollouts`, `threads`; the quickest of a few repeats) and draws them.

use std::error::Error;
use std::fmt::Write as _;

use ident::experiment::{Experiment, FitConfig, Method, Run, RunKind};
use ident::fit::fit;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use sim::{Command, Integrator, Model, RolloutOptions, State, rollout};

const MODEL: &str = include_str!("../tests/data/chain.xml");
const NOISE_M: f64 = 4e-4;
const FPS: f64 = 100.0;
/// What is not varied.
const USUAL: Size = Size { runs: 2, parameters: 6, images: 400 };
/// The quickest of so many fits counts: others work on the machine.
const REPEATS: usize = 5;
const RUNS: [usize; 5] = [1, 2, 4, 8, 16];
const IMAGES: [usize; 5] = [100, 200, 400, 800, 1600];
/// The first so many are fitted; most visible first.
const PARAMETERS: [&str; 12] = [
    "g3/blunt",
    "g3/angular",
    "g2/blunt",
    "g3/kutta",
    "q2/damping",
    "q3/damping",
    "g2/angular",
    "g3/magnus",
    "g3/slender",
    "g1/blunt",
    "g2/kutta",
    "q1/damping",
];

#[derive(Clone, Copy)]
struct Size {
    runs: usize,
    parameters: usize,
    images: usize,
}

/// The cost of a fit of this size.
#[expect(clippy::print_stdout, reason = "the lines are what it is for")]
fn cost(varied: &str, size: Size) -> Result<f64, Box<dyn Error>> {
    let truth = Model::from_mjcf(MODEL)?;
    let mut model = truth.clone();
    let names = &PARAMETERS[..size.parameters];
    for name in names {
        let value = truth.parameter(name)?;
        model.set_parameter(name, 1.3 * value)?;
    }
    let config = FitConfig {
        parameters: names.iter().map(|&name| name.into()).collect(),
        method: Method::LeastSquares,
        ..FitConfig::default()
    };
    let runs =
        (0..size.runs).map(|number| film(&truth, number, size.images)).collect::<Result<Vec<_>, _>>()?;
    let experiment = Experiment { noise_m: Some(NOISE_M), ..Experiment::new(model, config, runs) };
    let mut best = fit(&experiment, &mut ())?;
    for _ in 1..REPEATS {
        let again = fit(&experiment, &mut ())?;
        if again.timing.wall < best.timing.wall {
            best = again;
        }
    }
    let wall_s = best.timing.wall.as_secs_f64();
    let line = serde_json::json!({
        "varied": varied,
        "runs": size.runs,
        "parameters": size.parameters,
        "images": size.images,
        "wall_s": wall_s,
        "evaluations": best.fit.evaluations,
        "rollouts": best.fit.rollouts,
        "threads": best.timing.threads,
    });
    println!("{line}");
    Ok(wall_s)
}

/// A drop from a pose of its own, seen square to the plane.
fn film(truth: &Model, number: usize, images: usize) -> Result<Run, Box<dyn Error>> {
    let turn = number as f64;
    let state =
        State { qpos: vec![1.5 - 0.1 * turn, -1.2 + 0.15 * turn, 0.9 - 0.1 * turn], qvel: vec![0.0; 3] };
    let times: Vec<f64> = (0..images).map(|i| i as f64 / FPS).collect();
    let options = RolloutOptions {
        integrator: Some(Integrator::Rk4),
        timestep_s: Some(1e-3),
        start_s: 0.2,
        ..RolloutOptions::default()
    };
    let mut trajectory = rollout(truth, &state, &Command::default(), &times, &options)?.trajectory();
    let mut random = ChaCha8Rng::seed_from_u64(number as u64);
    for position in &mut trajectory.position_m {
        position[1] = f64::NAN;
        for axis in [0, 2] {
            let normal: f64 = StandardNormal.sample(&mut random);
            position[axis] += NOISE_M * normal;
        }
    }
    Ok(Run { release_s: Some(0.2), ..Run::new(format!("drop-{number}"), RunKind::Drop, trajectory) })
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1);
    let mut curves: Vec<(&str, Vec<(f64, f64)>)> = Vec::new();
    let mut curve = |name, sizes: Vec<(usize, Size)>| -> Result<(), Box<dyn Error>> {
        let points = sizes.into_iter().map(|(x, size)| Ok((x as f64, cost(name, size)?)));
        curves.push((name, points.collect::<Result<_, Box<dyn Error>>>()?));
        Ok(())
    };
    curve("runs", RUNS.map(|runs| (runs, Size { runs, ..USUAL })).to_vec())?;
    let counts = [1, 2, 4, 6, 8, 10, 12];
    curve("parameters", counts.map(|parameters| (parameters, Size { parameters, ..USUAL })).to_vec())?;
    curve("images", IMAGES.map(|images| (images, Size { images, ..USUAL })).to_vec())?;
    if let Some(path) = path {
        std::fs::write(path, drawn(&curves)?)?;
    }
    Ok(())
}

/// One plot beside the other as SVG: both axes logarithmic, the same decades of seconds in all.
fn drawn(curves: &[(&str, Vec<(f64, f64)>)]) -> Result<String, Box<dyn Error>> {
    const SIZE: [f64; 2] = [280.0, 260.0];
    const MARGIN: [f64; 2] = [60.0, 45.0];
    /// The last label reaches beyond its axis by half of its width.
    const LAST_LABEL: f64 = 8.0;
    let all = || curves.iter().flat_map(|(_, points)| points);
    let lowest = all().map(|point| point.1).fold(f64::INFINITY, f64::min).log10().floor();
    let highest = all().map(|point| point.1).fold(0.0, f64::max).log10().ceil();
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        SIZE[0] * curves.len() as f64 + LAST_LABEL,
        SIZE[1]
    );
    for (number, (name, points)) in curves.iter().enumerate() {
        let (left, right) = (SIZE[0] * number as f64 + MARGIN[0], SIZE[0] * (number + 1) as f64 - 12.0);
        let (top, bottom) = (12.0, SIZE[1] - MARGIN[1]);
        let (Some(first), Some(last)) = (points.first(), points.last()) else { continue };
        let across = |x: f64| left + (right - left) * (x / first.0).ln() / (last.0 / first.0).ln();
        let up = |wall_s: f64| bottom - (bottom - top) * (wall_s.log10() - lowest) / (highest - lowest);
        writeln!(svg, "<path d=\"M{left} {top}V{bottom}H{right}\" fill=\"none\" stroke=\"#444\"/>")?;
        for decade in lowest as i32..=highest as i32 {
            let (seconds, y) = (10_f64.powi(decade), up(10_f64.powi(decade)));
            writeln!(svg, "<path d=\"M{left} {y:.1}H{right}\" stroke=\"#ddd\"/>")?;
            writeln!(
                svg,
                "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{seconds} s</text>",
                left - 6.0,
                y + 4.0
            )?;
        }
        let line: Vec<String> =
            points.iter().map(|&(x, wall_s)| format!("{:.1},{:.1}", across(x), up(wall_s))).collect();
        writeln!(svg, "<polyline points=\"{}\" fill=\"none\" stroke=\"#1f5fbf\"/>", line.join(" "))?;
        for &(x, wall_s) in points {
            writeln!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"#1f5fbf\"/>",
                across(x),
                up(wall_s)
            )?;
            let below = bottom + 16.0;
            writeln!(svg, "<text x=\"{:.1}\" y=\"{below}\" text-anchor=\"middle\">{x}</text>", across(x))?;
        }
        let (middle, below) = ((left + right) / 2.0, bottom + 36.0);
        writeln!(svg, "<text x=\"{middle}\" y=\"{below}\" text-anchor=\"middle\">{name}</text>")?;
    }
    svg.push_str("</svg>\n");
    Ok(svg)
}
