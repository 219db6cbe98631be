//! Our CMA-ES beside pycma on its standard test functions: see `scripts/pycma_reference.py`.

use ident::cmaes::{CmaEs, Options, Stop};
use rayon::prelude::*;

const TARGET: f64 = 1e-8;
const RUNS: u64 = 21;
/// Medians of 21 and 51 runs each scatter by some 5 %; implementations differ in rounding, not in method.
const MOST_MORE: f64 = 1.3;
/// Successes on a multimodal function are a coin toss each: two standard deviations of the difference.
const FEWER_SUCCESSES: f64 = 0.3;

fn scale(i: usize, n: usize, power: f64) -> f64 {
    10f64.powf(power * i as f64 / (n - 1) as f64)
}

fn loss(function: &str, x: &[f64]) -> f64 {
    let n = x.len();
    let squares = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
    match function {
        "sphere" => squares(x),
        "ellipsoid" => x.iter().enumerate().map(|(i, x)| scale(i, n, 6.0) * x * x).sum(),
        "cigar" => x[0] * x[0] + 1e6 * squares(&x[1..]),
        "discus" => 1e6 * x[0] * x[0] + squares(&x[1..]),
        "rosenbrock" => {
            x.windows(2).map(|p| 100.0 * (p[0] * p[0] - p[1]).powi(2) + (p[0] - 1.0).powi(2)).sum()
        }
        "different_powers" => {
            x.iter().enumerate().map(|(i, x)| x.abs().powf(2.0 + 10.0 * i as f64 / (n - 1) as f64)).sum()
        }
        "rastrigin" => x.iter().map(|x| 10.0 + x * x - 10.0 * (std::f64::consts::TAU * x).cos()).sum(),
        other => panic!("unknown function {other}"),
    }
}

fn evaluations(function: &str, n: usize, population: usize, seed: u64) -> Option<u64> {
    let (start, sigma) = if function == "rosenbrock" { (0.0, 0.5) } else { (3.0, 2.0) };
    let tolerance = if population > 0 { 1e-11 } else { 0.0 };
    let options = Options {
        sigma,
        population: (population > 0).then_some(population),
        seed,
        max_evaluations: 200_000,
        target: Some(TARGET),
        tol_loss: tolerance,
        tol_step: 0.0,
        ..Options::default()
    };
    let mut es = CmaEs::new(&vec![start; n], options);
    while es.stop().is_none() {
        let generation = es.ask();
        let losses: Vec<f64> = generation.points.iter().map(|x| loss(function, x)).collect();
        es.tell(&generation, &losses);
    }
    (es.stop() == Some(Stop::Target)).then(|| es.evaluations())
}

#[test]
fn evaluations_to_the_target_are_those_of_pycma() {
    let mut failures = Vec::new();
    for line in include_str!("../data/pycma.csv").lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |at: usize| cells[at].parse::<f64>().unwrap();
        let (n, population) = (number(1) as usize, number(2) as usize);
        let mut counts: Vec<u64> = (1..=RUNS)
            .into_par_iter()
            .filter_map(|seed| evaluations(cells[0], n, population, seed))
            .collect();
        counts.sort_unstable();
        let success = counts.len() as f64 / RUNS as f64;
        let median = counts.get(counts.len() / 2).map_or(f64::INFINITY, |&count| count as f64);
        let ratio = median / number(6);
        println!(
            "{:17} n {n:2}: {median:6} evaluations, pycma {:6}, ratio {ratio:.2}, success {success:.2}",
            cells[0],
            number(6)
        );
        if ratio > MOST_MORE || success < number(4) / number(3) - FEWER_SUCCESSES {
            failures.push(line);
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}
