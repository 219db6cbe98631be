//! A board that repeats the events of the board of a recorded run. Nothing moves.

use std::collections::VecDeque;

use super::pulses::PulseProfile;
use super::{BoardInfo, ServoBoard, ServoError, ServoEvent, StopOutcome};
use ground::clock::{MonotonicNs, ReplayClock};

/// The events of the board of a recorded run, as a board that repeats them.
#[derive(Debug)]
pub struct ReplayBoard {
    /// Identity of the recorded board.
    pub info: BoardInfo,
    /// Its events, each with the host's time at which it was handed over then.
    pub events: VecDeque<(MonotonicNs, ServoEvent)>,
    /// The profile that it played, if any.
    pub profile: Option<PulseProfile>,
    /// Maps times of the recorded run to times of this one.
    pub clock: ReplayClock,
}

impl ServoBoard for ReplayBoard {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    /// Refuses any profile but the one that was played in the recorded run.
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
        let due = self.events.iter().take_while(|(at, _)| self.clock.to_present(*at) <= now).count();
        let clock = &self.clock;
        let shifted = |(_, event)| match event {
            ServoEvent::Ping { sent, board_tick_us, received } => ServoEvent::Ping {
                sent: clock.to_present(sent),
                board_tick_us,
                received: clock.to_present(received),
            },
            ServoEvent::Position { channel, count, sent, received } => ServoEvent::Position {
                channel,
                count,
                sent: clock.to_present(sent),
                received: clock.to_present(received),
            },
            other => other,
        };
        Ok(self.events.drain(..due).map(shifted).collect())
    }

    fn stop(&mut self) -> StopOutcome {
        StopOutcome::NotNeeded
    }
}
