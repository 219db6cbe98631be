//! `rig new`: a rig's config and model out of a few answers.

mod ask;

use std::fmt::Write as _;
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};

use super::{Failure, Outcome, list};
use crate::setup::{Answers, CONFIG, Chain, Drive, File, MODEL, Scale, files};
use config::MotionKind;
use record::outputs::{OutputFolder, Outputs};

/// Arguments of `rig new`. On a terminal, what no option answers is asked, of a mock rig only the three things that make it another one;
/// else its default holds.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Folder to write the rig into: rig.toml and model.xml, for a mock rig also its tank; made where it is not there
    pub dir: PathBuf,
    /// The mechanism. Only chains of rigid links are written; soft arm and octopus have shipped examples to start from
    #[arg(long, value_enum, default_value_t)]
    pub mechanism: Mechanism,
    /// A real board and a real camera, although none is plugged in yet
    #[arg(long, conflicts_with = "mock")]
    pub real: bool,
    /// What is known of the rig
    #[command(flatten)]
    pub answers: Answers,
}

/// Kinds of mechanism.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Mechanism {
    /// Rigid links in a row
    #[default]
    Chain,
    /// A soft arm
    Arm,
    /// Arms round a free body
    Octopus,
}

/// Writes the rig. Nothing that is there already is written over.
///
/// # Errors
/// [`Failure::Input`] for answers that cannot be, naming the option, and where a file is there already.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let example = match args.mechanism {
        Mechanism::Chain => None,
        Mechanism::Arm => {
            Some("a soft arm: start from copies of configs/arm8.toml and configs/models/arm8.xml")
        }
        Mechanism::Octopus => {
            Some("an octopus: start from a copy of configs/models/octopus8.xml, and see configs/README.md")
        }
    };
    if let Some(example) = example {
        return Err(Failure::Input(anyhow!("rig new writes chains of rigid links, not {example}")));
    }
    let taken = |name: &str| args.dir.join(name).symlink_metadata().is_ok().then(|| args.dir.join(name));
    let is_free = |files: &[&str]| match files.iter().find_map(|name| taken(name)) {
        Some(path) => Err(Failure::Input(anyhow!(
            "{} is there already, and rig new writes over nothing: choose another folder, or move it away",
            path.display()
        ))),
        None => Ok(()),
    };
    // Before anybody answers anything.
    is_free(&[CONFIG, MODEL])?;
    let (ports, cameras) = (list::serial_ports(), list::cameras());
    let is_bare = ports.is_empty() && cameras.is_empty();
    let may_be_mock = is_bare && !args.real && !args.answers.name_devices();
    let found = ask::Found { ports: ready(ports), cameras: ready(cameras), may_be_mock };
    let answers = match std::io::stdin().is_terminal() && std::io::stderr().is_terminal() {
        true => ask::ask(&args.answers, &found, &mut std::io::stdin().lock(), &mut std::io::stderr())
            .context("asking")
            .map_err(Failure::Input)?,
        false => Answers { mock: args.answers.mock || may_be_mock, ..args.answers.clone() },
    };
    let chain = Chain::new(&answers).map_err(Failure::input)?;
    let files = files(&name_of(&args.dir), &chain);
    let names: Vec<&str> = files.iter().map(|file| file.name).collect();
    is_free(&names)?;
    write(&Outputs::default().folder(&args.dir, &names)?, &files).map_err(Failure::Input)?;
    let mut text = next(&args.dir, &chain, &files);
    if answers.mock && !args.answers.mock {
        text += "\nno board and no camera is plugged in, so this is a mock rig, in a simulated tank; for a real one add --real\n";
    }
    Ok(Outcome { out: Some(args.dir.clone()), text, ..Outcome::default() })
}

/// Devices that could be used now.
fn ready(devices: Vec<list::Device>) -> Vec<String> {
    let ready = devices.into_iter().filter(|device| device.obstacle.is_none());
    ready.filter_map(|device| device.path.into_os_string().into_string().ok()).collect()
}

/// The rig is called as its folder is.
fn name_of(dir: &Path) -> String {
    let full = std::path::absolute(dir).unwrap_or_else(|_| dir.into());
    full.file_name().map_or_else(|| "rig".into(), |name| name.to_string_lossy().into_owned())
}

fn write(dir: &OutputFolder, files: &[File]) -> anyhow::Result<()> {
    // The config comes last: where it is, all that it names is.
    for file in files.iter().rev() {
        dir.write(file.name, file.text.as_bytes())?;
    }
    Ok(())
}

/// What was written, and what to do with it.
fn next(dir: &Path, chain: &Chain, files: &[File]) -> String {
    let config = dir.join(CONFIG);
    let config = config.display();
    let names: Vec<_> = files.iter().map(|file| file.name).collect();
    let mut text = format!("{}: wrote {}\n\nnext:\n", dir.display(), names.join(", "));
    let mut say = |command: String, why: &str| {
        let _ = writeln!(text, "  {command:<44}  {why}");
    };
    let real = chain.drive != Drive::Mock;
    if real {
        say(format!("$EDITOR {config}"), "replace or measure every value marked YOUR");
    }
    say(format!("rig doctor {config}"), "is everything there that a run needs?");
    say(
        format!("rig preview {config}"),
        "the picture with the model's links over it; a click sets the origin",
    );
    if real {
        if matches!(chain.picture.scale, Scale::Square { .. }) {
            say(
                "rig calibrate camera IMAGES --board ...".into(),
                "pixels to metres, from pictures of a board in the water",
            );
        }
        if chain.motion == MotionKind::Driven {
            say(format!("rig calibrate servo {config}"), "pulses to angles, from the pictures");
        }
    }
    say(format!("rig run {config}"), "the whole experiment");
    text
}
