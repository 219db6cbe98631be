//! No board at all.

use super::PulseProfile;
use super::{BoardInfo, ServoBoard, ServoError, ServoEvent, StopOutcome};
use ground::clock::MonotonicNs;

/// No board, for runs in which nothing is driven.
pub struct NoBoard(BoardInfo);

impl Default for NoBoard {
    fn default() -> Self {
        Self(BoardInfo { name: "none".into(), protocol_version: 0, boot_id: 0, channels: 0 })
    }
}

impl NoBoard {
    fn refuse(request: &str) -> Result<(), ServoError> {
        let why = "the config has no board ([servo] kind = \"none\")".into();
        Err(ServoError::Refused { request: request.into(), why })
    }
}

impl ServoBoard for NoBoard {
    fn info(&self) -> &BoardInfo {
        &self.0
    }

    fn arm(&mut self, _: &PulseProfile, _: MonotonicNs) -> Result<(), ServoError> {
        Self::refuse("arming")
    }

    fn jog(&mut self, _: u8, _: u16, _: f64) -> Result<(), ServoError> {
        Self::refuse("jog")
    }

    fn poll(&mut self) -> Result<Vec<ServoEvent>, ServoError> {
        Ok(Vec::new())
    }

    fn stop(&mut self) -> StopOutcome {
        StopOutcome::NotNeeded
    }
}
