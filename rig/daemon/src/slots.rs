//! When the schedule wants a run, and which slots are skipped: decided from the clocks alone, so that a test can try a year.
//!
//! The end of the handled slots is stored as time since the machine's start, not as wall-clock time: if the wall clock is set, forward
//! or back, that moment moves with it, so that no slot is missed or run twice, and nothing runs at a time that is no slot.

use std::collections::VecDeque;
use std::time::Duration;

use ground::strict::Seconds;
use jiff::tz::TimeZone;
use jiff::{SignedDuration, Timestamp, Zoned};

use config::schedule::{Schedule, ScheduleError};
use config::{Overlap, ScheduleConfig};
use ground::clock::Now;

/// A slot run with up to this delay counts as on time: the machine may be busy. A smaller step of the wall clock counts as its usual
/// correction. Chosen.
const SLOT_DELAY_TOLERANCE: SignedDuration = SignedDuration::from_secs(30);
/// Number of handled slots that are remembered by their time, so that a clock set back does not repeat them. Chosen.
const REMEMBERED_SLOTS: usize = 1000;

/// The slots of a rig's schedule.
#[derive(Debug)]
pub(super) struct Slots {
    schedule: Schedule,
    config: ScheduleConfig,
    zone: TimeZone,
    catch_up: SignedDuration,
    /// All slots up to this moment are handled; time since the machine's start.
    handled_until: SignedDuration,
    /// Times of the newest handled slots, the newest last.
    handled: VecDeque<Timestamp>,
    last_reading: Now,
}

/// What is done with slots that are due.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Decision {
    /// A run is added for this slot.
    Run(Zoned),
    /// Slots pass without a run.
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
    /// It is held.
    Held,
}

/// The next slot of a config's schedule after `now`.
///
/// # Errors
/// [`ScheduleError`] where a daemon would refuse it.
pub fn next_slot(config: &ScheduleConfig, now: Now) -> Result<Zoned, ScheduleError> {
    Slots::new(config, None, now)?.next(now)
}

impl Slots {
    /// Of a config's schedule; `last` is the last slot that an earlier daemon handled.
    ///
    /// # Errors
    /// [`ScheduleError`] for an expression or a time zone that cannot be used, or one without a slot.
    pub(super) fn new(
        config: &ScheduleConfig,
        last: Option<Timestamp>,
        now: Now,
    ) -> Result<Self, ScheduleError> {
        let catch_up = config.catch_up_s.map_or(Duration::ZERO, Seconds::duration);
        // a last slot in the future was recorded while the clock was wrong
        let last = last.filter(|&last| last < now.wall);
        let slots = Self {
            schedule: Schedule::parse(&config.cron)?,
            zone: config.zone()?,
            config: config.clone(),
            catch_up: SignedDuration::try_from(catch_up).unwrap_or(SignedDuration::MAX),
            handled_until: now
                .boot
                .saturating_sub(last.map_or(SignedDuration::ZERO, |last| now.wall.duration_since(last))),
            handled: last.into_iter().collect(),
            last_reading: now,
        };
        slots.next(now)?;
        Ok(slots)
    }

    /// The next slot.
    ///
    /// # Errors
    /// [`ScheduleError::Never`].
    pub(super) fn next(&self, now: Now) -> Result<Zoned, ScheduleError> {
        let mut next = self.schedule.next(&now.wall_at(self.handled_until).to_zoned(self.zone.clone()))?;
        while self.handled.contains(&next.timestamp()) {
            next = self.schedule.next(&next)?;
        }
        Ok(next)
    }

    /// Whether it is quiet hours: no motion begins that no person has asked for.
    pub(super) fn is_quiet(&self, now: Now) -> bool {
        self.config.is_quiet(&now.wall.to_zoned(self.zone.clone()))
    }

