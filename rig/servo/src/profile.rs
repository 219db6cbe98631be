//! The timed stroke: angle over time, and the pulses that a board plays for it, or the counts that are streamed to servos on a bus.
//!
//! A stroke is one sweep between two reversals: counter-clockwise (as the camera sees it, and positive) in `ccw_s`,
//! clockwise in `cw_s`. A profile begins and ends at the centre angle:
//!
//! ```text
//!  +A        /\            /\
//!          /   \         /   \
//!   0 ── /      \      /      \      / ──
//!                \   /         \   /
//!  -A             \/            \/
//!      ccw/2  cw    ccw     cw    ccw/2
//! ```
//!
//! Times are whole microseconds from here on: what is asked for is rounded once, strokes are added up as integers, and
//! the board's ticks are the same integers. So the ratio of the strokes is exact and nothing drifts over the cycles.

use firmware_protocol::board::MAX_DURATION;
use firmware_protocol::units::{DurationUs, PulseWidthUs, RateUsPerS};
use ground::strict::{Finite, Positive};
use serde::{Deserialize, Serialize};

use crate::{PulseProfile, PulseTrack, ServoChannel, ServoConfig, Unit};

/// The `[profile]` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProfileConfig {
    /// Half the sweep \[rad\]: strokes go from centre − amplitude to centre + amplitude.
    pub amplitude_rad: Positive,
    /// Duration of a counter-clockwise stroke \[s\]. The paper's timing is twice `cw_s`.
    pub ccw_s: Positive,
    /// Duration of a clockwise stroke \[s\].
    pub cw_s: Positive,
    /// How many pairs of strokes at full amplitude.
    pub cycles: u32,
    /// Pairs of strokes before them, with an amplitude that grows evenly. Default 0.
    #[serde(default)]
    pub soft_start_cycles: u32,
    /// The angle around which it swings \[rad\]. Default 0.
    #[serde(default = "zero")]
    pub centre_rad: Finite,
    /// A longer pulse, or a greater count, turns the servo clockwise as the camera sees it (it is mounted the other way round).
    /// Default false; where a channel has a calibration, that says it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mirrored: Option<bool>,
    /// The actuators that play it; left out, all that the channels name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub actuators: Option<Vec<String>>,
}

fn zero() -> Finite {
    Finite::new(0.0).expect("0 is finite")
}

/// Amplitude and speed of the cautious motion, as a share of those of the profile; chosen.
const CAUTIOUS_SHARE: f64 = 0.1;

impl ProfileConfig {
    /// Whether a longer pulse turns the servo clockwise as the camera sees it, where no calibration says it.
    pub fn is_mirrored(&self) -> bool {
        self.mirrored.unwrap_or(false)
    }

    /// The small, slow motion that comes first where a servo is not calibrated: one cycle of a tenth of the amplitude
    /// at a tenth of the speed.
    pub fn cautious(&self) -> Self {
        let share = |x: Positive| Positive::new(x.get() * CAUTIOUS_SHARE).unwrap_or(x);
        Self { amplitude_rad: share(self.amplitude_rad), cycles: 1, soft_start_cycles: 0, ..self.clone() }
    }
}

impl PulseProfile {
    /// The angles it commands, as the simulation and servo.csv want them, started at `start_s` of the run. Computed
    /// from the pulses as rounded, so it is what the board does and not what was asked for.
    ///
    /// # Errors
    /// [`ProfileError::NoChannel`] when a track's channel is not in `servo` or names no actuator.
    pub fn command(
        &self,
        servo: &ServoConfig,
        mirrored: bool,
        start_s: f64,
    ) -> Result<sim::Command, ProfileError> {
        let mut columns = Vec::new();
        for track in &self.tracks {
            let channel = servo.channel(track.channel);
            let (channel, actuator) = channel
                .and_then(|c| Some((c, c.actuator.clone()?)))
                .ok_or_else(|| ProfileError::NoChannel { actuator: format!("channel {}", track.channel) })?;
            let breakpoints: Vec<f64> = channel.breakpoints().collect();
            let (time_s, angle_rad) = track
                .corners_and(&breakpoints)
                .into_iter()
                .map(|(us, pulse)| (start_s + us * 1e-6, channel.angle_rad(pulse, mirrored)))
                .unzip();
            columns.push(sim::Command { actuators: vec![actuator], time_s, angle_rad });
        }
        let mut time_s: Vec<f64> = columns.iter().flat_map(|column| &column.time_s).copied().collect();
        time_s.sort_by(f64::total_cmp);
        time_s.dedup();
        let angle_rad =
            time_s.iter().flat_map(|&t| columns.iter().map(move |column| column.at(0, t))).collect();
        let actuators = columns.iter().flat_map(|column| column.actuators.clone()).collect();
        Ok(sim::Command { actuators, time_s, angle_rad })
    }
}

