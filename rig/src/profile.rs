//! The timed stroke: angle over time, and the pulses a board plays for it.

/// What a board plays: for each channel, straight lines from pulse to pulse.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct PulseProfile {
    /// One track per driven channel.
    pub tracks: Vec<PulseTrack>,
}

/// One channel's part of a profile.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PulseTrack {
    /// Channel number.
    pub channel: u8,
    /// Pulse at the start \[µs\]; the channel must be there already.
    pub start_pulse_us: u16,
    /// Duration \[µs\] and pulse at the end \[µs\] of each segment, in order.
    pub segments: Vec<(u32, u16)>,
}
