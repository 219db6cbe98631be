//! `rig firmware`: firmware for servo boards.

use std::path::PathBuf;

use super::choice::choice;
use super::{Failure, Outcome};
use app::firmware::{BoardKind, flash};

/// Arguments of `rig firmware`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// What to do
    #[command(subcommand)]
    pub what: What,
}

/// What can be done.
#[derive(clap::Subcommand, Debug)]
pub enum What {
    /// Write firmware to a board and see whether it answers
    Flash(FlashArgs),
}

/// Arguments of `rig firmware flash`.
#[derive(clap::Args, Debug)]
pub struct FlashArgs {
    /// Which board it is
    #[arg(long, value_parser = choice::<BoardKind>())]
    pub board: BoardKind,
    /// The port it is on; `rig list` shows what there is
    #[arg(long)]
    pub port: String,
    /// The firmware: what firmware-protocol/uno/build, or the Pico's build, has written
    #[arg(long, value_name = "FILE")]
    pub image: PathBuf,
}

/// Writes the firmware.
///
/// # Errors
/// [`Failure`], as [`flash`] says.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let What::Flash(FlashArgs { board, port, image }) = &args.what;
    let status = flash(*board, port, image)?;
    let text = format!(
        "firmware written; the board on {port} answers: {:?}, latched fault: {:?}, boot id {:08x}",
        status.state, status.fault, status.boot_id
    );
    Ok(Outcome { text, ..Outcome::default() })
}
