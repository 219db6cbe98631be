//! Servos on a serial bus: Dynamixel's X series (protocol 2.0) and Feetech's STS series, without a board between.
//!
//! No servo plays a profile by itself, so this computer does: a thread sends all servos their positions at once, a hundred times a second,
//! and reads back where they are. That costs the exact timing of a board and gains the measured angle. From the wire up: [`packet`]
//! (bytes), `line` (question and answer), [`registers`] (what is where), `servos` (found, given torque, made safe), `stream` (where to
//! be when), [`BusBoard`] (the thread). [`emulated`] is the other end. `docs/bus-servos.md` says what that means at the tank.
//!
//! Packets are our own and not those of the crate `rustypot`, which speaks both protocols: there an instruction waits for a quiet line
//! and is not sent at all where something keeps babbling, torque off included; an answer has no deadline as a whole; and a port that
//! is gone is reported as a timeout.

mod board;
pub mod emulated;
mod emulated_servo;
mod line;
pub mod packet;
mod punctuality;
pub mod registers;
mod servos;
mod stream;
#[cfg(test)]
mod tests;

pub use board::BusBoard;
pub use emulated::{BusFault, BusOptions, EmulatedBus};

use super::{PulseSink, ServoBoard, ServoConfig, ServoError, StopOutcome};
use emulated::EmulatedBusBoard;
use servos::Servos;

/// Opens the bus that a config names: on its port, or an emulated one as `options` say.
///
/// # Errors
/// As [`BusBoard::open`].
pub(super) fn open(
    config: &ServoConfig,
    options: Option<BusOptions>,
    sink: Box<dyn PulseSink>,
) -> Result<Box<dyn ServoBoard>, ServoError> {
    match options.filter(|_| config.is_emulated_bus()) {
        Some(options) => Ok(Box::new(EmulatedBusBoard::open(config, options, sink)?)),
        None => Ok(Box::new(BusBoard::open(config.port.as_deref().unwrap_or_default(), config)?)),
    }
}

/// Puts every servo of `config` on the port `port_name` into its safe state, whatever it is doing; those that park stay where they are.
///
/// # Errors
/// [`ServoError::Open`].
pub fn emergency_stop(port_name: &str, config: &ServoConfig) -> Result<StopOutcome, ServoError> {
    let mut servos = Servos::open(port_name, config)?;
    let (all, _) = servos.make_safe();
    servos.notes.iter().for_each(|note| tracing::warn!("{note}"));
    Ok(if all { StopOutcome::Acknowledged } else { StopOutcome::LeftToDeadMan })
}

/// How each servo of `config` on the port `port_name` is, a line each. Nothing is changed.
///
/// # Errors
/// [`ServoError::Open`], [`ServoError::Lost`].
pub fn query_status(port_name: &str, config: &ServoConfig) -> Result<Vec<String>, ServoError> {
    Servos::open(port_name, config)?.describe()
}
