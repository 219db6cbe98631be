//! The kinds of servo board that a config can name.
//!
//! Another one is a file with its `impl ServoBoard`, and a line of the list at the end that says how it is opened.

use serde::{Deserialize, Serialize};

use super::bus::{self, BusOptions};
use super::config::ServoConfig;
use super::mock::{MockOptions, MockServo};
use super::no_board::NoBoard;
use super::pulses::PulseSink;
use super::replay::ReplayBoard;
use super::serial::SerialBoard;
use super::{ServoBoard, ServoError};

/// What a board is opened with.
pub struct Opening<'a> {
    /// The `[servo]` table.
    pub config: &'a ServoConfig,
    /// Options of a mock board, and where its pulses go.
    pub mock: (MockOptions, Box<dyn PulseSink>),
    /// Options of an emulated bus, where the config has one; its motion goes where a mock board's pulses do.
    pub bus: Option<BusOptions>,
    /// The board of a recorded run, for `replay`.
    pub replay: Option<ReplayBoard>,
}

macro_rules! boards {
    ($($(#[$attribute:meta])* $kind:ident => |$opening:pat_param| $open:expr,)*) => {
        /// Which kind of board.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(rename_all = "kebab-case")]
        pub enum BoardKind {
            $($(#[$attribute])* $kind,)*
        }

        /// Opens the board that a config names.
        ///
        /// # Errors
        /// [`ServoError`] naming the board, what is missing, or what it refuses.
        pub fn open(opening: Opening<'_>) -> Result<Box<dyn ServoBoard>, ServoError> {
            match opening.config.kind {
                $(BoardKind::$kind => {
                    let $opening = opening;
                    $open
                })*
            }
        }
    };
}

boards! {
    /// A board on a serial port.
    Serial => |opening| {
        boxed(SerialBoard::open(opening.config.port.as_deref().unwrap_or_default(), opening.config))
    },
    /// A mock board behind a pseudo-terminal, in this process.
    Mock => |opening| boxed(MockServo::open(opening.config, opening.mock.0, opening.mock.1)),
    /// Dynamixel servos (X series, protocol 2.0) on a bus.
    Dynamixel => |opening| bus::open(opening.config, opening.bus, opening.mock.1),
    /// Feetech servos (STS series) on a bus.
    Feetech => |opening| bus::open(opening.config, opening.bus, opening.mock.1),
    /// The board of a recorded run, whose events are repeated; nothing moves.
    Replay => |opening| boxed(opening.replay.ok_or_else(|| ServoError::Refused {
        request: "opening".into(),
        why: "add [replay] run = \"...\", a recorded run that had a board".into(),
    })),
    /// No board: nothing is driven.
    None => |_| boxed(Ok(NoBoard::default())),
}

fn boxed<B: ServoBoard + 'static>(board: Result<B, ServoError>) -> Result<Box<dyn ServoBoard>, ServoError> {
    Ok(Box::new(board?))
}
