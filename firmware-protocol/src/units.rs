//! Wire integers as types: each carries its unit.

use core::fmt;

macro_rules! integer {
    ($(#[$doc:meta])* $name:ident($inner:ty), $unit:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
        pub struct $name(pub $inner);

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                fmt::Display::fmt(self, f)
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!("{}", $unit), self.0)
            }
        }
    };
}

integer!(
    /// Length of a servo pulse \[µs\]. 0 never occurs as a pulse: on the wire it stands for a detached channel.
    PulseWidthUs(u16), " µs"
);
integer!(
    /// A span of time \[µs\].
    DurationUs(u32), " µs"
);
integer!(
    /// A span of time \[ms\].
    DurationMs(u16), " ms"
);
integer!(
    /// How fast a pulse may change \[µs of pulse per second\]; 0: at once, without a limit.
    RateUsPerS(u32), " µs/s"
);
integer!(
    /// Number of a channel, from 0.
    Channel(u8), ""
);
integer!(
    /// Number of a packet; an answer carries its question's.
    Sequence(u16), ""
);

impl RateUsPerS {
    /// Whether going from pulse `from` to `to` in `duration` keeps to this rate.
    pub fn allows(self, from: PulseWidthUs, to: PulseWidthUs, duration: DurationUs) -> bool {
        let change = u64::from(from.0.abs_diff(to.0)) * 1_000_000;
        self.0 == 0 || change <= u64::from(self.0) * u64::from(duration.0)
    }

    /// The shortest whole duration in which the pulse may go from `from` to `to`.
    pub fn shortest(self, from: PulseWidthUs, to: PulseWidthUs) -> DurationUs {
        match self.0 {
            0 => DurationUs(0),
            rate => {
                let change = u64::from(from.0.abs_diff(to.0)) * 1_000_000;
                DurationUs(u32::try_from(change.div_ceil(u64::from(rate))).unwrap_or(u32::MAX))
            }
        }
    }

    /// The rate of going from pulse `from` to `to` in `duration`, rounded up.
    pub fn needed(from: PulseWidthUs, to: PulseWidthUs, duration: DurationUs) -> Self {
        let change = u64::from(from.0.abs_diff(to.0)) * 1_000_000;
        Self(u32::try_from(change.div_ceil(u64::from(duration.0.max(1)))).unwrap_or(u32::MAX))
    }
}

impl From<DurationMs> for DurationUs {
    fn from(ms: DurationMs) -> Self {
        Self(u32::from(ms.0) * 1000)
    }
}

/// An instant on the board's clock: 1 µs ticks that wrap after 71.6 minutes. Instants are compared over at most half
/// of that, so there is no `Ord`.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Ticks(pub u32);

impl fmt::Debug for Ticks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl Ticks {
    /// The longest span over which two instants can be told apart \[µs\].
    pub const HORIZON: DurationUs = DurationUs(i32::MAX as u32);

    /// Microseconds from `earlier` to this instant; negative when this one is the earlier.
    pub fn since(self, earlier: Self) -> i32 {
        self.0.wrapping_sub(earlier.0).cast_signed()
    }

    /// Whether `now` is this instant or later.
    pub fn reached(self, now: Self) -> bool {
        now.since(self) >= 0
    }

    /// The instant `duration` later.
    pub fn plus(self, duration: DurationUs) -> Self {
        Self(self.0.wrapping_add(duration.0))
    }
}

impl fmt::Display for Ticks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "tick {}", self.0)
    }
}

/// Text of at most `N` bytes, padded with zeros on the wire.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Name<const N: usize>([u8; N]);

impl<const N: usize> Name<N> {
    /// The name, when it is printable ASCII, not empty and at most `N` bytes long.
    pub fn new(text: &str) -> Option<Self> {
        let mut bytes = [0; N];
        bytes.get_mut(..text.len())?.copy_from_slice(text.as_bytes());
        Self::from_bytes(bytes)
    }

    /// The name in `bytes`, when it is printable ASCII, followed by nothing but zeros.
    pub fn from_bytes(bytes: [u8; N]) -> Option<Self> {
        let length = bytes.iter().position(|&b| b == 0).unwrap_or(N);
        let printable = bytes[..length].iter().all(|b| (0x20..0x7f).contains(b));
        (length > 0 && printable && bytes[length..].iter().all(|&b| b == 0)).then_some(Self(bytes))
    }

    /// The bytes as on the wire.
    pub fn bytes(&self) -> &[u8; N] {
        &self.0
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        let length = self.0.iter().position(|&b| b == 0).unwrap_or(N);
        core::str::from_utf8(&self.0[..length]).unwrap_or_default()
    }
}

impl<const N: usize> fmt::Debug for Name<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}

impl<const N: usize> fmt::Display for Name<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_compare_across_the_wrap() {
        let before = Ticks(u32::MAX - 9);
        let after = before.plus(DurationUs(20));
        assert_eq!(after, Ticks(10));
        assert_eq!((after.since(before), before.since(after)), (20, -20));
        assert!(before.reached(after) && !after.reached(before) && after.reached(after));
    }

    #[test]
    fn rate_limit_is_exact_at_its_edge() {
        let rate = RateUsPerS(333);
        let (from, to) = (PulseWidthUs(1000), PulseWidthUs(2000));
        let shortest = rate.shortest(from, to);
        assert!(rate.allows(from, to, shortest) && rate.allows(to, from, shortest));
        assert!(!rate.allows(from, to, DurationUs(shortest.0 - 1)));
        assert!(RateUsPerS(0).allows(from, to, DurationUs(0)));
    }

    #[test]
    fn names_are_printable_and_zero_padded() {
        assert_eq!(Name::<4>::new("base").unwrap().as_str(), "base");
        for bad in ["", "bases", "b\n", "é"] {
            assert_eq!(Name::<4>::new(bad), None, "{bad:?}");
        }
        assert_eq!(Name::from_bytes(*b"a\0b\0"), None);
    }
}
