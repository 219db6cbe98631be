//! When the sync LED is lit, by the board's clock.

use firmware_protocol::sync_led::{self, SLOT};
use firmware_protocol::units::Ticks;

use ground::clock::{ClockFit, MonotonicNs};

/// Whether the LED is lit, over a stretch of time.
#[derive(Debug, Clone)]
pub(super) struct Light {
    /// When its first slot begins \[s\], after the origin.
    begin_s: f64,
    slot_s: f64,
    lit: Vec<bool>,
    /// How many slots before this one were lit, shape (slots).
    lit_before: Vec<f64>,
}

impl Light {
    /// From `from` to `until`, by `clock`; times count from `origin`.
    pub(super) fn new(clock: &ClockFit, origin: MonotonicNs, from: MonotonicNs, until: MonotonicNs) -> Self {
        let slot = u64::from(SLOT.0);
        // The tick wraps at a whole number of slots, so this holds for its upper half too.
        let first = clock.board_tick_us(from) / slot * slot;
        let count = (clock.board_tick_us(until).saturating_sub(first) / slot + 2) as usize;
        let at_s = |slots: u64| clock.host(first + slots * slot).seconds_since(origin);
        let begin_s = at_s(0);
        let slot_s = (at_s(count as u64) - begin_s) / count as f64;
        let lit: Vec<bool> = sync_led::slots(Ticks(first as u32)).take(count).collect();
        let count_lit = |count: &mut f64, &lit: &bool| {
            let before = *count;
            *count += f64::from(u8::from(lit));
            Some(before)
        };
        let lit_before = lit.iter().scan(0.0, count_lit).collect();
        Self { begin_s, slot_s, lit, lit_before }
    }

    /// Share of an exposure of `exposure_s` about `middle_s` in which it is lit. What lies outside counts as the nearest slot.
    pub(super) fn share(&self, middle_s: f64, exposure_s: f64) -> f64 {
        let [opens, closes] = [-0.5, 0.5].map(|half| self.lit_slots(middle_s + half * exposure_s));
        (closes - opens) * self.slot_s / exposure_s
    }

    /// Slots in which it was lit, from the beginning to `time_s`.
    fn lit_slots(&self, time_s: f64) -> f64 {
        let at = ((time_s - self.begin_s) / self.slot_s).clamp(0.0, self.lit.len() as f64);
        let slot = (at as usize).min(self.lit.len() - 1);
        self.lit_before[slot] + if self.lit[slot] { at - slot as f64 } else { 0.0 }
    }

    /// When it turns on or off, between two times \[s\].
    pub(super) fn turns_s(&self, from_s: f64, until_s: f64) -> impl Iterator<Item = f64> {
        let slot =
            |time_s: f64| (((time_s - self.begin_s) / self.slot_s).max(0.0) as usize).min(self.lit.len() - 1);
        let first = slot(from_s);
        let pairs = self.lit[first..=slot(until_s)].windows(2).enumerate();
        let turns = pairs.filter(|(_, pair)| pair[0] != pair[1]);
        turns.map(move |(k, _)| self.begin_s + (first + k + 1) as f64 * self.slot_s)
    }
}
