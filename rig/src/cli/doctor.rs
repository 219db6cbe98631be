//! `rig doctor`: checks everything a run needs, and says what to do about the rest.

use std::path::{Path, PathBuf};

use anyhow::anyhow;

use super::{Failure, Outcome};
use app::base;
use app::doctor::{Check, Health, devices, host};
use config::{RigConfig, ScheduleConfig};
use daemon::next_slot;
use ground::clock::Now;
use ground::error_chain::with_causes;
use servo::ServoConfig;

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
    checks.extend(config.schedule.as_ref().map(schedule));
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

/// Whether a daemon takes the schedule, and when it would run first.
fn schedule(config: &ScheduleConfig) -> Check {
    let subject = "schedule";
    match next_slot(config, Now::read()) {
        Ok(slot) => Check::good(subject, format!("`{}`: next at {slot}", config.cron)),
        Err(error) => Check::bad(subject, with_causes(&error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedule_that_no_daemon_takes_is_told() {
        let look = |text: &str| schedule(&toml::from_str(text).unwrap());
        let good = look("cron = \"0 3 * * *\"\ntime_zone = \"Europe/Zurich\"");
        assert!(good.health == Health::Good && good.finding.contains("03:00:00"), "{good}");
        for (text, word) in [
            ("cron = \"0 25 * * *\"", "0 25 * * *"),
            ("cron = \"0 3 * * *\"\ntime_zone = \"Europe/Atlantis\"", "Europe/Atlantis"),
            ("cron = \"0 3 30 2 *\"", "has no slot"),
        ] {
            let bad = look(text);
            assert!(bad.health == Health::Bad && bad.finding.contains(word), "{bad}");
        }
    }
}
