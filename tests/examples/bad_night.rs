//! A night of faults on a mock rig with its daemon: `cargo run -p system-tests --example bad_night -- [--minutes 30] [--seed 1]`
//!
//! A line for each tenth of it: the least memory, files and threads of the daemon in it; then what happened how often. It fails where any of them
//! grows.

#![expect(clippy::print_stdout, reason = "an example talks to its terminal")]

use std::time::Duration;

use system_tests::bad_night::Night;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut night = Night { seed: 1, length: Duration::from_secs(1800) };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next().ok_or(format!("{word} wants a value"))?;
        match word.as_str() {
            "--minutes" => night.length = Duration::try_from_secs_f64(60.0 * value.parse::<f64>()?)?,
            "--seed" => night.seed = value.parse()?,
            _ => return Err(format!("unknown argument `{word}`").into()),
        }
    }
    let endured = night.endure();
    println!("part     MiB  files  threads");
    for tenth in 0..10 {
        let part = |tenth: u32| f64::from(tenth) * 0.4;
        let [memory_kib, files, threads] = endured.least(part(tenth), part(tenth + 1));
        println!("{:>4}  {:>6.1} {files:>6} {threads:>8}", tenth + 1, memory_kib as f64 / 1024.0);
    }
    println!("{:?}\njobs: {:?}", endured.faults, endured.jobs);
    let grown = endured.grown();
    if grown.is_empty() { Ok(()) } else { Err(grown.join("; ").into()) }
}
