//! Which board a config names.

use super::config::{BoardKind, ServoConfig};
use super::mock::{MockOptions, MockServo};
use super::no_board::NoBoard;
use super::pulses::PulseSink;
use super::serial::SerialBoard;
use super::{ServoBoard, ServoError};

/// Opens the board that `config` names. `mock` says what a mock board is like and where its pulses go; the other
/// kinds have no use for it.
///
/// # Errors
/// As [`SerialBoard::open`].
pub fn open(
    config: &ServoConfig,
    mock: (MockOptions, Box<dyn PulseSink>),
) -> Result<Box<dyn ServoBoard>, ServoError> {
    Ok(match config.kind {
        BoardKind::None => Box::new(NoBoard::default()),
        BoardKind::Mock => Box::new(MockServo::open(config, mock.0, mock.1)?),
        BoardKind::Serial => {
            let port = config.port.as_deref().unwrap_or_default();
            Box::new(SerialBoard::open(port, config, false)?)
        }
    })
}
