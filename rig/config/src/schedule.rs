//! When a daemon runs an experiment: cron slots.

use std::str::FromStr;

use croner::Cron;
use jiff::Zoned;

/// A cron expression: five fields, or six with seconds in front.
#[derive(Debug, Clone)]
pub struct Schedule {
    cron: Cron,
}

/// Why a schedule cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ScheduleError {
    /// The expression cannot be read.
    #[error(
        "schedule `{expression}`: {why}; five fields are wanted: minute hour day month weekday, or six with seconds in front"
    )]
    Expression {
        /// As written.
        expression: String,
        /// What the parser said.
        why: String,
    },
    /// There is no such time zone.
    #[error(
        "schedule in time zone `{name}`: {why}; a name such as Europe/Zurich is wanted, or none for the machine's own"
    )]
    Zone {
        /// As written.
        name: String,
        /// What is wrong with it.
        why: String,
    },
    /// No slot ever comes.
    #[error("schedule `{expression}` has no slot after {after}")]
    Never {
        /// As written.
        expression: String,
        /// Searched from here.
        after: String,
    },
}

impl Schedule {
    /// Missed slots that are counted one by one at most: a daemon that was down for a year need not list all.
    pub const MAX_COUNTED: usize = 10_000;

    /// Reads a cron expression.
    ///
    /// # Errors
    /// [`ScheduleError::Expression`].
    pub fn parse(expression: &str) -> Result<Self, ScheduleError> {
        let cron = Cron::from_str(expression).map_err(|error| ScheduleError::Expression {
            expression: expression.into(),
            why: error.to_string(),
        })?;
        Ok(Self { cron })
    }

    /// The last slot that is not after `until`, if there ever was one.
    pub fn last(&self, until: &Zoned) -> Option<Zoned> {
        self.cron.find_previous_occurrence(until, true).ok()
    }

    /// The first slot strictly after `after`.
    ///
    /// # Errors
    /// [`ScheduleError::Never`] when there is none.
    pub fn next(&self, after: &Zoned) -> Result<Zoned, ScheduleError> {
        self.cron.find_next_occurrence(after, false).map_err(|_| ScheduleError::Never {
            expression: self.cron.as_str().into(),
            after: after.to_string(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn zoned(text: &str) -> Zoned {
        text.parse().expect("a zoned time")
    }

    #[test]
    fn slots_follow_the_expression_through_a_year() {
        let schedule = Schedule::parse("0 */6 * * *").expect("valid");
        let mut slot = zoned("2026-01-01T00:30:00+00:00[+00:00]");
        for _ in 0..365 * 4 {
            let next = schedule.next(&slot).expect("a slot");
            assert!(next.hour() % 6 == 0 && next.minute() == 0 && next > slot);
            slot = next;
        }
        assert_eq!(slot.date(), zoned("2027-01-01T00:00:00+00:00[+00:00]").date());
    }

    #[test]
    fn seconds_may_stand_in_front() {
        let schedule = Schedule::parse("*/20 * * * * *").expect("valid");
        let next = schedule.next(&zoned("2026-11-20T10:00:05+00:00[+00:00]")).expect("a slot");
        assert_eq!(next.second(), 20);
    }

    #[test]
    fn unreadable_expression_says_what_is_wanted() {
        let error = Schedule::parse("every day").unwrap_err().to_string();
        assert!(error.contains("`every day`") && error.contains("minute hour day"), "{error}");
    }
}
