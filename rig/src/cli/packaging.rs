//! `rig packaging`, hidden: what a package holds beside the program, written from the command line as it is.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::CommandFactory as _;
use clap_complete::Shell;

use super::{Cli, Failure, Outcome};
use record::outputs::Outputs;

/// Arguments of `rig packaging`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Folder that gets completions/rig.bash, completions/_rig, completions/rig.fish and man/*.1
    pub out: PathBuf,
}

/// Writes completions for three shells, and a man page of each verb.
///
/// # Errors
/// [`Failure::Input`] where the folder cannot be written to.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let out = Outputs::default().folder(&args.out, &["completions", "man"])?;
    write(out.path())
        .with_context(|| format!("writing into {}", args.out.display()))
        .map_err(Failure::Input)?;
    Ok(Outcome { out: Some(args.out.clone()), ..Outcome::default() })
}

fn write(out: &Path) -> std::io::Result<()> {
    let (completions, man) = (out.join("completions"), out.join("man"));
    std::fs::create_dir_all(&completions)?;
    std::fs::create_dir_all(&man)?;
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        clap_complete::generate_to(shell, &mut Cli::command(), "rig", &completions)?;
    }
    clap_mangen::generate_to(Cli::command(), &man)
}