    /// By how much the wall clock was set since the last reading, if it was.
    pub(super) fn clock_was_set(&mut self, now: Now) -> Option<SignedDuration> {
        let went = now.boot.saturating_sub(self.last_reading.boot);
        let by = now.wall.duration_since(self.last_reading.wall).saturating_sub(went);
        self.last_reading = now;
        (by.abs() > SLOT_DELAY_TOLERANCE).then_some(by)
    }

    /// Decides on the slots that are due, on each once. Missed slots are never made up for one by one: a burst of late runs would be
    /// filmed in stirred water.
    pub(super) fn due(&mut self, now: Now, busy: Busy) -> Vec<Decision> {
        let clock = now.wall.to_zoned(self.zone.clone());
        let Ok(first) = self.next(now) else { return Vec::new() };
        let Some(newest) = self.schedule.last(&clock).filter(|newest| first <= *newest) else {
            return Vec::new();
        };
        let missed = self.missed(first, &newest);
        self.handled_until = now.boot;
        if self.handled.len() == REMEMBERED_SLOTS {
            self.handled.pop_front();
        }
        self.handled.push_back(newest.timestamp());
        let mut decisions = Vec::new();
        let mut skip = |slots, why| {
            if slots > 0 {
                decisions.push(Decision::Skip { slots, why });
            }
        };
        skip(missed, "the daemon was down");
        if clock.duration_since(&newest) > SLOT_DELAY_TOLERANCE.max(self.catch_up) {
            skip(1, "the daemon was down");
        } else if self.config.is_quiet(&newest) || self.config.is_quiet(&clock) {
            skip(1, "quiet hours");
        } else {
            match (busy, self.config.overlap) {
                (Busy::Held, _) => skip(1, "the rig is held"),
                (Busy::Waiting, _) => skip(1, "a run waits already"),
                (Busy::Moving, Overlap::Skip) => skip(1, "the rig was busy or the water not at rest"),
                (Busy::Moving, Overlap::Queue) | (Busy::Free, _) => decisions.push(Decision::Run(newest)),
            }
        }
        decisions
    }

