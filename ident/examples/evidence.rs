//! What the evidence says of experiments: `cargo run --release -p ident --example evidence -- EXPERIMENT OUT [EXPERIMENT OUT ...]` writes
//! `diagnosis.json` into each folder, and prints its sentence.

#![allow(clippy::print_stdout, reason = "the program's output")]

use std::path::Path;

use ident::diagnose::by_evidence;
use ident::experiment::Experiment;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    for pair in arguments.chunks(2) {
        let [experiment, out] = pair else { return Err("a folder for each experiment, please".into()) };
        let diagnosis = by_evidence(&Experiment::read(Path::new(experiment))?, &mut ())?;
        std::fs::create_dir_all(out)?;
        std::fs::write(Path::new(out).join("diagnosis.json"), diagnosis.to_json()?)?;
        println!("{}", diagnosis.sentence);
        for remark in &diagnosis.remarks {
            println!("- {remark}");
        }
    }
    Ok(())
}
