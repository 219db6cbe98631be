//! The protocol between host and servo board, byte by byte.
//!
//! A board plays timed pulse profiles on up to 16 channels by its own clock, so that the host's jitter cannot touch
//! their timing. The host uploads a profile, arms it at a board tick to come, and keeps sending; a board that receives
//! no valid packet for its dead-man's time puts every channel in its safe state and stays so until acknowledged.
//!
//! Contents: [`packet`] frames bytes on the line, [`command`] and [`event`] are the messages, [`channel`] a channel's
//! configuration, [`units`] their integers, [`board`] is a whole board but for its hardware, [`sync_led`] the pattern
//! from which pictures give a board's clock. No allocation, no `std`.
//! `vectors/messages.txt` holds one packet per line with its meaning, `vectors/session.txt` a whole conversation with
//! the pulses it causes: firmware in C that reproduces both conforms. `reference/board.c` is such firmware, all but
//! port, pins and clock; the tests compile it and hold it to the vectors and to [`board`] on random conversations. `uno/`
//! puts it on an ATmega328P; the tests run that in an emulator and measure the pulses on its pins. `pico/` puts
//! [`board`] on an RP2040.
//!
//! ```
//! use firmware_protocol::{command::Command, packet::Decoder, units::{Channel, DurationUs, PulseWidthUs, Sequence}};
//!
//! let jog = Command::Jog { channel: Channel(0), pulse: PulseWidthUs(1500), duration: DurationUs(500_000) };
//! let mut decoder = Decoder::default();
//! let received: Vec<_> =
//!     jog.encode(Sequence(7)).encode().iter().filter_map(|&byte| decoder.push(byte)).collect();
//! assert_eq!(Command::decode(&received[0].unwrap()), Some(jog));
//! ```
#![doc = include_str!("../../docs/wire-protocol.md")]
#![no_std]

pub mod board;
pub mod channel;
pub mod command;
pub mod event;
mod layout;
pub mod packet;
pub mod sync_led;
pub mod units;

/// Version of the protocol, in every packet's second byte.
pub const VERSION: u8 = 1;

/// Time between two packets of a host, chosen so that several may be lost before the dead-man acts.
pub const HEARTBEAT: units::DurationMs = units::DurationMs(50);