    /// How many slots lie from `first` to before `newest`; a daemon down for a year need not count every second.
    fn missed(&self, first: Zoned, newest: &Zoned) -> usize {
        let mut slot = first;
        let mut missed = 0;
        while slot < *newest && missed < Schedule::MAX_COUNTED {
            missed += 1;
            match self.schedule.next(&slot) {
                Ok(next) => slot = next,
                Err(_) => break,
            }
        }
        missed
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

    /// The clock on the wall shows `text`, on a machine that was started in 2025 and whose clock was never set.
    fn now(text: &str) -> Now {
        Now { wall: at(text), boot: at(text).duration_since(at("2025-01-01T00:00:00Z")) }
    }

    fn word(decision: Decision) -> String {
        match decision {
            Decision::Run(slot) => format!("run {}", slot.timestamp()),
            Decision::Skip { slots, why } => format!("skip {slots}: {why}"),
        }
    }

    /// What is decided, in a word each, when `slots` is asked every `step` from `from` to `to`.
    fn asked(slots: &mut Slots, from: &str, to: &str, step_s: i64, busy: Busy) -> Vec<String> {
        set_by(slots, SignedDuration::ZERO, (from, to), step_s, busy)
    }

    /// The same, on a machine whose clock was set by so much; `from` and `to` are what it shows.
    fn set_by(
        slots: &mut Slots,
        by: SignedDuration,
        (from, to): (&str, &str),
        step_s: i64,
        busy: Busy,
    ) -> Vec<String> {
        let (mut wall, to) = (at(from), at(to));
        let mut said = Vec::new();
        while wall <= to {
            let boot = now(from).boot + wall.duration_since(at(from)) - by;
            said.extend(slots.due(Now { wall, boot }, busy).into_iter().map(word));
            wall += SignedDuration::from_secs(step_s);
        }
        said
    }

    #[test]
    fn a_year_of_three_o_clocks_has_one_run_a_night_through_both_changes_of_the_clocks() {
        let config = config("cron = \"0 3 * * *\"\ntime_zone = \"Europe/Zurich\"\n");
        let mut slots = Slots::new(&config, None, now("2026-01-01T00:00:00Z")).unwrap();
        let said = asked(&mut slots, "2026-01-01T00:00:00Z", "2026-12-31T23:59:00Z", 60, Busy::Free);
        assert_eq!(said.len(), 365);
        assert!(said.contains(&"run 2026-03-28T02:00:00Z".to_owned()), "winter time");
        assert!(said.contains(&"run 2026-03-29T01:00:00Z".to_owned()), "summer time");
        assert!(said.iter().all(|said| said.starts_with("run")));
    }

    #[test]
    fn a_slot_that_the_clock_jumps_over_in_spring_and_sees_twice_in_autumn_is_taken_once_a_day_at_most() {
        let config = config("cron = \"30 2 * * *\"\ntime_zone = \"Europe/Zurich\"\n");
        let mut slots = Slots::new(&config, None, now("2026-03-27T12:00:00Z")).unwrap();
        let spring = asked(&mut slots, "2026-03-27T12:00:00Z", "2026-03-30T12:00:00Z", 60, Busy::Free);
        assert!((2..=3).contains(&spring.len()), "{spring:?}");
        let mut slots = Slots::new(&config, None, now("2026-10-24T12:00:00Z")).unwrap();
        let autumn = asked(&mut slots, "2026-10-24T12:00:00Z", "2026-10-26T12:00:00Z", 60, Busy::Free);
        assert_eq!(autumn.len(), 2, "{autumn:?}");
    }

    #[test]
    fn missed_slots_are_skipped_or_the_newest_caught_up_with_never_a_burst() {
        let missed = "0 * * * *";
        let mut slots = Slots::new(
            &config(&format!("cron = \"{missed}\"")),
            Some(at("2026-11-20T00:00:00Z")),
            now("2026-11-20T05:20:00Z"),
        )
        .unwrap();
        assert_eq!(
            asked(&mut slots, "2026-11-20T05:20:00Z", "2026-11-20T05:21:00Z", 1, Busy::Free),
            ["skip 4: the daemon was down", "skip 1: the daemon was down"]
        );
        let mut slots = Slots::new(
            &config(&format!("cron = \"{missed}\"\ncatch_up_s = 1800.0")),
            Some(at("2026-11-20T00:00:00Z")),
            now("2026-11-20T05:20:00Z"),
        )
        .unwrap();
        assert_eq!(
            asked(&mut slots, "2026-11-20T05:20:00Z", "2026-11-20T05:21:00Z", 1, Busy::Free),
            ["skip 4: the daemon was down", "run 2026-11-20T05:00:00Z"]
        );
    }

    #[test]
    fn clock_that_jumps_back_gives_no_slot_twice() {
        let mut slots =
            Slots::new(&config("cron = \"0 * * * *\""), None, now("2026-11-20T00:30:00Z")).unwrap();
        let mut said = asked(&mut slots, "2026-11-20T00:30:00Z", "2026-11-20T02:10:00Z", 10, Busy::Free);
        said.extend(asked(&mut slots, "2026-11-20T01:10:00Z", "2026-11-20T03:10:00Z", 10, Busy::Free));
        assert_eq!(said, ["01", "02", "03"].map(|hour| format!("run 2026-11-20T{hour}:00:00Z")));
    }

    #[test]
    fn clock_a_year_ahead_for_three_seconds_neither_runs_nor_loses_a_slot() {
        let mut slots =
            Slots::new(&config("cron = \"0 3 * * *\""), None, now("2026-11-20T02:00:00Z")).unwrap();
        let year = SignedDuration::from_hours(365 * 24);
        assert_eq!(slots.clock_was_set(now("2026-11-20T02:10:00Z")), None);
        let ahead = Now { wall: at("2027-11-20T02:10:01Z"), ..now("2026-11-20T02:10:01Z") };
        assert_eq!(slots.clock_was_set(ahead), Some(year));
        let said = set_by(&mut slots, year, ("2027-11-20T02:10:01Z", "2027-11-20T02:10:04Z"), 1, Busy::Free);
        assert_eq!(said, [""; 0], "no slot is at that time");
        assert_eq!(slots.next(ahead).unwrap().timestamp(), at("2027-11-20T03:00:00Z"));
        let back = now("2026-11-20T02:10:05Z");
        assert_eq!(slots.clock_was_set(back), Some(-year));
        assert_eq!(slots.next(back).unwrap().timestamp(), at("2026-11-20T03:00:00Z"));
        let said = asked(&mut slots, "2026-11-20T02:10:05Z", "2026-11-20T04:00:00Z", 5, Busy::Free);
        assert_eq!(said, ["run 2026-11-20T03:00:00Z"]);
    }

    #[test]
    fn slot_is_caught_up_with_neither_in_quiet_hours_nor_for_a_slot_of_them() {
        let text =
            "cron = \"0 * * * *\"\ntime_zone = \"UTC\"\nquiet = [\"22:00-07:00\"]\ncatch_up_s = 7200.0\n";
        for (last, up, said) in [
            ("2026-11-20T20:30:00Z", "2026-11-20T22:10:00Z", "skip 1: quiet hours"),
            ("2026-11-21T05:30:00Z", "2026-11-21T07:00:30Z", "run 2026-11-21T07:00:00Z"),
            ("2026-11-21T05:30:00Z", "2026-11-21T06:59:30Z", "skip 1: quiet hours"),
            ("2026-11-20T20:30:00Z", "2026-11-20T21:50:00Z", "run 2026-11-20T21:00:00Z"),
        ] {
            let mut slots = Slots::new(&config(text), Some(at(last)), now(up)).unwrap();
            assert_eq!(
                slots.due(now(up), Busy::Free).into_iter().map(word).next_back().unwrap(),
                said,
                "{up}"
            );
        }
    }

    #[test]
    fn slots_that_come_while_the_rig_is_held_pass() {
        let mut slots =
            Slots::new(&config("cron = \"0 * * * *\""), None, now("2026-11-20T00:30:00Z")).unwrap();
        let said = asked(&mut slots, "2026-11-20T00:30:00Z", "2026-11-20T01:10:00Z", 10, Busy::Held);
        assert_eq!(said, ["skip 1: the rig is held"]);
    }

    #[test]
    fn quiet_hours_reach_over_midnight_and_overlaps_follow_their_policy() {
        let text = "cron = \"0 * * * *\"\ntime_zone = \"UTC\"\nquiet = [\"22:00-07:00\"]\n";
        let mut slots = Slots::new(&config(text), None, now("2026-11-20T20:30:00Z")).unwrap();
        let night = asked(&mut slots, "2026-11-20T20:30:00Z", "2026-11-21T07:30:00Z", 10, Busy::Free);
        let runs: Vec<_> = night.iter().filter(|said| said.starts_with("run")).collect();
        assert_eq!(runs, ["run 2026-11-20T21:00:00Z", "run 2026-11-21T07:00:00Z"]);

        let busy = |overlap: &str, busy| {
            let text = format!("cron = \"0 * * * *\"\noverlap = \"{overlap}\"");
            let mut slots = Slots::new(&config(&text), None, now("2026-11-20T20:30:00Z")).unwrap();
            asked(&mut slots, "2026-11-20T21:00:00Z", "2026-11-20T21:00:05Z", 1, busy).remove(0)
        };
        assert!(busy("skip", Busy::Moving).starts_with("skip"));
        assert!(busy("queue", Busy::Moving).starts_with("run"));
        assert!(busy("queue", Busy::Waiting).starts_with("skip"));
    }

    #[test]
    fn unknown_time_zone_is_named() {
        let config = config("cron = \"0 3 * * *\"\ntime_zone = \"Europe/Atlantis\"");
        let error = Slots::new(&config, None, now("2026-01-01T00:00:00Z")).unwrap_err().to_string();
        assert!(error.contains("Europe/Atlantis"), "{error}");
    }
}
