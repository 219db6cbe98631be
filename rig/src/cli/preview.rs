//! `rig preview`: what the camera sees, on a page of this machine.

use std::path::PathBuf;

use super::{Failure, Outcome};
use crate::preview::{PreviewError, Server, Watch};
use app::{base, interruptible};
use config::RigConfig;
use record::outputs::Outputs;

/// Arguments of `rig preview`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig config; its board is left alone, nothing moves
    pub config: PathBuf,
    /// Port of the page, which only this machine can open; 0 for any that is free
    #[arg(long, default_value_t = 8070)]
    pub port: u16,
}

/// Serves the page until a signal comes.
///
/// # Errors
/// [`Failure::Input`] for an unusable config or a port in use, [`Failure::Hardware`] when the camera cannot be opened.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let written = Outputs::edited(&args.config)?;
    let config = RigConfig::read(&args.config).map_err(Failure::input)?;
    let watch = Watch::start(config, base(&args.config));
    let watch = watch
        .map_err(|error| if error.is_input() { Failure::input(error) } else { Failure::hardware(error) })?;
    interruptible(async move |interrupt| {
        let failed = |error: PreviewError| match &error {
            PreviewError::Port { .. } => Failure::input(error),
            PreviewError::Serve(_) => Failure::internal(error),
        };
        let server = Server::listen(args.port, watch, written).await.map_err(failed)?;
        // Standard output is for what is left when all is over.
        super::say(&format!("http://{}/ shows the camera; Ctrl-C ends it", server.address()));
        server.serve(interrupt.raised()).await.map_err(failed)?;
        Ok(Outcome::default())
    })
}
