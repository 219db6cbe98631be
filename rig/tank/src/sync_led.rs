//! The light of the board's sync LED over time.

use std::collections::VecDeque;

use ground::clock::MonotonicNs;

/// Most switchings of the LED that are stored, chosen: those of a minute at least, far more than any picture is behind.
const MAX_STORED_TURNS: usize = 1024;

/// When the LED turned on and off.
#[derive(Debug, Default)]
pub(super) struct SyncLed {
    /// In order of time.
    turns: VecDeque<(MonotonicNs, bool)>,
}

impl SyncLed {
    /// The LED was switched on or off. Switchings come in order, from the one board.
    pub(super) fn turn(&mut self, lit: bool, at: MonotonicNs) {
        self.turns.push_back((at, lit));
        if self.turns.len() > MAX_STORED_TURNS {
            self.turns.pop_front();
        }
    }

    /// For what share of the time from `from` to `until` it was lit; at the instant, where they are the same.
    pub(super) fn lit_share(&self, from: MonotonicNs, until: MonotonicNs) -> f64 {
        let first = self.turns.partition_point(|&(at, _)| at <= from);
        let mut lit = first.checked_sub(1).is_some_and(|before| self.turns[before].1);
        if until <= from {
            return f64::from(u8::from(lit));
        }
        let (mut since, mut lit_s) = (from, 0.0);
        for &(at, next) in self.turns.range(first..).take_while(|&&(at, _)| at < until) {
            lit_s += if lit { at.seconds_since(since) } else { 0.0 };
            (since, lit) = (at, next);
        }
        lit_s += if lit { until.seconds_since(since) } else { 0.0 };
        lit_s / until.seconds_since(from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn share_is_what_was_lit_of_the_time() {
        let at = |ms: u64| MonotonicNs(ms * 1_000_000);
        let mut led = SyncLed::default();
        assert_eq!(led.lit_share(at(0), at(10)), 0.0);
        for (ms, lit) in [(10, true), (20, false), (30, true)] {
            led.turn(lit, at(ms));
        }
        for (from, until, share) in [
            (0, 10, 0.0),
            (0, 20, 0.5),
            (12, 18, 1.0),
            (15, 25, 0.5),
            (5, 35, 0.5),
            (40, 50, 1.0),
            (12, 12, 1.0),
        ] {
            assert!((led.lit_share(at(from), at(until)) - share).abs() < 1e-12, "{from} to {until}");
        }
    }
}
