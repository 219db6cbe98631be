//! The `rig` program: reads the command line, carries out one verb, says how it went.

use std::io::IsTerminal;
use std::process::ExitCode;

use clap::Parser;
use rig::cli::{Cli, Failure, InRun, Outcome};
use tracing_subscriber::EnvFilter;

fn main() -> ExitCode {
    let cli = Cli::parse();
    start_log(cli.verbose);
    let result = cli.verb.carry_out();
    if cli.json {
        say_json(&result)
    } else {
        say(&result)
    }
    match result {
        Ok(outcome) => ExitCode::from(outcome.exit_code(cli.strict)),
        Err(failure) => ExitCode::from(failure.exit_code()),
    }
}

/// Whose log is told of.
const CRATES: [&str; 17] = [
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
    "vision",
];

fn start_log(verbose: u8) {
    let (ours, theirs) = [("warn", "warn"), ("info", "warn"), ("debug", "info")][usize::from(verbose.min(2))];
    let level = CRATES.map(|name| format!("{name}={ours},")).concat() + theirs;
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
        Ok(outcome) => {
            if !outcome.text.is_empty() {
                print(&outcome.text);
            }
            outcome.warnings.iter().for_each(|warning| eprintln!("rig: mind: {warning}"));
        }
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
