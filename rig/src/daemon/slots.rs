//! When the schedule wants a run, and what becomes of the slots it cannot have: decided from the wall clock alone, so that a
//! year can be tried in a test.

use std::time::Duration;

use jiff::tz::TimeZone;
use jiff::{SignedDuration, Timestamp, Zoned};

use crate::config::{Overlap, QuietHours, ScheduleConfig};
use crate::schedule::{Schedule, ScheduleError};

/// A slot taken so late is on time: the daemon looks at the clock several times a second, and a machine may be busy.
const ON_TIME: SignedDuration = SignedDuration::from_secs(30);

/// The slots of a rig's schedule.
#[derive(Debug)]
pub(super) struct Slots {
    schedule: Schedule,
    zone: TimeZone,
    quiet: Vec<QuietHours>,
    overlap: Overlap,
    catch_up: SignedDuration,
    /// All slots up to here are dealt with.
    dealt_with: Zoned,
}

/// What becomes of slots that have come.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Decision {
    /// A run is wanted for this one.
    Run(Zoned),
    /// So many pass without a run.
    Skip {
        /// How many.
        slots: usize,
        /// Why.
        why: &'static str,
    },
}

/// What the rig is doing when a slot comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Busy {
    /// Nothing, and the water rests.
    Free,
    /// It moves, or the water is not at rest.
    Moving,
    /// A run waits already.
    Waiting,
}

/// The next slot of a config's schedule after `now`.
///
/// # Errors
/// [`ScheduleError`] where a daemon would refuse it.
pub fn next_slot(config: &ScheduleConfig, now: Timestamp) -> Result<Zoned, ScheduleError> {
    Slots::new(config, None, now)?.next()
}

impl Slots {
    /// Of a config's schedule; `last` is the last slot that an earlier daemon dealt with.
    ///
    /// # Errors
    /// [`ScheduleError`] for an expression or a time zone that cannot be used, or one without a slot.
    pub(super) fn new(
        config: &ScheduleConfig,
        last: Option<Timestamp>,
        now: Timestamp,
    ) -> Result<Self, ScheduleError> {
        let zone = match &config.time_zone {
            None => TimeZone::system(),
            Some(name) => TimeZone::get(name)
                .map_err(|error| ScheduleError::Zone { name: name.clone(), why: error.to_string() })?,
        };
        let catch_up = Duration::from_secs_f64(config.catch_up_s.map_or(0.0, |s| s.get()));
        let slots = Self {
            schedule: Schedule::parse(&config.cron)?,
            quiet: config.quiet.clone(),
            overlap: config.overlap,
            catch_up: SignedDuration::try_from(catch_up).unwrap_or(SignedDuration::MAX),
            // a last slot in the future is of a clock that was wrong
            dealt_with: last.filter(|&last| last < now).unwrap_or(now).to_zoned(zone.clone()),
            zone,
        };
        slots.next()?;
        Ok(slots)
    }

    /// The next slot.
    ///
    /// # Errors
    /// [`ScheduleError::Never`].
    pub(super) fn next(&self) -> Result<Zoned, ScheduleError> {
        self.schedule.next(&self.dealt_with)
    }

    /// Whether a slot has come.
    pub(super) fn is_due(&self, now: Timestamp) -> bool {
        self.next().is_ok_and(|next| next.timestamp() <= now)
    }

    /// What becomes of the slots that have come by `now`, of each once. Slots that were missed are never made up for one by one: a
    /// burst of late runs would be filmed in stirred water.
    pub(super) fn due(&mut self, now: Timestamp, busy: Busy) -> Vec<Decision> {
        let now = now.to_zoned(self.zone.clone());
        let Ok(first) = self.next() else { return Vec::new() };
        if first > now {
            return Vec::new();
        }
        let (newest, missed) = self.newest(first, &now);
        self.dealt_with = newest.clone();
        let late = now.duration_since(&newest);
        let mut decisions = Vec::new();
        let mut skip = |slots, why| {
            if slots > 0 {
                decisions.push(Decision::Skip { slots, why });
            }
        };
        skip(missed, "the daemon was down, or the clock jumped");
        if late > ON_TIME.max(self.catch_up) {
            skip(1, "the daemon was down, or the clock jumped");
        } else if self.quiet.iter().any(|quiet| quiet.contains(newest.time())) {
            skip(1, "quiet hours");
        } else {
            match (busy, self.overlap) {
                (Busy::Waiting, _) => skip(1, "a run waits already"),
                (Busy::Moving, Overlap::Skip) => skip(1, "the rig was busy or the water not at rest"),
                (Busy::Moving, Overlap::Queue) | (Busy::Free, _) => decisions.push(Decision::Run(newest)),
            }
        }
        decisions
    }

