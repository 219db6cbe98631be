//! What works with any board in any state: stopping it and asking how it is, whatever its protocol version, without a
//! session that it would have to be kept alive for.

use std::time::Instant;

use firmware_protocol::command::{Command, kind};
use firmware_protocol::event::{Event, Fault, Status};

use super::link::Link;
use super::port::{self, HELLO_TIMEOUT, Received};
use super::{ServoError, StopOutcome};
use ground::clock::MonotonicNs;

/// Stops whatever board is on `port_name`, of whatever protocol version, without a session.
///
/// # Errors
/// [`ServoError::Open`].
pub fn emergency_stop(port_name: &str, baud: u32) -> Result<StopOutcome, ServoError> {
    let mut link = bare_link();
    link.e_stop();
    let stopped = converse_until(port_name, baud, &mut link, |link| link.is_stopped().then_some(()))?;
    Ok(stopped.map_or(StopOutcome::LeftToDeadMan, |()| StopOutcome::Acknowledged))
}

/// How the board on `port_name` is, of whatever protocol version, without a session.
///
/// # Errors
/// [`ServoError::Open`]; [`ServoError::Handshake`] when nothing intelligible comes.
pub fn query_status(port_name: &str, baud: u32) -> Result<Status, ServoError> {
    let mut link = bare_link();
    let status = converse_until(port_name, baud, &mut link, |link| match link.take_answer() {
        Some(Ok(Event::Status(status))) => Some(status),
        Some(_) => {
            link.ask(Command::Status, MonotonicNs::now());
            None
        }
        None => None,
    })?;
    let why = || port::no_hello(link.bytes, link.damaged);
    status.ok_or_else(|| ServoError::Handshake { port: port_name.into(), why: why() })
}

/// Acknowledges what the board on `port_name` has latched, an emergency stop too: a person says that it may move again. Gives what that
/// was.
///
/// # Errors
/// [`ServoError::Open`]; [`ServoError::Handshake`] when nothing intelligible comes; [`ServoError::Fault`] when the board is latched all
/// the same: its switch is still pressed, or what it found is still so.
pub fn release(port_name: &str, baud: u32) -> Result<Fault, ServoError> {
    let mut link = bare_link();
    let mut latched = None;
    let mut acknowledged = false;
    let done = converse_until(port_name, baud, &mut link, |link| {
        let now = MonotonicNs::now();
        match link.take_answer()? {
            // a session is begun for the acknowledgement and ended again, since nothing would keep it alive
            Ok(Event::Status(Status { fault: Fault::None, .. })) => return Some(Ok(())),
            Ok(Event::Status(Status { fault, .. })) if acknowledged => return Some(Err(fault)),
            Ok(Event::Status(Status { fault, .. })) => {
                latched = Some(fault);
                link.ask(Command::Hello, now);
            }
            Ok(Event::Hello(_)) => link.ask(Command::Acknowledge(latched.unwrap_or(Fault::None)), now),
            Ok(Event::Ack(ack)) if ack.command == kind::ACKNOWLEDGE => {
                acknowledged = true;
                link.ask(Command::Goodbye, now);
            }
            Ok(_) | Err(_) => link.ask(Command::Status, now),
        }
        None
    })?;
    match done {
        Some(Ok(())) => Ok(latched.unwrap_or(Fault::None)),
        Some(Err(fault)) => Err(ServoError::Fault { reason: format!("{fault}; it is so still") }),
        None => {
            let why = port::no_hello(link.bytes, link.damaged);
            Err(ServoError::Handshake { port: port_name.into(), why })
        }
    }
}

fn bare_link() -> Link {
    let now = MonotonicNs::now();
    let mut link = Link::new(f64::INFINITY, now.0 as u16, now);
    link.ask(Command::Status, now);
    link
}

fn converse_until<T>(
    port_name: &str,
    baud: u32,
    link: &mut Link,
    mut done: impl FnMut(&mut Link) -> Option<T>,
) -> Result<Option<T>, ServoError> {
    let mut port = port::open(port_name, baud)?;
    let mut bytes = [0; 256];
    let deadline = Instant::now() + HELLO_TIMEOUT;
    while Instant::now() < deadline {
        while let Some(line) = link.next_packet(MonotonicNs::now()) {
            if port.write_all(&line).is_err() {
                return Ok(None);
            }
        }
        match port::read(&mut *port, &mut bytes) {
            Received::Bytes(length) => link.receive(&bytes[..length], MonotonicNs::now()),
            Received::Nothing => {}
            Received::Gone(_) => return Ok(None),
        }
        if let Some(found) = done(link) {
            return Ok(Some(found));
        }
    }
    Ok(None)
}
