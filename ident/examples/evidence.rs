//! What the evidence says of experiments: `cargo run --release -p ident --example evidence -- [--verbose] experiment.toml ...`
//!
//! One line of JSON for each: the causes spoken of, the unknown, and what it took.

#![allow(clippy::print_stdout, reason = "the program's output")]

use std::path::Path;
use std::time::Instant;

use ident::diagnose::Observer;
use ident::evidence::{Evidence, evidence};
use ident::experiment::Experiment;
use serde_json::json;

/// Prints what is tried, where it is wanted.
struct Watched {
    verbose: bool,
    began: Instant,
}

impl Observer for Watched {
    fn stage(&mut self, stage: &str) -> bool {
        if self.verbose {
            eprintln!("{:6.2} s {stage}", self.began.elapsed().as_secs_f64());
        }
        true
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (flags, files): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|word| word.starts_with("--"));
    let verbose = flags.iter().any(|flag| flag == "--verbose");
    for file in files {
        let began = Instant::now();
        let found = Experiment::read(Path::new(&file)).map_err(|error| error.to_string()).and_then(|read| {
            evidence(&read, &mut Watched { verbose, began }).map_err(|error| error.to_string())
        });
        let wall_s = began.elapsed().as_secs_f64();
        match found {
            Ok(found) => println!("{}", line(&file, wall_s, &found)),
            Err(error) => println!("{}", json!({ "file": file, "error": error, "wall_s": wall_s })),
        }
    }
    Ok(())
}

fn line(file: &str, wall_s: f64, found: &Evidence) -> serde_json::Value {
    let causes: Vec<serde_json::Value> = found
        .causes
        .iter()
        .map(|cause| {
            let sizes: Vec<serde_json::Value> = cause
                .sizes
                .iter()
                .map(|size| {
                    json!({ "name": size.name, "runs": size.runs, "value": size.value, "ci95": size.ci95 })
                })
                .collect();
            json!({
                "name": cause.name, "label": cause.label, "element": cause.element, "class": cause.class,
                "standing": format!("{:?}", cause.standing), "probability": cause.probability,
                "gain": cause.gain, "sizes": sizes,
            })
        })
        .collect();
    json!({
        "file": file, "causes": causes, "unnamed": found.unnamed, "unknown": found.unknown,
        "best": found.best, "ln_odds": found.ln_odds, "unfitted": found.unfitted, "noise": found.noise,
        "complete": found.complete, "fits": found.fits, "rollouts": found.rollouts, "wall_s": wall_s,
    })
}
