//! What an engine costs: a study of tasks of some seconds on this machine alone and on an engine, in turns; and a study of very many tasks.
//!
//! ```sh
//! cargo run -p system-tests --example studies -- OUT --on slurm                 # or hyperqueue: tasks of about 2 s, two at a time
//! cargo run -p system-tests --example studies -- OUT --many 10000 --on local    # planned, handed over, collected: time and memory
//! ```

#![allow(clippy::print_stdout, reason = "its output is the point")]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use clap::Parser;
use system_tests::rig;
use system_tests::study::{Engine, Recordings};

#[derive(Parser)]
struct Args {
    /// Folder for all of it
    out: PathBuf,
    /// local, slurm or hyperqueue
    #[arg(long, default_value = "local")]
    on: String,
    /// Tasks of a study whose efficiency is measured
    #[arg(long, default_value_t = 40)]
    tasks: usize,
    /// Turns of it
    #[arg(long, default_value_t = 3)]
    turns: usize,
    /// Candidates that a task tries, which says how long it takes
    #[arg(long, default_value_t = 5000)]
    evaluations: usize,
    /// A study of so many short tasks instead
    #[arg(long)]
    many: Option<usize>,
}

fn main() {
    let args = Args::parse();
    std::fs::create_dir_all(&args.out).expect("a folder");
    let engine = (args.on != "local")
        .then(|| Engine::start(&args.on, &args.out.join("engine"), "its efficiency").expect("the engine"));
    let mut workers: Vec<Child> = Vec::new();
    if args.on == "hyperqueue" {
        workers
            .extend(engine.as_ref().map(|engine| [engine.worker(), engine.worker()]).into_iter().flatten());
    }
    let told = |command: Command| match &engine {
        Some(engine) => engine.command(command),
        None => command,
    };
    match args.many {
        Some(count) => many(&args, count, &told),
        None => efficiency(&args, &told),
    }
    for worker in &mut workers {
        let _ = worker.kill();
        let _ = worker.wait();
    }
}

/// Lines of a study that does not wait for anything measured.
const TYPICAL: &str = "[task]\nmemory_mib = 300\ntypical_s = ";

fn efficiency(args: &Args, told: &dyn Fn(Command) -> Command) {
    let fit = format!(
        "parameters = [\"q2/damping\", \"q3/damping\", \"g2/blunt\", \"g3/blunt\"]\nmethod = \"paper\"\nmax_evaluations = {}\n",
        args.evaluations
    );
    let recordings = Recordings {
        count: 1,
        duration_s: 28.0,
        fit: Box::leak(fit.into_boxed_str()),
        ..Recordings::default()
    };
    recordings.write(&args.out);
    let study = args.out.join("study.toml");
    let seeds: Vec<usize> = (1..=args.tasks).collect();
    let text = format!(
        "[[experiment]]\npaths = [\"e0/experiment.toml\"]\n[[variation]]\nname = \"seeds\"\nseeds = {seeds:?}\n{TYPICAL}2.0\n"
    );
    std::fs::write(&study, text).expect("written");
    for turn in 0..args.turns {
        let wall_s = |on: &str| {
            let folder = args.out.join(format!("{on}-{turn}"));
            let mut command = rig(["study"]);
            command.arg(&study).arg("--out").arg(&folder).args(["--on", on, "--workers", "2"]);
            let (wall_s, peak_mib) = measured(told(command));
            println!("{on}: {} tasks in {wall_s:.1} s, {peak_mib:.0} MiB", args.tasks);
            wall_s
        };
        let (here_s, there_s) = (wall_s("local"), wall_s(&args.on));
        println!("efficiency of {}: {:.3}", args.on, here_s / there_s);
    }
}

fn many(args: &Args, count: usize, told: &dyn Fn(Command) -> Command) {
    Recordings { count: 1, duration_s: 0.5, ..Recordings::default() }.write(&args.out);
    let study = args.out.join("study.toml");
    let text = format!(
        "[[experiment]]\npaths = [\"e0/experiment.toml\"]\n[[variation]]\nname = \"blocks\"\nresample = {{ by = \"block\", count = {} }}\n{TYPICAL}0.05\n",
        count - 1
    );
    std::fs::write(&study, text).expect("written");
    let folder = args.out.join(format!("many-{}", args.on));
    let mut command = rig(["study"]);
    command.arg(&study).arg("--out").arg(&folder).args(["--on", &args.on, "--workers", "2", "--detach"]);
    let (wall_s, peak_mib) = measured(told(command));
    println!("planned and handed to {}: {count} tasks in {wall_s:.1} s, {peak_mib:.0} MiB", args.on);
    let began = Instant::now();
    while results(&folder) < count {
        std::thread::sleep(Duration::from_secs(1));
    }
    println!("done in {:.0} s more", began.elapsed().as_secs_f64());
    for verb in ["status", "collect"] {
        let mut command = rig(["study", verb]);
        command.arg(&folder).stdout(Stdio::null());
        let (wall_s, peak_mib) = measured(told(command));
        println!("{verb}: {wall_s:.1} s, {peak_mib:.0} MiB");
    }
}

fn results(folder: &Path) -> usize {
    std::fs::read_dir(folder.join("results")).map_or(0, |entries| {
        entries.flatten().filter(|entry| !entry.file_name().as_encoded_bytes().starts_with(b".")).count()
    })
}

/// How long `command` takes \[s\], and the most memory that its process held \[MiB\].
fn measured(mut command: Command) -> (f64, f64) {
    let began = Instant::now();
    let mut child = command.spawn().expect("rig starts");
    let mut peak_kib = 0.0;
    loop {
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = peak.and_then(|peak| peak.trim().strip_suffix("kB")?.trim().parse().ok());
        peak_kib = f64::max(peak_kib, kib.unwrap_or(0.0));
        if let Some(status) = child.try_wait().expect("it can be asked") {
            assert!(status.success(), "{command:?}: {status}");
            return (began.elapsed().as_secs_f64(), peak_kib / 1024.0);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
