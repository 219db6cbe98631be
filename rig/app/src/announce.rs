//! The announcement of a motion that begins by itself: nobody has just asked for it, and somebody's hand may be in the tank. It waits
//! during quiet hours and after too many motions, and is announced by a countdown in which it can be stopped.

use std::path::Path;
use std::time::Duration;

use anyhow::anyhow;
use jiff::{SignedDuration, Timestamp};

use super::{Failure, Interrupt, Watcher};
use config::RigConfig;
use ground::clock::MonotonicNs;
use record::run_id::RunId;
use run::open;
use servo::ServoError;
use servo::motion::{Motion, Reporter};

/// Interval at which the countdown is shown and a stop is checked. Chosen.
const COUNTDOWN_INTERVAL: Duration = Duration::from_millis(50);
/// Interval at which a motion that has to wait is checked again. Chosen.
const WAIT_CHECK_INTERVAL: Duration = Duration::from_millis(500);

/// Why a motion of `config` that nobody has asked for is not to begin at `now`, in words.
///
/// # Errors
/// [`Failure::Input`] where the runs folder cannot be read.
pub fn not_now(config: &RigConfig, runs_dir: &Path, now: Timestamp) -> Result<Option<String>, Failure> {
    if let Some(schedule) = &config.schedule {
        let clock = now.to_zoned(schedule.zone().map_err(Failure::input)?);
        if schedule.is_quiet(&clock) {
            return Ok(Some(format!("quiet hours, at {}", clock.strftime("%H:%M"))));
        }
    }
    too_many(config, runs_dir, now)
}

/// Why a motion of `config` at `now` would exceed `[motion] most_per_hour`, in words; also for motions that a person asks for.
///
/// # Errors
/// As [`not_now`].
pub fn too_many(config: &RigConfig, runs_dir: &Path, now: Timestamp) -> Result<Option<String>, Failure> {
    let Some(most) = config.motion.most_per_hour(config.is_simulated()) else { return Ok(None) };
    let hour_ago = now.saturating_sub(SignedDuration::from_hours(1)).map_err(Failure::internal)?;
    // a run is named by when it began
    let names = [hour_ago, now].map(|time| time.strftime("%Y%m%dT%H%M%SZ").to_string());
    let entries = match std::fs::read_dir(runs_dir) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        entries => entries.map_err(Failure::input)?,
    };
    let ids =
        entries.flatten().filter_map(|entry| RunId::try_from(entry.file_name().into_string().ok()?).ok());
    let lately = ids.filter(|id| {
        let began = id.as_str().split('-').next().unwrap_or_default();
        names[0].as_str() < began && began <= names[1].as_str()
    });
    let begun = lately.count();
    Ok((begun >= most).then(|| {
        format!("{begun} motions within the last hour, and {most} are the most ([motion] most_per_hour)")
    }))
}

/// Waits until a motion of `config` that nobody has asked for may begin.
///
/// # Errors
/// [`Failure::Held`], [`Failure::Interrupted`], or as [`not_now`].
pub async fn wait_until_allowed(
    config: &RigConfig,
    runs_dir: &Path,
    interrupt: &Interrupt,
    watcher: &mut dyn Watcher,
) -> Result<(), Failure> {
    while let Some(why) = not_now(config, runs_dir, Timestamp::now())? {
        watcher.status(format!("waits: {why}"));
        watcher.showing().stage(&format!("waits: {why}"), None);
        pause(WAIT_CHECK_INTERVAL, config, runs_dir, interrupt).await?;
    }
    Ok(())
}

/// Counts down to a motion of `config`.
///
/// # Errors
/// [`Failure::Held`], [`Failure::Interrupted`]: nothing has moved.
pub async fn count_down(
    config: &RigConfig,
    runs_dir: &Path,
    interrupt: &Interrupt,
    watcher: &mut dyn Watcher,
) -> Result<(), Failure> {
    let announce = config.motion.announce(config.is_simulated());
    if announce.is_zero() {
        return Ok(());
    }
    let reporter = Reporter::of(Some(runs_dir));
    let began = MonotonicNs::now();
    let begins = began.plus_seconds(announce.as_secs_f64());
    let mut shown = String::new();
    // the remaining time is in the reported servo state
    watcher.showing().stage("about to move", None);
    loop {
        let left_s = begins.seconds_since(MonotonicNs::now());
        if left_s <= 0.0 {
            return Ok(());
        }
        reporter.report(Motion::Announced, began, Some(begins));
        let text = format!("moves in {:.0} s", left_s.ceil());
        if text != shown {
            watcher.status(text.clone());
            shown = text;
        }
        if let Err(failure) = pause(COUNTDOWN_INTERVAL, config, runs_dir, interrupt).await {
            reporter.report(Motion::AtRest, MonotonicNs::now(), None);
            return Err(failure);
        }
    }
}

async fn pause(
    pause: Duration,
    config: &RigConfig,
    runs_dir: &Path,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    if let Some(hold) = open::latch(config, Some(runs_dir)).held() {
        return Err(Failure::Held(ServoError::Held(hold).into()));
    }
    tokio::select! {
        () = interrupt.raised() => Err(Failure::Interrupted(anyhow!("interrupted before anything moved"))),
        () = tokio::time::sleep(pause) => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_are_counted_over_the_last_hour_and_quiet_hours_are_now() {
        let folder = tempfile::tempdir().unwrap();
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/chain-driven-hanging.toml");
        let text = std::fs::read_to_string(&configs).unwrap();
        let text = text.replace(
            "[water]",
            "[motion]\nmost_per_hour = 2\n[schedule]\ncron = \"0 * * * *\"\ntime_zone = \"UTC\"\nquiet = [\"22:00-07:00\"]\n[water]",
        );
        let config = RigConfig::parse(&text, &configs).unwrap();
        let now = |text: &str| text.parse::<Timestamp>().unwrap();
        let why = |at: &str| not_now(&config, folder.path(), now(at)).unwrap().unwrap_or_default();
        assert_eq!(why("2026-11-27T12:00:00Z"), "");
        for run in ["20261127T105959Z-ab12cd", "20261127T111500Z-ab12cd", "20991127T111500Z-ab12cd", "jobs"] {
            std::fs::create_dir(folder.path().join(run)).unwrap();
        }
        assert_eq!(why("2026-11-27T12:00:00Z"), "");
        std::fs::create_dir(folder.path().join("20261127T115959Z-ab12cd")).unwrap();
        assert!(why("2026-11-27T12:00:00Z").contains("2 motions"), "{}", why("2026-11-27T12:00:00Z"));
        assert_eq!(why("2026-11-27T12:15:01Z"), "");
        assert!(why("2026-11-27T22:00:00Z").contains("quiet"));
    }
}
