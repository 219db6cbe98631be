//! `rig design`: the runs to make next, as configs and commands.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use ident::design::runs::{Motion, Proposal};
use ident::diagnose::{DiagnoseError, NextExperiment, diagnose, pin_down};
use ident::experiment::Experiment;

use super::{Failure, Outcome, experiment::unfit};
use crate::record::folder::write_whole;

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
    let experiment = Experiment::read(&args.experiment).map_err(unfit)?;
    let (advice, next) = if args.parameters.is_empty() {
        let diagnosed = diagnose(&experiment, &mut ()).map_err(failure)?;
        (diagnosed.diagnosis.next_experiments, diagnosed.next)
    } else {
        pin_down(&experiment, &args.parameters).map_err(failure)?
    };
    if let (Some(config), Some(out)) = (&args.config, &args.out) {
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

/// Tables and keys of a rig config that hold paths.
const PATHS: [(&str, &str); 4] =
    [("run", "model"), ("mock", "tank"), ("vision", "static_mask"), ("calibration", "file")];

/// Writes a config for each of `next` to `folder`: `config` with another motion.
///
/// # Errors
/// [`Failure::Input`] where `config` cannot be read, [`Failure::Internal`] where the folder cannot be written.
pub(super) fn write_configs(config: &Path, next: &[Proposal], folder: &Path) -> Result<(), Failure> {
    let reading = || format!("reading the rig's config {}", config.display());
    let text = std::fs::read_to_string(config).with_context(reading).map_err(Failure::Input)?;
    let mut base: toml::Table = text.parse().with_context(reading).map_err(Failure::Input)?;
    let origin = std::path::absolute(config).with_context(reading).map_err(Failure::Input)?;
    for (table, key) in PATHS {
        let Some(value) = base.get_mut(table).and_then(|table| table.get_mut(key)) else { continue };
        if let (Some(relative), Some(parent)) = (value.as_str(), origin.parent()) {
            *value = parent.join(relative).display().to_string().into();
        }
    }
    std::fs::create_dir_all(folder).map_err(Failure::internal)?;
    let mut written = BTreeSet::new();
    for proposal in next.iter().filter(|proposal| written.insert(proposal.id.clone())) {
        let config = changed(&base, proposal)?;
        let text = format!("# Proposed by rig design: {}.\n{config}", proposal.words());
        write_whole(&folder.join(format!("{}.toml", proposal.id)), text.as_bytes())
            .map_err(Failure::internal)?;
    }
    Ok(())
}

fn changed(base: &toml::Table, proposal: &Proposal) -> Result<toml::Table, Failure> {
    let mut config = base.clone();
    let run = config.get_mut("run").and_then(toml::Value::as_table_mut);
    let run = run.ok_or_else(|| Failure::Input(anyhow!("the rig's config has no [run] table")))?;
    run.insert("name".into(), format!("Next: {}", proposal.words()).into());
    run.insert("kind".into(), proposal.kind().into());
    match proposal.motion {
        Motion::Drop { .. } => {
            run.insert("film_s".into(), proposal.seconds.into());
            config.remove("profile");
        }
        Motion::Driven { amplitude_rad, ccw_s, cw_s } => {
            let mut profile =
                config.get("profile").and_then(toml::Value::as_table).cloned().unwrap_or_default();
            for (key, number) in [("amplitude_rad", amplitude_rad), ("ccw_s", ccw_s), ("cw_s", cw_s)] {
                profile.insert(key.into(), number.into());
            }
            profile.insert("cycles".into(), i64::from(proposal.cycles()).into());
            profile.insert("soft_start_cycles".into(), 0.into());
            config.insert("profile".into(), profile.into());
        }
    }
    Ok(config)
}

/// What kind of failure a diagnosis ended with.
pub(super) fn failure(error: DiagnoseError) -> Failure {
    match error {
        DiagnoseError::Interrupted => Failure::Interrupted(error.into()),
        error if error.is_lack_of_data() => Failure::data(error),
        error => Failure::input(error),
    }
}