/// Why a profile cannot be played.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ProfileError {
    /// Nothing to play.
    #[error("profile has no cycles; set cycles to 1 or more")]
    Empty,
    /// Shorter than a board's ticks can resolve.
    #[error("a stroke of under 2 µs; lengthen ccw_s and cw_s")]
    TooShort,
    /// Longer than a board can time.
    #[error("profile lasts {duration_s} s, longer than {limit_s} s; reduce cycles or the stroke times")]
    TooLong {
        /// Its duration \[s\].
        duration_s: f64,
        /// The limit \[s\].
        limit_s: f64,
    },
    /// No channel drives this actuator.
    #[error("no [[servo.channel]] has actuator = \"{actuator}\"")]
    NoChannel {
        /// The actuator, or the channel.
        actuator: String,
    },
    /// An angle is beyond the channel's limits.
    #[error(
        "profile on channel `{channel}` wants {angle_rad:.4} rad, a {} of {pulse:.0} {}, outside its limits {min} to {max} {}; \
         reduce amplitude_rad or centre_rad, or widen the channel's limits if the mechanism allows",
        unit.noun(), unit.symbol(), unit.symbol()
    )]
    Pulse {
        /// Channel's name.
        channel: String,
        /// Angle wanted \[rad\].
        angle_rad: f64,
        /// The setpoint for it, in the channel's unit.
        pulse: f64,
        /// The channel's lower limit, in its unit.
        min: u16,
        /// The channel's upper limit, in its unit.
        max: u16,
        /// The channel's unit.
        unit: Unit,
    },
    /// A stroke is faster than the channel's rate limit.
    #[error(
        "profile on channel `{channel}` wants {rate_per_s} {}/s, above its limit {}; reduce amplitude_rad or lengthen {stroke}",
        unit.symbol(), unit.rate_limit(*limit_per_s)
    )]
    Rate {
        /// Channel's name.
        channel: String,
        /// Rate wanted, in the channel's unit per second.
        rate_per_s: u32,
        /// The channel's limit, in its unit per second.
        limit_per_s: u32,
        /// The channel's unit.
        unit: Unit,
        /// The config's key of the stroke that is too fast.
        stroke: &'static str,
    },
}

/// An angle over time, in straight lines between corners.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Time \[µs\] and angle \[rad\] of each corner, the first at 0.
    corners: Vec<(u64, f64)>,
    mirrored: bool,
    actuators: Option<Vec<String>>,
}

impl Profile {
    /// The profile of a `[profile]` table.
    ///
    /// # Errors
    /// [`ProfileError::Empty`], [`ProfileError::TooShort`], [`ProfileError::TooLong`].
    pub fn new(config: &ProfileConfig) -> Result<Self, ProfileError> {
        if config.cycles == 0 {
            return Err(ProfileError::Empty);
        }
        let (ccw_us, cw_us) = stroke_times_us(config.ccw_s.get(), config.cw_s.get());
        let cycles = u64::from(config.cycles) + u64::from(config.soft_start_cycles);
        let duration_us = cycles.saturating_mul(ccw_us.saturating_add(cw_us));
        if ccw_us.min(cw_us) < 2 {
            return Err(ProfileError::TooShort);
        }
        if duration_us > u64::from(MAX_DURATION.0) {
            let limit_s = f64::from(MAX_DURATION.0) * 1e-6;
            return Err(ProfileError::TooLong { duration_s: duration_us as f64 * 1e-6, limit_s });
        }

        let centre = config.centre_rad.get();
        let amplitude = |cycle: u64| {
            let share = (cycle + 1) as f64 / (f64::from(config.soft_start_cycles) + 1.0);
            config.amplitude_rad.get() * share.min(1.0)
        };
        let half_us = ccw_us / 2;
        let mut corners = vec![(0, centre)];
        for cycle in 0..cycles {
            let top_us = cycle * (ccw_us + cw_us) + half_us;
            corners.push((top_us, centre + amplitude(cycle)));
            corners.push((top_us + cw_us, centre - amplitude(cycle)));
        }
        corners.push((duration_us, centre));
        Ok(Self { corners, mirrored: config.is_mirrored(), actuators: config.actuators.clone() })
    }

