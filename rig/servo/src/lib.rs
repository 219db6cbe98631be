//! Servo boards: one trait, and a real one on a serial port, servos on a bus, a mock, a recorded one and none behind it.
//!
//! Another kind is a file and a line of the list in `kinds`.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

pub mod bus;
pub mod calibration;
mod channel;
pub mod config;
#[doc(hidden)]
pub mod fixtures;
pub mod held;
mod kinds;
mod link;
pub mod mock;
pub mod motion;
pub mod no_board;
mod port;
pub mod profile;
mod pty;
pub mod pulse_log;
mod pulses;
mod refusal;
pub mod replay;
pub mod serial;
mod sessionless;
#[cfg(test)]
mod tests;
mod travel;

pub use config::{ServoChannel, ServoConfig};
pub use held::HeldBoard;
pub use kinds::{BoardKind, Opening, open};
pub use mock::{BoardFault, MockBoard, MockOptions, MockServo};
pub use no_board::NoBoard;
pub use pulses::{PulseProfile, PulseSink, PulseTrack};
pub use serial::SerialBoard;
pub use travel::COUNTS_PER_RAD;
pub use travel::{CountTravel, PulseTravel, Travel, Unit};

use ground::clock::{MonotonicNs, Ping};
use ground::hold::Hold;

/// A board that moves the mechanism. Calls block briefly (at most about 100 ms); the link to a real board keeps
/// itself alive on a thread of its own.
pub trait ServoBoard: Send {
    /// Identity and channels, from the handshake.
    fn info(&self) -> &BoardInfo;

    /// Uploads the profile and arms the board to start it at `start`, which must lie far enough ahead.
    /// The board times it from there by itself.
    ///
    /// # Errors
    /// [`ServoError`]; nothing moves after an error.
    fn arm(&mut self, profile: &PulseProfile, start: MonotonicNs) -> Result<(), ServoError>;

    /// Moves one channel to `pulse`, in the channel's unit, over `duration_s`, at once.
    ///
    /// # Errors
    /// [`ServoError`], also when a limit forbids it.
    fn jog(&mut self, channel: u8, pulse: u16, duration_s: f64) -> Result<(), ServoError>;

    /// What happened since the last call: telemetry, clock pings, state changes.
    ///
    /// # Errors
    /// [`ServoError`] when the board is lost or has stopped by itself; returned once, then events go on.
    fn poll(&mut self) -> Result<Vec<ServoEvent>, ServoError>;

    /// Puts every channel in its safe state. Tries everything there is, in order, and never gives up early:
    /// e-stop until acknowledged, then DTR, then leaving the board to its dead-man.
    fn stop(&mut self) -> StopOutcome;

    /// The ordinary end: every channel in its safe state, and this session leaves nothing latched, so that the next one can begin without a
    /// release. A board that somebody else stopped stays stopped.
    fn leave(&mut self) -> StopOutcome {
        self.stop()
    }
}

/// Identity of a board, from the handshake.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BoardInfo {
    /// Port or kind, for people.
    pub name: String,
    /// Firmware's protocol version.
    pub protocol_version: u8,
    /// Random number that changes with each start of the board.
    pub boot_id: u32,
    /// Number of channels.
    pub channels: u8,
}

/// Something that a board reported, with times on the host's clock as far as known then.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum ServoEvent {
    /// A clock ping: sent, board's tick, received. Kept raw so that a replay can fit the clock again. Servos on a bus are timed by this
    /// computer: there the tick is its own clock, and a ping takes no time.
    Ping {
        /// When the host sent it.
        sent: MonotonicNs,
        /// Board's tick at receipt, extended to 64 bit \[µs\].
        board_tick_us: u64,
        /// When the answer came.
        received: MonotonicNs,
    },
    /// The pulse of a channel at a board tick.
    Pulse {
        /// Channel number.
        channel: u8,
        /// Board's tick \[µs\], extended to 64 bit.
        board_tick_us: u64,
        /// Pulse width, or none while detached \[µs\].
        pulse_us: Option<u16>,
    },
    /// The measured position of a servo on a bus, at some time between question and answer.
    Position {
        /// ID of the servo.
        channel: u8,
        /// Position \[counts\].
        count: i32,
        /// When the host asked.
        sent: MonotonicNs,
        /// When the answer was there.
        received: MonotonicNs,
    },
    /// The profile began.
    Started {
        /// Board's tick \[µs\].
        board_tick_us: u64,
    },
    /// The profile ended by itself.
    Finished {
        /// Board's tick \[µs\].
        board_tick_us: u64,
    },
    /// Something for the journal.
    Note {
        /// The text.
        text: String,
    },
}

impl ServoEvent {
    /// This event as a clock ping, if it is one: what [`ClockFit`](ground::clock::ClockFit) is fitted to.
    pub fn ping(&self) -> Option<Ping> {
        match *self {
            Self::Ping { sent, board_tick_us, received } => Some(Ping { sent, board_tick_us, received }),
            _ => None,
        }
    }
}

/// How a stop went.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopOutcome {
    /// The board acknowledged it.
    Acknowledged,
    /// No answer; the board's dead-man stops it within its time limit.
    LeftToDeadMan,
    /// There is no board.
    NotNeeded,
}

/// What went wrong with a servo board.
#[derive(Debug, thiserror::Error)]
pub enum ServoError {
    /// The port cannot be opened.
    #[error("opening servo port {port}: {why}")]
    Open {
        /// Which port.
        port: String,
        /// Reason and remedy.
        why: String,
    },
    /// The device does not speak the protocol or speaks another version.
    #[error("servo board on {port}: {why}")]
    Handshake {
        /// Which port.
        port: String,
        /// Expected, got, remedy.
        why: String,
    },
    /// Nothing valid came for too long, or the port went away.
    #[error("servo board on {port} lost: {why}")]
    Lost {
        /// Which port.
        port: String,
        /// What was received last, or what the system said.
        why: String,
    },
    /// The board restarted: it no longer knows the profile.
    #[error("servo board on {port} restarted (boot id {before:08x} then {after:08x}): check its supply")]
    Restarted {
        /// Which port.
        port: String,
        /// Boot id at the handshake.
        before: u32,
        /// Boot id now.
        after: u32,
    },
    /// The board or the host's own limits refused a request.
    #[error("servo board refused {request}: {why}")]
    Refused {
        /// The request.
        request: String,
        /// Limit and remedy.
        why: String,
    },
    /// The board stopped by itself and stays so until acknowledged.
    #[error("servo board stopped by itself: {reason}")]
    Fault {
        /// The board's reason.
        reason: String,
    },
    /// Somebody has stopped the board, by its own switch or from another program.
    #[error(
        "the emergency stop of the servo board on {port} is latched; `rig release CONFIG --by NAME` ends that"
    )]
    Stopped {
        /// Which port.
        port: String,
    },
    /// The rig is held: nothing may move.
    #[error("the rig is {0}; `rig release CONFIG --by NAME` ends that")]
    Held(Hold),
}
