//! A board that tells again what the board of a recorded run told. Nothing moves.

use std::collections::VecDeque;

use super::pulses::PulseProfile;
use super::{BoardInfo, ServoBoard, ServoError, ServoEvent, StopOutcome};
use ground::clock::{MonotonicNs, ReplayClock};

/// What a board told in a recorded run, and the board that tells it again.
#[derive(Debug)]
pub struct Told {
    /// What the board was.
    pub info: BoardInfo,
    /// Its events, and when each was handed over.
    pub events: VecDeque<(MonotonicNs, ServoEvent)>,
    /// What it played, if anything.
    pub profile: Option<PulseProfile>,
    /// When that is now.
    pub clock: ReplayClock,
}

impl ServoBoard for Told {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    /// The recorded run must have played the same.
    fn arm(&mut self, profile: &PulseProfile, _: MonotonicNs) -> Result<(), ServoError> {
        match &self.profile {
            Some(played) if played == profile => Ok(()),
            _ => Err(ServoError::Refused {
                request: "arming".into(),
                why: "the replayed run played another profile: take [profile] and [servo] from it".into(),
            }),
        }
    }

    fn jog(&mut self, _: u8, _: u16, _: f64) -> Result<(), ServoError> {
        Ok(())
    }

    fn poll(&mut self) -> Result<Vec<ServoEvent>, ServoError> {
        let now = MonotonicNs::now();
        let due = self.events.iter().take_while(|(at, _)| self.clock.again(*at) <= now).count();
        let clock = &self.clock;
        let again = |(_, event)| match event {
            ServoEvent::Ping { sent, board_tick_us, received } => {
                ServoEvent::Ping { sent: clock.again(sent), board_tick_us, received: clock.again(received) }
            }
            ServoEvent::Position { channel, count, sent, received } => ServoEvent::Position {
                channel,
                count,
                sent: clock.again(sent),
                received: clock.again(received),
            },
            other => other,
        };
        Ok(self.events.drain(..due).map(again).collect())
    }

    fn stop(&mut self) -> StopOutcome {
        StopOutcome::NotNeeded
    }
}