    /// How long it takes \[µs\].
    pub fn duration_us(&self) -> u64 {
        self.corners.last().map_or(0, |&(us, _)| us)
    }

    /// How long it takes \[s\].
    pub fn duration_s(&self) -> f64 {
        self.duration_us() as f64 * 1e-6
    }

    /// The angle at which it starts and ends \[rad\].
    pub fn centre_rad(&self) -> f64 {
        self.corners[0].1
    }

    /// Whether a longer pulse turns the servo clockwise as the camera sees it.
    pub fn mirrored(&self) -> bool {
        self.mirrored
    }

    /// The angle at `time_s` after its start \[rad\]; before and after it, the centre.
    pub fn angle_rad(&self, time_s: f64) -> f64 {
        let us = time_s * 1e6;
        let next = self.corners.partition_point(|&(corner, _)| corner as f64 <= us);
        if next == 0 || next == self.corners.len() {
            return self.centre_rad();
        }
        let ((t0, a0), (t1, a1)) = (self.corners[next - 1], self.corners[next]);
        a0 + (a1 - a0) * (us - t0 as f64) / (t1 - t0) as f64
    }

    /// Its pulses on the channels that play it.
    ///
    /// # Errors
    /// [`ProfileError`] naming the limit it would break and what to change.
    pub fn pulses(&self, servo: &ServoConfig) -> Result<PulseProfile, ProfileError> {
        let channels: Vec<&ServoChannel> = match &self.actuators {
            None => servo.driven().map(|(channel, _)| channel).collect(),
            Some(names) => names
                .iter()
                .map(|name| {
                    let found = servo.driven().find(|(_, actuator)| actuator == name);
                    found.map(|(c, _)| c).ok_or_else(|| ProfileError::NoChannel { actuator: name.clone() })
                })
                .collect::<Result<_, _>>()?,
        };
        if channels.is_empty() {
            return Err(ProfileError::NoChannel { actuator: "<name in the model>".into() });
        }
        let tracks = channels.into_iter().map(|channel| self.track(channel)).collect::<Result<_, _>>()?;
        Ok(PulseProfile { tracks })
    }

    fn track(&self, channel: &ServoChannel) -> Result<PulseTrack, ProfileError> {
        let (unit, range) = (channel.travel.unit(), channel.travel.range());
        let pulse = |angle_rad: f64| {
            let pulse = channel.setpoint(angle_rad, self.mirrored);
            let (min, max) = (*range.start(), *range.end());
            if (f64::from(min)..=f64::from(max)).contains(&pulse.round()) {
                return Ok(pulse.round() as u16);
            }
            Err(ProfileError::Pulse { channel: channel.name.clone(), angle_rad, pulse, min, max, unit })
        };
        let limit = RateUsPerS(channel.travel.max_rate_per_s());
        let start_pulse = pulse(self.centre_rad())?;
        let mut segments = Vec::with_capacity(self.corners.len() - 1);
        let mut before = PulseWidthUs(start_pulse);
        for pair in self.corners.windows(2) {
            let ((t0, a0), (t1, a1)) = (pair[0], pair[1]);
            let (end, duration) = (PulseWidthUs(pulse(a1)?), DurationUs((t1 - t0) as u32));
            if !limit.allows(before, end, duration) {
                return Err(ProfileError::Rate {
                    channel: channel.name.clone(),
                    rate_per_s: RateUsPerS::needed(before, end, duration).0,
                    limit_per_s: limit.0,
                    unit,
                    stroke: if a1 > a0 { "ccw_s" } else { "cw_s" },
                });
            }
            segments.push((duration.0, end.0));
            before = end;
        }
        Ok(PulseTrack { channel: channel.id, start_pulse, segments })
    }
}

/// Both strokes in whole microseconds. Times asked for in a whole ratio, 2:1 above all, keep it exactly.
fn stroke_times_us(ccw_s: f64, cw_s: f64) -> (u64, u64) {
    let us = |s: f64| (s * 1e6).round() as u64;
    let whole = |ratio: f64| ratio >= 1.0 && (ratio - ratio.round()).abs() < 1e-6;
    if whole(ccw_s / cw_s) {
        (us(cw_s).saturating_mul((ccw_s / cw_s).round() as u64), us(cw_s))
    } else if whole(cw_s / ccw_s) {
        (us(ccw_s), us(ccw_s).saturating_mul((cw_s / ccw_s).round() as u64))
    } else {
        (us(ccw_s), us(cw_s))
    }
}

#[cfg(test)]
mod tests;
