//! `rig doctor`: checks everything a run needs, and says what to do about the rest.

use std::path::{Path, PathBuf};

use anyhow::anyhow;

use super::{Failure, Outcome};
use crate::app::base;
use crate::config::RigConfig;
use crate::doctor::{Check, Health, devices, host};
use crate::servo::ServoConfig;

/// Arguments of `rig doctor`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig config
    pub config: PathBuf,
    /// Folder of run folders
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
}

/// Looks at host, board and camera. Nothing moves.
///
/// # Errors
/// [`Failure::Hardware`] when a run cannot work, with all findings; [`Failure::Input`] for an unusable config.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let config = RigConfig::read(&args.config).map_err(Failure::input)?;
    let mut checks = vec![Check::good("config", args.config.display().to_string())];
    checks.extend(host::runs_folder(&args.runs_dir, config.expected_bytes()));
    checks.extend(host::write_rate(&args.runs_dir, config.camera_bytes_per_s(), config.camera.format));
    if let Some(port) = config.servo.as_ref().and_then(ServoConfig::outside_port) {
        checks.extend(host::latency_timer(Path::new(port)));
    }
    checks.extend(devices::look(&config, base(&args.config), &args.runs_dir));
    let text: Vec<String> = checks.iter().map(ToString::to_string).collect();
    let bad = checks.iter().filter(|check| check.health == Health::Bad).count();
    if bad > 0 {
        return Err(Failure::Hardware(anyhow!(
            "{bad} of {} checks failed\n{}",
            checks.len(),
            text.join("\n")
        )));
    }
    Ok(Outcome { text: text.join("\n"), ..Outcome::default() })
}
