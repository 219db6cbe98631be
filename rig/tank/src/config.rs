//! The `[tank]` table: the true properties of the simulated tank, which neither the servo config nor a fit can read.

use std::path::PathBuf;

use ground::strict::{Finite, NonNegative, Positive, Share};
use serde::{Deserialize, Serialize};

use super::causes::Causes;
use servo::COUNTS_PER_RAD;

/// The simulated tank behind mock board and mock camera. Alone in a file, as `T/tank.toml`, it serves the mocks that are
/// processes of their own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TankConfig {
    /// The true mechanism: an MJCF file, relative to the config.
    pub model: PathBuf,
    /// Coordinates at the beginning, as in the model's `qpos` \[rad\] or \[m\]. Default: the model's reference.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub initial_qpos: Vec<Finite>,
    /// What keeps the mechanism in its initial pose. Default `nothing`.
    #[serde(default)]
    pub hold: Hold,
    /// Time step of the simulation \[s\]. Default: the model's, but no longer than 0.2 ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timestep_s: Option<Positive>,
    /// Seed of the camera's noise. Default 1.
    #[serde(default = "seed")]
    pub seed: u64,
    /// The servos on the board.
    #[serde(default)]
    pub servo: Vec<TankServo>,
    /// How the mechanism is let go; only for `hold = "release"`.
    #[serde(default)]
    pub release: Release,
    /// Effects in it beyond the model: causes as in `docs/causes.md`, each with its numbers. Default: nothing.
    #[serde(default, skip_serializing_if = "Causes::is_empty")]
    pub causes: Causes,
    /// What the camera sees of it.
    pub view: TankView,
}

/// What keeps the mechanism in its initial pose.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Hold {
    /// Nothing: it settles.
    #[default]
    Nothing,
    /// A support, taken away when the first servo gets its first pulse.
    FirstPulse,
    /// A support line, until the release.
    Release,
}

/// The true properties of a hobby servo. It looks at its pulse once a period, turns towards it no faster than it can, and
/// exerts no torque without a pulse.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TankServo {
    /// The board's channel, or the servo's ID on a bus. Default 0.
    #[serde(default)]
    pub channel: u8,
    /// The model's position actuator that it turns.
    pub actuator: String,
    /// Pulse at angle 0 \[µs\]. Default 1500.
    #[serde(default = "zero_us")]
    pub zero_us: Positive,
    /// Pulse per angle \[µs/rad\]; negative where the servo is mounted the other way round. Default 600.
    #[serde(default = "us_per_rad")]
    pub us_per_rad: Finite,
    /// Count at angle 0 of a servo on a bus. The emulated bus simulates the servo itself: lag and rate limit here are those between it
    /// and the link. Default 2048.
    #[serde(default = "zero_count")]
    pub zero_count: NonNegative,
    /// Fastest turn \[rad/s\]. Default 8, 60 degrees in 0.13 s.
    #[serde(default = "rate_limit")]
    pub rate_limit_rad_per_s: Positive,
    /// Time constant of its controller \[s\]. Default 0.02.
    #[serde(default = "lag")]
    pub lag_s: NonNegative,
    /// Period of its pulses \[s\]. Default 0.02.
    #[serde(default = "period")]
    pub period_s: Positive,
}

impl TankServo {
    /// The angle for a pulse \[rad\].
    pub(super) fn pulse_angle_rad(&self, pulse_us: u16) -> f64 {
        (f64::from(pulse_us) - self.zero_us.get()) / self.us_per_rad.get()
    }

    /// The angle for a position on a bus \[rad\].
    pub(super) fn count_angle_rad(&self, counts: f64) -> f64 {
        (counts - self.zero_count.get()) / COUNTS_PER_RAD
    }
}

/// How the mechanism is let go.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Release {
    /// From being asked to letting go \[s\]. Default 0.5.
    pub after_s: NonNegative,
    /// Channel of a release actuator. Default: none, a hand lets go when asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel: Option<u8>,
    /// The release actuator lets go at this pulse and above \[µs\]. Default 1700.
    pub open_us: u16,
}

impl Default for Release {
    fn default() -> Self {
        Self { after_s: not_negative(0.5), channel: None, open_us: 1700 }
    }
}

/// What the camera sees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TankView {
    /// Scale \[m/px\].
    pub metres_per_pixel: Positive,
    /// Where the world origin is seen \[px\].
    pub origin_px: [Finite; 2],
    /// Which plane the camera looks at. Default x-z.
    #[serde(default)]
    pub plane: camera::calibration::View,
    /// Grey of the water in the middle of the picture, 0 to 255. Default 200.
    #[serde(default = "water")]
    pub water_grey: NonNegative,
    /// Grey of the mechanism there, 0 to 255. Default 40.
    #[serde(default = "mechanism")]
    pub mechanism_grey: NonNegative,
    /// Blur of the lens, 1 sigma \[px\]. Default 0.8.
    #[serde(default = "blur")]
    pub blur_px: NonNegative,
    /// Share of the light that is missing in the picture's corners. Default 0.
    #[serde(default = "even")]
    pub falloff: Share,
    /// Standard deviation of a pixel's noise \[grey levels\]. Default 2.
    #[serde(default = "noise")]
    pub noise_grey: NonNegative,
    /// Where the board's sync LED is seen \[px\]. Default: nowhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sync_led_px: Option<[Finite; 2]>,
    /// How much later than the start of exposure stamps really are \[s\]. Default 0.
    #[serde(default = "exact")]
    pub stamp_latency_s: NonNegative,
    /// Standard deviation of the stamps \[s\]. Default 0.
    #[serde(default = "exact")]
    pub stamp_jitter_s: NonNegative,
}

fn seed() -> u64 {
    1
}

fn zero_us() -> Positive {
    positive(1500.0)
}

fn zero_count() -> NonNegative {
    not_negative(2048.0)
}

fn us_per_rad() -> Finite {
    Finite::new(600.0).unwrap_or_else(|| unreachable!("600 is finite"))
}

fn rate_limit() -> Positive {
    positive(8.0)
}

fn lag() -> NonNegative {
    not_negative(0.02)
}

fn period() -> Positive {
    positive(0.02)
}

fn noise() -> NonNegative {
    not_negative(2.0)
}

fn water() -> NonNegative {
    not_negative(200.0)
}

fn mechanism() -> NonNegative {
    not_negative(40.0)
}

fn blur() -> NonNegative {
    not_negative(0.8)
}

fn even() -> Share {
    Share::new(0.0).unwrap_or_else(|| unreachable!("0 is a share"))
}

fn exact() -> NonNegative {
    not_negative(0.0)
}

fn positive(value: f64) -> Positive {
    Positive::new(value).unwrap_or_else(|| unreachable!("{value} is positive"))
}

fn not_negative(value: f64) -> NonNegative {
    NonNegative::new(value).unwrap_or_else(|| unreachable!("{value} is not negative"))
}
