//! The serial port itself: opening it, reading from it, and saying clearly what is wrong with it.

use std::time::Duration;

use serialport::SerialPort;

use super::ServoError;

/// Longest sleep in a read, chosen: an e-stop waits for it.
pub(super) const READ_TIMEOUT: Duration = Duration::from_millis(2);
/// Opening a port may reset the board behind it, which then takes up to 3 s to come up.
pub(super) const HELLO_TIMEOUT: Duration = Duration::from_secs(3);

/// The result of a read.
pub(super) enum Received {
    /// The number of bytes read.
    Bytes(usize),
    /// None yet.
    Nothing,
    /// The port is gone: what the system said.
    Gone(String),
}

/// Reads what there is, or waits a little for it.
pub(super) fn read(port: &mut dyn SerialPort, bytes: &mut [u8]) -> Received {
    use std::io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    match port.read(bytes) {
        // The end, not "nothing yet": whoever reads on spins.
        Ok(0) => Received::Gone("port closed; unplugged?".into()),
        Ok(length) => Received::Bytes(length),
        Err(error) if matches!(error.kind(), TimedOut | WouldBlock | Interrupted) => Received::Nothing,
        Err(error) => Received::Gone(format!("{error}; unplugged?")),
    }
}

/// Reads what comes within `wait`, and within [`READ_TIMEOUT`] at most.
pub(super) fn read_within(port: &mut dyn SerialPort, bytes: &mut [u8], wait: Duration) -> Received {
    // Both calls only note a number; writing has the usual time.
    let _ = port.set_timeout(wait.min(READ_TIMEOUT));
    let received = read(port, bytes);
    let _ = port.set_timeout(READ_TIMEOUT);
    received
}

/// Opens a port for this process alone.
pub(super) fn open(port_name: &str, baud: u32) -> Result<Box<dyn SerialPort>, ServoError> {
    use serialport::ErrorKind;
    serialport::new(port_name, baud).timeout(READ_TIMEOUT).open().map_err(|error| {
        let why = match error.kind() {
            // The crate says "no device" both when it is locked and when another program has it exclusively.
            ErrorKind::NoDevice if std::path::Path::new(port_name).exists() => {
                "in use by another program; end that one first (fuser -v shows it)".into()
            }
            ErrorKind::NoDevice | ErrorKind::Io(std::io::ErrorKind::NotFound) => {
                "no such port; check the cable, `rig list` shows what is there".into()
            }
            ErrorKind::Io(std::io::ErrorKind::PermissionDenied) => {
                "permission denied; add yourself to the group that owns it (often dialout) and log in again"
                    .into()
            }
            _ => error.to_string(),
        };
        ServoError::Open { port: port_name.into(), why }
    })
}

/// Why there was no answer to hello, judged by what came instead.
pub(super) fn no_hello(bytes: u64, damaged: u64) -> String {
    let waited_s = HELLO_TIMEOUT.as_secs();
    match bytes {
        0 => {
            format!("nothing came within {waited_s} s; check power, cable and that this is the board's port")
        }
        _ => format!(
            "{bytes} bytes within {waited_s} s, {damaged} damaged packets and no answer to hello; wrong baud rate, or \
             another device"
        ),
    }
}
