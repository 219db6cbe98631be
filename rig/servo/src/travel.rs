//! The setpoint of a channel for an angle, and its limits and greatest rate: in microseconds of pulse where a board makes pulses, in
//! counts of the encoder for a servo on a bus.

use std::ops::RangeInclusive;

use ground::strict::Positive;

/// Encoder counts per turn of the servos on a bus: 12 bits, Dynamixel's X series and Feetech's STS alike.
pub(super) const COUNTS_PER_TURN: u16 = 4096;
/// Encoder counts per radian \[1/rad\].
pub const COUNTS_PER_RAD: f64 = COUNTS_PER_TURN as f64 / std::f64::consts::TAU;

/// A channel's limits and its calibration.
#[derive(Debug, Clone, PartialEq)]
pub enum Travel {
    /// A channel of a board that makes pulses.
    Pulses(PulseTravel),
    /// A servo on a bus.
    Counts(CountTravel),
}

/// Limits and scale of a channel that gets pulses.
#[derive(Debug, Clone, PartialEq)]
pub struct PulseTravel {
    /// Shortest pulse \[µs\].
    pub min_pulse_us: u16,
    /// Longest pulse \[µs\].
    pub max_pulse_us: u16,
    /// Pulse at angle zero \[µs\].
    pub zero_pulse_us: Positive,
    /// Change of the pulse per angle \[µs/rad\].
    pub us_per_rad: Positive,
    /// Fastest change of the pulse \[µs/s\]; 0 for no limit.
    pub max_rate_us_per_s: u32,
    /// Pulse of the park position \[µs\]; none: the zero pulse.
    pub park_pulse_us: Option<u16>,
}

/// Limits and scale of a servo on a bus, which gets positions and reports its own.
#[derive(Debug, Clone, PartialEq)]
pub struct CountTravel {
    /// Least position \[counts\].
    pub min_count: u16,
    /// Greatest position \[counts\].
    pub max_count: u16,
    /// Position at angle zero \[counts\].
    pub zero_count: u16,
    /// Fastest turn \[rad/s\].
    pub max_rate_rad_per_s: Positive,
    /// Park position \[counts\]; none: the zero.
    pub park_count: Option<u16>,
    /// How far it may be from its commanded position \[rad\]; further for a tenth of a second is a fault.
    pub max_error_rad: Positive,
}

/// The unit of a channel's setpoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Microseconds of pulse.
    PulseUs,
    /// Counts of an encoder.
    Counts,
}

impl Unit {
    /// The unit's symbol, to be written behind a number.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::PulseUs => "µs",
            Self::Counts => "counts",
        }
    }

    /// What a number in this unit is called.
    pub fn noun(self) -> &'static str {
        match self {
            Self::PulseUs => "pulse",
            Self::Counts => "position",
        }
    }

    /// The config's key of the limit to the rate, with the limit.
    pub fn rate_limit(self, limit_per_s: u32) -> String {
        match self {
            Self::PulseUs => format!("max_rate_us_per_s = {limit_per_s}"),
            Self::Counts => format!("max_rate_rad_per_s of {limit_per_s} counts/s"),
        }
    }
}

impl Travel {
    /// The unit of its setpoints.
    pub fn unit(&self) -> Unit {
        match self {
            Self::Pulses(_) => Unit::PulseUs,
            Self::Counts(_) => Unit::Counts,
        }
    }

    /// Least and greatest setpoint, in its unit.
    pub fn range(&self) -> RangeInclusive<u16> {
        match self {
            Self::Pulses(pulses) => pulses.min_pulse_us..=pulses.max_pulse_us,
            Self::Counts(counts) => counts.min_count..=counts.max_count,
        }
    }

    /// Fastest change of the setpoint, in its unit per second; 0 for no limit.
    pub fn max_rate_per_s(&self) -> u32 {
        match self {
            Self::Pulses(pulses) => pulses.max_rate_us_per_s,
            Self::Counts(counts) => (counts.max_rate_rad_per_s.get() * COUNTS_PER_RAD) as u32,
        }
    }

    /// The setpoint at which it parks, in its unit.
    pub fn park(&self) -> u16 {
        match self {
            Self::Pulses(pulses) => pulses.park_pulse_us.unwrap_or(pulses.zero_pulse_us.get().round() as u16),
            Self::Counts(counts) => counts.park_count.unwrap_or(counts.zero_count),
        }
    }

    /// The setpoint at angle zero, and its change per angle \[1/rad\].
    pub(super) fn scale(&self) -> (f64, f64) {
        match self {
            Self::Pulses(pulses) => (pulses.zero_pulse_us.get(), pulses.us_per_rad.get()),
            Self::Counts(counts) => (f64::from(counts.zero_count), COUNTS_PER_RAD),
        }
    }

    pub(super) fn check(&self, name: &str, needs_rate: bool) -> Result<(), String> {
        match self {
            Self::Pulses(pulses) => pulses.check(name, needs_rate),
            Self::Counts(counts) => counts.check(name),
        }
    }
}

impl PulseTravel {
    fn check(&self, name: &str, needs_rate: bool) -> Result<(), String> {
        let (min, max) = (self.min_pulse_us, self.max_pulse_us);
        if min == 0 || min >= max {
            return Err(format!(
                "channel `{name}`: min_pulse_us = {min} must be above 0 and below max_pulse_us = {max}"
            ));
        }
        let park = Travel::Pulses(self.clone()).park();
        if !(min..=max).contains(&park) {
            return Err(format!(
                "channel `{name}`: it parks at {park} µs, outside its limits {min} to {max} µs; set park_pulse_us"
            ));
        }
        if needs_rate && self.max_rate_us_per_s == 0 {
            return Err(format!("channel `{name}`: a servo needs max_rate_us_per_s above 0"));
        }
        Ok(())
    }
}

impl CountTravel {
    fn check(&self, name: &str) -> Result<(), String> {
        let (min, max) = (self.min_count, self.max_count);
        if min >= max || max >= COUNTS_PER_TURN {
            return Err(format!(
                "channel `{name}`: min_count = {min} must be below max_count = {max}, and that below {COUNTS_PER_TURN}"
            ));
        }
        let park = self.park_count.unwrap_or(self.zero_count);
        if !(min..=max).contains(&park) {
            return Err(format!(
                "channel `{name}`: it parks at {park} counts, outside its limits {min} to {max}; set park_count"
            ));
        }
        Ok(())
    }
}
