//! How long looking at many runs takes: `cargo run -p system-tests --example many_runs -- OUT [RUNS]`, in a folder that is made for it. Says
//! what making the index took, then `rig runs ls` and the daemon's list of runs with an index that is up to date.

#![allow(clippy::print_stdout, reason = "its output is the point")]

use std::path::PathBuf;
use std::time::Instant;

use store::Store;
use system_tests::many_runs::make;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let out = PathBuf::from(args.next().ok_or("say where: OUT")?);
    let runs: usize = args.next().map_or(Ok(10_000), |runs| runs.parse())?;
    for number in 0..runs {
        make(&out, number)?;
    }
    // folders of this moment would be read again each time: they may still change unseen
    std::thread::sleep(std::time::Duration::from_secs(3));
    let mut store = Store::open(&out)?;
    let timed = |what: &str, work: &mut dyn FnMut() -> Result<usize, Box<dyn std::error::Error>>| {
        let began = Instant::now();
        let count = work()?;
        println!("{what}: {count} runs, {:.3} s", began.elapsed().as_secs_f64());
        Ok::<(), Box<dyn std::error::Error>>(())
    };
    timed("index made anew", &mut || Ok(store.refresh(true)?.runs))?;
    timed("index up to date, newest 100", &mut || {
        store.refresh(false)?;
        Ok(store.runs(100)?.len())
    })?;
    let ls = ["runs", "ls", "--runs-dir", out.to_str().ok_or("OUT is not readable")?];
    timed(
        "rig runs ls",
        &mut || Ok(system_tests::run_rig(ls).stdout.split(|&byte| byte == b'\n').count() - 2),
    )
}