    /// The newest slot by `now`, from the `first` one on, and how many lie before it.
    fn newest(&self, first: Zoned, now: &Zoned) -> (Zoned, usize) {
        let mut newest = first;
        let mut before = 0;
        while let Ok(next) = self.schedule.next(&newest)
            && next <= *now
        {
            newest = next;
            before += 1;
            // a daemon down for a year need not count every second
            if before == Schedule::MAX_COUNTED {
                return (now.clone(), before);
            }
        }
        (newest, before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(text: &str) -> ScheduleConfig {
        toml::from_str(text).unwrap()
    }

    fn at(text: &str) -> Timestamp {
        text.parse().unwrap()
    }

    /// What is decided, in a word each, when `slots` is asked every `step` from `from` to `to`.
    fn asked(slots: &mut Slots, from: &str, to: &str, step_s: i64, busy: Busy) -> Vec<String> {
        let (mut now, to) = (at(from), at(to));
        let mut said = Vec::new();
        while now <= to {
            said.extend(slots.due(now, busy).into_iter().map(|decision| match decision {
                Decision::Run(slot) => format!("run {}", slot.timestamp()),
                Decision::Skip { slots, why } => format!("skip {slots}: {why}"),
            }));
            now += SignedDuration::from_secs(step_s);
        }
        said
    }

    #[test]
    fn a_year_of_three_o_clocks_has_one_run_a_night_through_both_changes_of_the_clocks() {
        let config = config("cron = \"0 3 * * *\"\ntime_zone = \"Europe/Zurich\"\n");
        let mut slots = Slots::new(&config, None, at("2026-01-01T00:00:00Z")).unwrap();
        let said = asked(&mut slots, "2026-01-01T00:00:00Z", "2026-12-31T23:59:00Z", 60, Busy::Free);
        assert_eq!(said.len(), 365);
        assert!(said.contains(&"run 2026-03-28T02:00:00Z".to_owned()), "winter time");
        assert!(said.contains(&"run 2026-03-29T01:00:00Z".to_owned()), "summer time");
        assert!(said.iter().all(|said| said.starts_with("run")));
    }

    #[test]
    fn a_slot_that_the_clock_jumps_over_in_spring_and_sees_twice_in_autumn_is_taken_once_a_day_at_most() {
        let config = config("cron = \"30 2 * * *\"\ntime_zone = \"Europe/Zurich\"\n");
        let mut slots = Slots::new(&config, None, at("2026-03-27T12:00:00Z")).unwrap();
        let spring = asked(&mut slots, "2026-03-27T12:00:00Z", "2026-03-30T12:00:00Z", 60, Busy::Free);
        assert!((2..=3).contains(&spring.len()), "{spring:?}");
        let mut slots = Slots::new(&config, None, at("2026-10-24T12:00:00Z")).unwrap();
        let autumn = asked(&mut slots, "2026-10-24T12:00:00Z", "2026-10-26T12:00:00Z", 60, Busy::Free);
        assert_eq!(autumn.len(), 2, "{autumn:?}");
    }

    #[test]
    fn missed_slots_are_skipped_or_the_newest_caught_up_with_never_a_burst() {
        let missed = "0 * * * *";
        let mut slots = Slots::new(
            &config(&format!("cron = \"{missed}\"")),
            Some(at("2026-11-20T00:00:00Z")),
            at("2026-11-20T05:20:00Z"),
        )
        .unwrap();
        assert_eq!(
            asked(&mut slots, "2026-11-20T05:20:00Z", "2026-11-20T05:21:00Z", 1, Busy::Free),
            [
                "skip 4: the daemon was down, or the clock jumped",
                "skip 1: the daemon was down, or the clock jumped"
            ]
        );
        let mut slots = Slots::new(
            &config(&format!("cron = \"{missed}\"\ncatch_up_s = 1800.0")),
            Some(at("2026-11-20T00:00:00Z")),
            at("2026-11-20T05:20:00Z"),
        )
        .unwrap();
        assert_eq!(
            asked(&mut slots, "2026-11-20T05:20:00Z", "2026-11-20T05:21:00Z", 1, Busy::Free),
            ["skip 4: the daemon was down, or the clock jumped", "run 2026-11-20T05:00:00Z"]
        );
    }

    #[test]
    fn clock_that_jumps_back_gives_no_slot_twice() {
        let mut slots =
            Slots::new(&config("cron = \"0 * * * *\""), None, at("2026-11-20T00:30:00Z")).unwrap();
        let mut said = asked(&mut slots, "2026-11-20T00:30:00Z", "2026-11-20T02:10:00Z", 10, Busy::Free);
        said.extend(asked(&mut slots, "2026-11-20T01:10:00Z", "2026-11-20T03:10:00Z", 10, Busy::Free));
        assert_eq!(said, ["01", "02", "03"].map(|hour| format!("run 2026-11-20T{hour}:00:00Z")));
    }

    #[test]
    fn quiet_hours_reach_over_midnight_and_overlaps_follow_their_policy() {
        let text = "cron = \"0 * * * *\"\ntime_zone = \"UTC\"\nquiet = [\"22:00-07:00\"]\n";
        let mut slots = Slots::new(&config(text), None, at("2026-11-20T20:30:00Z")).unwrap();
        let night = asked(&mut slots, "2026-11-20T20:30:00Z", "2026-11-21T07:30:00Z", 10, Busy::Free);
        let runs: Vec<_> = night.iter().filter(|said| said.starts_with("run")).collect();
        assert_eq!(runs, ["run 2026-11-20T21:00:00Z", "run 2026-11-21T07:00:00Z"]);

        let busy = |overlap: &str, busy| {
            let text = format!("cron = \"0 * * * *\"\noverlap = \"{overlap}\"");
            let mut slots = Slots::new(&config(&text), None, at("2026-11-20T20:30:00Z")).unwrap();
            asked(&mut slots, "2026-11-20T21:00:00Z", "2026-11-20T21:00:05Z", 1, busy).remove(0)
        };
        assert!(busy("skip", Busy::Moving).starts_with("skip"));
        assert!(busy("queue", Busy::Moving).starts_with("run"));
        assert!(busy("queue", Busy::Waiting).starts_with("skip"));
    }

    #[test]
    fn unknown_time_zone_is_named() {
        let config = config("cron = \"0 3 * * *\"\ntime_zone = \"Europe/Atlantis\"");
        let error = Slots::new(&config, None, at("2026-01-01T00:00:00Z")).unwrap_err().to_string();
        assert!(error.contains("Europe/Atlantis"), "{error}");
    }
}
