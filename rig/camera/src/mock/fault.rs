//! Faults a mock camera plays.

use ground::strict::NonNegative;
use serde::{Deserialize, Serialize};

/// A fault and when it begins; it lasts until the next one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFault {
    /// Since the run's start \[s\].
    pub at_s: NonNegative,
    /// What happens.
    pub kind: CameraFaultKind,
}

/// What can happen to a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum CameraFaultKind {
    /// It is gone.
    #[serde(rename = "camera-off")]
    Off,
    /// It keeps sending the same picture, with fresh stamps.
    #[serde(rename = "camera-stuck")]
    Stuck,
    /// It stalls: no more images.
    #[serde(rename = "camera-slow")]
    Slow,
    /// It loses images here and there.
    #[serde(rename = "camera-intermittent")]
    Intermittent,
    /// It sends corrupt bytes.
    #[serde(rename = "camera-garbage")]
    Garbage,
}

impl std::str::FromStr for CameraFaultKind {
    type Err = String;

    /// With or without the leading `camera-`.
    fn from_str(name: &str) -> Result<Self, String> {
        match name.strip_prefix("camera-").unwrap_or(name) {
            "off" => Ok(Self::Off),
            "stuck" => Ok(Self::Stuck),
            "slow" => Ok(Self::Slow),
            "intermittent" => Ok(Self::Intermittent),
            "garbage" => Ok(Self::Garbage),
            _ => Err(format!("`{name}` is no camera fault: off, stuck, slow, intermittent or garbage")),
        }
    }
}
