//! `rig estop` and `rig release`: stop whatever moves the rig and hold it; let it move again.

use std::path::{Path, PathBuf};

use super::{Failure, Outcome};
use app::stop;
use config::{RigConfig, stoppable};
use ground::error_chain::with_causes;
use ground::hold::Hold;
use servo::ServoConfig;

/// Arguments of `rig estop`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig config that names the port
    pub config: PathBuf,
    /// Folder of run folders, whose queue and schedule are held too
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
    /// Why, for who looks at it later
    #[arg(long, default_value = "emergency stop")]
    pub why: String,
}

/// Arguments of `rig release`.
#[derive(clap::Args, Debug)]
pub struct ReleaseArgs {
    /// The rig config that names the port
    pub config: PathBuf,
    /// Who says that it may move again
    #[arg(long)]
    pub by: String,
    /// Folder of run folders
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
}

/// Stops the servo and holds the rig until somebody releases it.
///
/// # Errors
/// As [`stop::stop`]; [`Failure::Input`] for a config that names no servo's port as far as it can be read: the runs folder is held then
/// all the same.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let (servo, trouble) = match RigConfig::read(&args.config) {
        Ok(config) => (config.servo, None),
        Err(error) => (stoppable::servo(&args.config), Some(error)),
    };
    let by = format!("rig estop ({})", user());
    let found = servo.as_ref().and_then(ServoConfig::outside_port).is_some();
    let stopped = stop::stop(servo.as_ref(), there(&args.runs_dir), &Hold::now(&by, &args.why));
    let text = match trouble {
        None => stopped?,
        Some(error) if found => {
            format!("{}\nthe config is wrong elsewhere: {}", stopped?, with_causes(&error))
        }
        Some(error) => {
            let said = "no port of a servo was found in the config; what is in the runs folder is held";
            return Err(Failure::Input(anyhow::Error::new(error).context(said)));
        }
    };
    Ok(Outcome { text, ..Outcome::default() })
}

/// Lets the rig move again.
///
/// # Errors
/// As [`stop::release`]; [`Failure::Input`] for a config that cannot be read.
pub fn release(args: &ReleaseArgs) -> Result<Outcome, Failure> {
    let config = RigConfig::read(&args.config).map_err(Failure::input)?;
    let text = stop::release(&config, there(&args.runs_dir), &args.by)?;
    Ok(Outcome { text, ..Outcome::default() })
}

fn there(runs_dir: &Path) -> Option<&Path> {
    Some(runs_dir).filter(|folder| folder.is_dir())
}

fn user() -> String {
    ["SUDO_USER", "USER", "LOGNAME"]
        .into_iter()
        .find_map(|name| std::env::var(name).ok())
        .unwrap_or_else(|| format!("user {}", rustix::process::getuid().as_raw()))
}
