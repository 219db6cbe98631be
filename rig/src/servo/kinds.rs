//! The kinds of servo board that a config can name.
//!
//! Another one is a file with its `impl ServoBoard` and a function that opens it, and a line of the list at the end.

use serde::{Deserialize, Serialize};

use super::config::ServoConfig;
use super::mock::MockOptions;
use super::pulses::PulseSink;
use super::replay::Told;
use super::{ServoBoard, ServoError, mock, no_board, replay, serial};

/// What a board is opened with.
pub struct Opening<'a> {
    /// The `[servo]` table.
    pub config: &'a ServoConfig,
    /// What a mock board is like, and where its pulses go.
    pub mock: (MockOptions, Box<dyn PulseSink>),
    /// What a replayed board tells.
    pub told: Option<Told>,
}

macro_rules! boards {
    ($($(#[$attribute:meta])* $kind:ident => $open:path,)*) => {
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
                $(BoardKind::$kind => $open(opening),)*
            }
        }
    };
}

boards! {
    /// A board on a serial port.
    Serial => serial::open,
    /// A mock board behind a pseudo-terminal, in this process.
    Mock => mock::open,
    /// The board of a recorded run, which tells again what it told then; nothing moves.
    Replay => replay::open,
    /// No board: nothing is driven.
    None => no_board::open,
}
