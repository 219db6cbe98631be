//! Configs of servos, for tests.

use std::path::Path;

use ground::strict::StrictError;
use serde::{Deserialize, Serialize};

use crate::ServoConfig;

/// One servo of a mock board.
pub const EXAMPLE: &str = r#"
[servo]
kind = "mock"
dead_man_ms = 1000
[[servo.channel]]
id = 0
name = "base"
actuator = "servo"
min_pulse_us = 900
max_pulse_us = 2100
max_rate_us_per_s = 4000
safe_state = "hold"
"#;

/// One servo of an emulated bus.
pub const BUS: &str = r#"
[servo]
kind = "dynamixel"
port = "mock"
dead_man_ms = 1000
max_late_ms = 1000
[[servo.channel]]
id = 1
name = "base"
actuator = "servo"
zero_count = 2048
min_count = 1400
max_count = 2700
max_rate_rad_per_s = 6.0
safe_state = "detach"
calibrated = true
"#;

/// A rig's config as far as it concerns servos.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// Its table.
    pub servo: ServoConfig,
}

/// [`EXAMPLE`], read.
///
/// # Panics
/// Never.
pub fn example() -> ServoConfig {
    parse(EXAMPLE).unwrap_or_else(|error| panic!("{error}"))
}

/// The servos of a rig's config.
///
/// # Errors
/// As any config's.
pub fn parse(text: &str) -> Result<ServoConfig, StrictError> {
    ground::strict::parse(text, Path::new("rig.toml")).map(|rig: Rig| rig.servo)
}
