//! `rig design`: the runs to make next, as configs and commands.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::anyhow;
use ident::diagnose::{NextExperiment, diagnose, pin_down};
use ident::experiment::Experiment;

use super::{Failure, Outcome};
use app::compose::{Given, config_of, given};
use app::design::{CONFIGS, add_commands, write_configs};
use config::paths;
use record::outputs::Outputs;

/// Says which runs would tell rival causes apart, or pin down loose parameters.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// experiment.toml of the runs there are, or a run folder
    #[arg(value_name = "EXPERIMENT")]
    pub experiment: PathBuf,
    /// Fitted parameter to pin down; may be given again. Left out: the rivals of the diagnosis are told apart
    #[arg(long = "for", value_name = "PARAM")]
    pub parameters: Vec<String>,
    /// Config of the rig, from which the configs of the proposed runs are made [default: the one that a run folder says it was made with]
    #[arg(long, value_name = "RIG.toml", requires = "out")]
    pub config: Option<PathBuf>,
    /// Folder for these configs
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Carries out `rig design`.
///
/// # Errors
/// [`Failure::Input`] for an experiment or config that contradicts itself, [`Failure::Data`] for runs that hold no answer.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let config = args.config.clone().or_else(|| config_of(&args.experiment));
    if let (None, Some(out)) = (&config, &args.out) {
        return Err(Failure::Input(anyhow!(
            "configs for {} are made of the rig's own: say which, `--config RIG.toml`",
            out.display()
        )));
    }
    let read = Experiment::sources(&args.experiment).into_iter();
    let written = match (&config, &args.out) {
        (Some(config), Some(out)) => {
            let read = read.chain(paths::files(config));
            Some((config, Outputs::reading(read).folder(out, &CONFIGS)?))
        }
        _ => None,
    };
    let Given { experiment, .. } = given(&args.experiment)?;
    let (mut advice, next) = if args.parameters.is_empty() {
        let diagnosed = diagnose(&experiment, &mut ())?;
        (diagnosed.diagnosis.next_experiments, diagnosed.next)
    } else {
        pin_down(&experiment, &args.parameters)?
    };
    if let Some((config, out)) = &written {
        write_configs(config, &next, out)?;
        add_commands(&mut advice, out.path());
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
        let _ = match (&next.proposal, next.command.as_str()) {
            (None, _) => writeln!(text, "{about}: {}", next.what),
            (Some(_), "") => {
                writeln!(text, "{about}: {:.3e} -> {:.3e}  {}", next.before, next.after, next.what)
            }
            (Some(_), command) => {
                writeln!(
                    text,
                    "{about}: {:.3e} -> {:.3e}  {command}  ({})",
                    next.before, next.after, next.what
                )
            }
        };
    }
    if advice.iter().any(|next| next.proposal.is_some() && next.command.is_empty()) {
        text.push_str("With --config, the rig's config, and --out a config of each is written.\n");
    }
    text
}
