//! Boards that drive nothing: one that tells again what a recorded one told, and none at all.

use super::{BoardInfo, ServoBoard, ServoError, ServoEvent, StopOutcome};
use crate::clock::MonotonicNs;
use crate::profile::PulseProfile;

/// Events of one [`ServoBoard::poll`], so that a long recording does not come in one piece.
const AT_ONCE: usize = 256;

/// A board that tells again what a recorded one told, in order and without waiting. Arming and jogging were done when
/// it was recorded and do nothing now.
pub struct ReplayBoard {
    info: BoardInfo,
    events: std::vec::IntoIter<ServoEvent>,
}

impl ReplayBoard {
    /// A board that said `info` and told `events`.
    pub fn new(info: BoardInfo, events: Vec<ServoEvent>) -> Self {
        Self { info, events: events.into_iter() }
    }
}

impl ServoBoard for ReplayBoard {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    fn arm(&mut self, _: &PulseProfile, _: MonotonicNs) -> Result<(), ServoError> {
        Ok(())
    }

    fn jog(&mut self, _: u8, _: u16, _: f64) -> Result<(), ServoError> {
        Ok(())
    }

    /// The next events; none when the recording is over.
    fn poll(&mut self) -> Result<Vec<ServoEvent>, ServoError> {
        Ok(self.events.by_ref().take(AT_ONCE).collect())
    }

    fn stop(&mut self) -> StopOutcome {
        StopOutcome::NotNeeded
    }
}

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
