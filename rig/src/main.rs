//! The `rig` program: reads the command line, carries out one verb, says how it went.

use std::io::IsTerminal;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use rig::cli::{self, Failure, InRun, Outcome};
use tracing_subscriber::EnvFilter;

/// Runs tank experiments: drives, films, extracts, fits, reports, replays.
#[derive(Parser, Debug)]
#[command(name = "rig", version, max_term_width = 110)]
struct Cli {
    /// Standard output is exactly one JSON object: status, out, run, verdict, error
    #[arg(long, global = true)]
    json: bool,
    /// More to read on standard error; twice for every detail
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand, Debug)]
enum Verb {
    /// Write a rig of your own: config and model, out of a few answers
    New(cli::new::Args),
    /// Run the whole experiment: arm, drive or wait for the release, film, extract, fit, report
    Run(cli::run::Args),
    /// Redo a recorded run, from any stage, into another folder
    Replay(cli::replay::Args),
    /// Measure what a rig needs once: pixels to metres
    Calibrate(cli::calibrate::Args),
    /// Images to keypoint trajectories
    Extract(cli::extract::Args),
    /// Put run folders together into an experiment.toml
    Experiment(cli::experiment::Args),
    /// Fit a model's parameters to an experiment
    Fit(cli::fit::Args),
    /// Say what the simulation of an experiment gets wrong, and why
    Diagnose(cli::diagnose::Args),
    /// Say which runs would tell more, and write their configs
    Design(cli::design::Args),
    /// Move a model through time
    Simulate(cli::simulate::Args),
    /// Bring the last good fit up to date with a run
    Recalibrate(cli::recalibrate::Args),
    /// Do the jobs of one or several rigs, and run their experiments on schedule
    Daemon(cli::daemon::Args),
    /// Look at the queue of jobs, add to it, cancel
    Jobs(cli::jobs::Args),
    /// Show what the camera sees, with focus, light and flicker, on a page of this machine
    Preview(cli::preview::Args),
    /// Check everything a run needs, and say what to do about the rest
    Doctor(cli::doctor::Args),
    /// List serial ports and cameras, and why one cannot be used
    List(cli::list::Args),
    /// Say who holds the rig, how the board is and how the last run went
    Status(cli::status::Args),
    /// Move one servo by hand, slowly
    Jog(cli::jog::Args),
    /// Write firmware to a servo board
    Firmware(cli::firmware::Args),
    /// Stop the servo now, also from beside a running rig
    Estop(cli::estop::Args),
    /// A servo board behind a pseudo-terminal, as a process of its own
    MockBoard(cli::mock_board::Args),
    /// A camera on the simulated tank, as a process of its own
    MockCamera(cli::mock_camera::Args),
    /// Look at recorded runs
    Runs(cli::runs::Args),
    /// Hand results to other programs
    Export(cli::export::Args),
    /// Take over keypoints that other programs found
    Import(cli::import::Args),
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    start_log(cli.verbose);
    let result = match &cli.verb {
        Verb::New(args) => cli::new::run(args),
        Verb::Run(args) => cli::run::run(args),
        Verb::Replay(args) => cli::replay::run(args),
        Verb::Calibrate(args) => cli::calibrate::run(args),
        Verb::Extract(args) => cli::extract::run(args),
        Verb::Experiment(args) => cli::experiment::run(args),
        Verb::Fit(args) => cli::fit::run(args),
        Verb::Diagnose(args) => cli::diagnose::run(args),
        Verb::Design(args) => cli::design::run(args),
        Verb::Simulate(args) => cli::simulate::run(args),
        Verb::Recalibrate(args) => cli::recalibrate::run(args),
        Verb::Daemon(args) => cli::daemon::run(args),
        Verb::Jobs(args) => cli::jobs::run(args),
        Verb::Preview(args) => cli::preview::run(args),
        Verb::Doctor(args) => cli::doctor::run(args),
        Verb::List(args) => cli::list::run(args),
        Verb::Status(args) => cli::status::run(args),
        Verb::Jog(args) => cli::jog::run(args),
        Verb::Firmware(args) => cli::firmware::run(args),
        Verb::Estop(args) => cli::estop::run(args),
        Verb::MockBoard(args) => cli::mock_board::run(args),
        Verb::MockCamera(args) => cli::mock_camera::run(args),
        Verb::Runs(args) => cli::runs::run(args),
        Verb::Export(args) => cli::export::run(args),
        Verb::Import(args) => cli::import::run(args),
    };
    if cli.json {
        say_json(&result)
    } else {
        say(&result)
    }
    match result {
        Ok(outcome) => ExitCode::from(outcome.exit_code),
        Err(failure) => ExitCode::from(failure.exit_code()),
    }
}

fn start_log(verbose: u8) {
    let level =
        ["warn", "rig=info,ident=info,warn", "rig=debug,ident=debug,info"][usize::from(verbose.min(2))];
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .init();
}

fn print(text: &str) {
    use std::io::Write;
    // A closed pipe (`rig runs ls | head`) is the reader's way to say enough.
    let _ = writeln!(std::io::stdout(), "{}", text.trim_end());
}

fn say(result: &Result<Outcome, Failure>) {
    match result {
        Ok(outcome) if outcome.text.is_empty() => {}
        Ok(outcome) => print(&outcome.text),
        Err(failure) => eprintln!("rig: {:#}", failure.error()),
    }
}

fn say_json(result: &Result<Outcome, Failure>) {
    let object = match result {
        Ok(outcome) => {
            let mut object = serde_json::to_value(outcome).unwrap_or_default();
            object["status"] = "done".into();
            object
        }
        Err(failure) => {
            let mut object =
                serde_json::json!({ "status": failure.status(), "error": format!("{:#}", failure.error()) });
            if let Some(InRun(run)) = failure.error().downcast_ref() {
                object["run"] = run.display().to_string().into();
            }
            object
        }
    };
    print(&object.to_string());
}
