//! One model's run again and again, for `perf` and `valgrind --tool=callgrind`.
//!
//! `cargo run --release -p sim --example profile -- MODEL METHOD LONGEST_S ISA TIMES`, for instance `chain_active runge-kutta
//! 0.005 avx2 10`, or `... MODEL planned ACCURACY_M ISA TIMES`. Prints the time per candidate.
#![allow(clippy::print_stdout, reason = "its output is the point")]

mod cases;

use std::time::Instant;

use cases::{Case, METHODS};
use sim::{Isa, RolloutOptions, Steps, batch};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, method, longest_s, isa, times] = &arguments[..] else {
        return Err("give MODEL METHOD LONGEST_S ISA TIMES".into());
    };
    let case = Case::named(name)?.ok_or("no such model")?;
    let steps = match METHODS.into_iter().find(|(_, called)| called == method) {
        Some((method, _)) => Steps::even(method, longest_s.parse()?),
        None if method == "planned" => {
            let plan = case.plan(longest_s.parse()?)?;
            println!(
                "{:?}, {} steps, error {:.1e} m",
                plan.steps.method,
                plan.steps.ends_s.len(),
                plan.error_m
            );
            plan.steps
        }
        None => return Err("no such method".into()),
    };
    let options = RolloutOptions { steps: Some(steps), ..RolloutOptions::default() };
    let isa = Isa::available().into_iter().find(|known| known.name() == isa).ok_or("not on this machine")?;
    let candidates = case.candidates(isa.candidates());
    let mut best = f64::INFINITY;
    for _ in 0..times.parse()? {
        let start = Instant::now();
        batch::positions(&case.model, &[], &candidates, &case.command, &[case.duration_s], &options, isa)?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    println!("{name}: {} candidates, {:.4} ms each", candidates.len(), best / candidates.len() as f64 * 1e3);
    Ok(())
}
