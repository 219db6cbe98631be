//! The sync LED's pattern, from which the board's clock can be read in pictures.
//!
//! A slot is [`SLOT`] long and begins where the tick is a multiple of it. The LED is lit in slot *n* when bit *n* of a
//! maximal-length sequence is 1:
//!
//! ```text
//! b[0] = 1,  b[1..16] = 0,  b[n + 16] = b[n] ^ b[n + 2] ^ b[n + 3] ^ b[n + 5]
//! ```
//!
//! Any 16 bits in a row come once in its 65535 slots, so that 1.05 s of pictures determine the tick. The
//! tick wraps after 65536 slots: the last one shows `b[0]` again, and the sequence begins again.

use crate::units::{DurationUs, Ticks};

/// Length of a slot: the LED stays lit or dark at least this long.
pub const SLOT: DurationUs = DurationUs(1 << 16);
/// Number of slots in a row that determine the tick.
pub const WINDOW: u32 = 16;

/// The first window of the sequence, with `b[0]` in bit 0.
const FIRST_WINDOW: u16 = 1;
/// Slots after which the sequence repeats.
const SEQUENCE_SLOTS: u16 = u16::MAX;

const fn next(window: u16) -> u16 {
    let bit = (window ^ window >> 2 ^ window >> 3 ^ window >> 5) & 1;
    window >> 1 | bit << 15
}

/// Whether the LED is lit at `at`.
pub fn lit(at: Ticks) -> bool {
    slots(at).next() == Some(true)
}

/// Whether the LED is lit in the slot that holds `at`, and in each after it.
pub fn slots(at: Ticks) -> impl Iterator<Item = bool> {
    let slot = (at.0 / SLOT.0) as u16;
    let window = (0..slot % SEQUENCE_SLOTS).fold(FIRST_WINDOW, |window, _| next(window));
    core::iter::successors(Some((slot, window)), |&(slot, window)| {
        let slot = slot.wrapping_add(1);
        Some((slot, if slot == 0 { FIRST_WINDOW } else { next(window) }))
    })
    .map(|(_, window)| window & 1 == 1)
}

/// When the first of [`WINDOW`] slots began: bit *i* of `observed` is 1 when the LED was lit in the *i*-th of them. None where all
/// are dark, which the pattern does not contain.
pub fn began(observed: u16) -> Option<Ticks> {
    let mut window = FIRST_WINDOW;
    for slot in 0..SEQUENCE_SLOTS {
        if window == observed {
            return Some(Ticks(u32::from(slot) * SLOT.0));
        }
        window = next(window);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_window_names_its_slot() {
        let mut window = FIRST_WINDOW;
        let mut found = [false; 1 << 16];
        for _ in 0..SEQUENCE_SLOTS {
            assert!(!found[usize::from(window)]);
            found[usize::from(window)] = true;
            window = next(window);
        }
        assert_eq!((window, found[0]), (FIRST_WINDOW, false));
        for slot in [0, 1, 77, 4_321, 65_000] {
            let slots = (0..WINDOW).map(|i| u16::from(lit(Ticks((slot + i) * SLOT.0 + 5))) << i);
            assert_eq!(began(slots.sum()), Some(Ticks(slot * SLOT.0)));
        }
        assert_eq!(began(0), None);
    }

    #[test]
    fn slots_go_on_over_the_wrap_of_the_tick() {
        let from = Ticks(0_u32.wrapping_sub(3 * SLOT.0));
        for (i, shines) in (0..9).zip(slots(from)) {
            assert_eq!(shines, lit(Ticks(from.0.wrapping_add(i * SLOT.0 + 7))), "slot {i}");
        }
    }
}
