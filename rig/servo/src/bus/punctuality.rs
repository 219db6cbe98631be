//! How punctually positions are streamed to servos on a bus. A board times its profile by itself and needs no such measure.

use ground::clock::MonotonicNs;

/// The punctuality of one stream, from its beginning on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Punctuality {
    period_s: f64,
    rounds: u64,
    missed: u64,
    worst_late_s: f64,
    least_slack_s: f64,
    unanswered: u64,
}

impl Punctuality {
    pub(super) fn new(period_s: f64) -> Self {
        Self { period_s, rounds: 0, missed: 0, worst_late_s: 0.0, least_slack_s: period_s, unanswered: 0 }
    }

    /// A round that was due at `due` began at `now`: how late it is \[s\], and when the next one is due. Rounds that have
    /// passed meanwhile are left out and counted: two positions at once would help nobody.
    pub(super) fn round(&mut self, due: MonotonicNs, now: MonotonicNs) -> (f64, MonotonicNs) {
        let late_s = now.seconds_since(due).max(0.0);
        let missed = (late_s / self.period_s).floor();
        self.rounds += 1;
        self.missed += missed as u64;
        self.worst_late_s = self.worst_late_s.max(late_s);
        (late_s, due.plus_seconds((missed + 1.0) * self.period_s))
    }

    /// The round ended at `now`, with the next one due at `next`, and so many servos did not answer in it.
    pub(super) fn done(&mut self, now: MonotonicNs, next: MonotonicNs, unanswered: usize) {
        self.least_slack_s = self.least_slack_s.min(next.seconds_since(now));
        self.unanswered += unanswered as u64;
    }
}

impl std::fmt::Display for Punctuality {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "stream of {} positions at {:.0} Hz: latest {:.2} ms late, {} left out, least slack {:.2} ms, {} answers missing",
            self.rounds,
            1.0 / self.period_s,
            self.worst_late_s * 1e3,
            self.missed,
            self.least_slack_s * 1e3,
            self.unanswered
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_that_passed_are_left_out_and_counted_and_the_grid_stays() {
        let at = |ms: f64| MonotonicNs(5_000_000_000).plus_seconds(ms * 1e-3);
        let mut stream = Punctuality::new(0.01);
        assert_eq!(stream.round(at(0.0), at(0.5)).1, at(10.0));
        stream.done(at(3.0), at(10.0), 0);
        let (late_s, next) = stream.round(at(10.0), at(45.0));
        assert!((late_s - 0.035).abs() < 1e-9);
        assert_eq!(next, at(50.0));
        stream.done(at(52.0), at(50.0), 1);
        assert_eq!(
            stream.to_string(),
            "stream of 2 positions at 100 Hz: latest 35.00 ms late, 3 left out, least slack -2.00 ms, 1 answers missing"
        );
    }
}
