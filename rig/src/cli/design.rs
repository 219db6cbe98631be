//! `rig design`: the runs to make next, as configs and commands.

use std::fmt::Write as _;
use std::path::PathBuf;

use ident::diagnose::{NextExperiment, diagnose, pin_down};
use ident::experiment::Experiment;

use super::{Failure, Outcome};
use crate::app::design::{CONFIGS, write_configs};
use crate::config::paths;
use crate::outputs::Outputs;

/// Says which runs would tell rival causes apart, or pin down loose parameters.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// experiment.toml of the runs there are
    #[arg(value_name = "EXPERIMENT")]
    experiment: PathBuf,
    /// Fitted parameter to pin down; may be given again. Left out: the rivals of the diagnosis are told apart
    #[arg(long = "for", value_name = "PARAM")]
    parameters: Vec<String>,
    /// Config of the rig, from which the configs of the proposed runs are made
    #[arg(long, value_name = "RIG.toml", requires = "out")]
    config: Option<PathBuf>,
    /// Folder for these configs
    #[arg(long, value_name = "DIR", requires = "config")]
    out: Option<PathBuf>,
}

/// Carries out `rig design`.
///
/// # Errors
/// [`Failure::Input`] for an experiment or config that contradicts itself, [`Failure::Data`] for runs that hold no answer.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let read = Experiment::sources(&args.experiment).into_iter();
    let written = match (&args.config, &args.out) {
        (Some(config), Some(out)) => {
            let read = read.chain(paths::files(config));
            Some((config, Outputs::reading(read).folder(out, &CONFIGS)?))
        }
        _ => None,
    };
    let experiment = Experiment::read(&args.experiment)?;
    let (advice, next) = if args.parameters.is_empty() {
        let diagnosed = diagnose(&experiment, &mut ())?;
        (diagnosed.diagnosis.next_experiments, diagnosed.next)
    } else {
        pin_down(&experiment, &args.parameters)?
    };
    if let Some((config, out)) = &written {
        write_configs(config, &next, out)?;
    }
    Ok(Outcome { out: args.out.clone(), text: table(&advice), ..Outcome::default() })
}

fn table(advice: &[NextExperiment]) -> String {
    if advice.is_empty() {
        return "These runs leave no rival to tell apart; name loose parameters with --for.\n".into();
    }
    let mut text = String::new();
    for next in advice {
        let about = next.separates.join(" / ");
        let _ = match next.kind.as_str() {
            "measurement" => writeln!(text, "{about}: {}", next.what),
            _ => writeln!(
                text,
                "{about}: {:.3e} -> {:.3e}  {}  ({})",
                next.before, next.after, next.command, next.what
            ),
        };
    }
    text
}
