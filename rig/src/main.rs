//! The `rig` program: reads the command line, carries out one verb, says how it went.

use std::io::{IsTerminal, Write};
use std::process::ExitCode;

use clap::Parser;
use rig::cli::{self, Cli, Failure, Outcome};
use tracing_subscriber::EnvFilter;

fn main() -> ExitCode {
    let arguments = Cli::parse();
    start_log(arguments.verbose);
    let result = arguments.verb.carry_out();
    if arguments.json {
        print(&serde_json::to_string(&cli::result(&result)).unwrap_or_default());
    } else {
        print_result(&result)
    }
    match result {
        Ok(outcome) => ExitCode::from(outcome.exit_code(arguments.strict)),
        Err(failure) => ExitCode::from(failure.exit_code()),
    }
}

/// Crates whose log is shown at the chosen level.
const LOGGED_CRATES: [&str; 18] = [
    "analysis",
    "app",
    "calibrate",
    "camera",
    "config",
    "daemon",
    "ground",
    "ident",
    "images",
    "interchange",
    "record",
    "report",
    "rig",
    "run",
    "servo",
    "store",
    "study",
    "vision",
];

fn start_log(verbose: u8) {
    let (ours, theirs) = [("warn", "warn"), ("info", "warn"), ("debug", "info")][usize::from(verbose.min(2))];
    let level = LOGGED_CRATES.map(|name| format!("{name}={ours},")).concat() + theirs;
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        // a log on a full disk is no reason to end a run: it would be told on the same disk, which panics
        .log_internal_errors(false)
        .init();
}

fn print(text: &str) {
    // A closed pipe (`rig runs ls | head`) is the reader's way to say enough.
    let _ = writeln!(std::io::stdout(), "{}", text.trim_end());
}

fn print_result(result: &Result<Outcome, Failure>) {
    match result {
        Ok(outcome) => {
            if !outcome.text.is_empty() {
                print(&outcome.text);
            }
            outcome.warnings.iter().for_each(|warning| cli::say(&format!("rig: warning: {warning}")));
        }
        Err(failure) => cli::say(&format!("rig: {:#}", failure.error())),
    }
}
