//! What host and servo board say to each other, byte by byte.
//!
//! A board plays timed pulse profiles on up to 16 channels by its own clock, so that the host's jitter cannot touch
//! their timing. The host uploads a profile, arms it at a board tick to come, and keeps sending; a board that hears
//! nothing valid for its dead-man's time puts every channel in its safe state and stays so until acknowledged.
//!
//! Contents: [`packet`] frames bytes on the line, [`command`] and [`event`] are the messages, [`channel`] what both
//! say of a channel, [`units`] their integers, [`board`] is a whole board but for its hardware, [`sync_led`] the pattern
//! by which pictures tell a board's clock. No allocation, no `std`.
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
//! let heard: Vec<_> =
//!     jog.encode(Sequence(7)).encode().iter().filter_map(|&byte| decoder.push(byte)).collect();
//! assert_eq!(Command::decode(&heard[0].unwrap()), Some(jog));
//! ```
//!
//! # Packets
//!
//! `00`, COBS of (kind `u8`, version `u8`, sequence `u16`, body, CRC `u16`), `00`; see [`packet`]. Bodies are at most
//! 64 bytes, fields little-endian, in order, without gaps; `0` is a byte that must be zero. A body that is not exactly
//! of its kind's length, or holds a code that is not listed, is malformed.
//!
//! # Host to board
//!
//! | kind | message | body | answer | |
//! |---|---|---|---|---|
//! | 01 | hello | | 81 | frozen; begins a session |
//! | 02 | status | | 82 | frozen |
//! | 03 | e-stop | | 80 | frozen; safe states, latched |
//! | 04 | ping | | 84 | |
//! | 05 | describe | channel u8 | 85 | |
//! | 10 | configure | channel u8, kind u8, safe state u8, 0, min u16 µs, max u16 µs, park u16 µs, rate u32 µs/s, name 16 bytes | 80 | idle |
//! | 11 | timing | dead-man u16 ms (50..2000), telemetry u16 ms (0: none) | 80 | |
//! | 12 | clear | | 80 | idle, jogging |
//! | 13 | track | channel u8, 0, start pulse u16 µs, number of segments u16 | 80 | idle, jogging |
//! | 14 | segments | channel u8, count n u8 (1..10), first index u16, n times (duration u32 µs, end pulse u16 µs) | 80 | idle, jogging |
//! | 15 | arm | start tick u32, segments in all u16 | 80 | idle |
//! | 16 | jog | channel u8, 0, pulse u16 µs, duration u32 µs | 80 | idle, jogging |
//! | 17 | abort | | 80 | all but faulted; keeps pulses |
//! | 18 | acknowledge | fault u8 | 80 | clears that fault |
//! | 19 | goodbye | | 80 | safe states, session over; not while armed or running |
//!
//! # Board to host
//!
//! | kind | message | body |
//! |---|---|---|
//! | 80 | ack | kind answered u8, refusal u8, channel u8 (ff: none), 0, limit u32, got u32 |
//! | 81 | hello | boot id u32, segments it holds u16, channels u8, 0, firmware name 24 bytes |
//! | 82 | status | state u8, fault u8, dead-man u16 ms, tick u32, fault's tick u32, boot id u32, damaged packets u16, refused commands u16 |
//! | 84 | pong | tick u32 at which the ping's last byte came, boot id u32, state u8, fault u8 |
//! | 85 | description | as configure |
//! | 90 | telemetry | tick u32, state u8, channels n u8, n times pulse u16 µs (0: detached) |
//! | 91 | happened | occurrence u8, fault u8, tick u32 |
//!
//! Codes: [`ChannelKind`](channel::ChannelKind), [`SafeState`](channel::SafeState), [`State`](event::State),
//! [`Fault`](event::Fault), [`Refusal`](event::Refusal), [`Occurrence`](event::Occurrence).
//!
//! # Rules
//!
//! * An answer carries its question's sequence number; telemetry, happenings and the hello at start carry the board's
//!   own count.
//! * A host has one command under way, sends it again with the *same* number when no answer comes, and never takes a
//!   clock sample from a ping sent twice. The board remembers its last 8 answers since hello by number and kind: a
//!   command that comes again is not carried out again, its answer is. E-stop goes ahead of everything.
//! * A sender of another version gets an answer to the frozen messages, whose layout never changes, and to all others
//!   a refusal that names both versions.
//! * Only hello begins a session. From then on 250 ms (or as set) without a valid packet is a fault. Hello while a
//!   profile is armed or running is a fault too: a profile never outlives the host that armed it.
//! * A profile is played once; it is forgotten when it ends, by abort, fault, hello or configure.
//! * A pulse moves in straight lines, updated each millisecond from the line's start and exactly at its end, rounded to
//!   the nearest µs; segments follow each other without gaps in ticks.
//! * A detached channel keeps detached when parked; a jog attaches it at once.

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

/// Time between two packets of a host, so that several may be lost before the dead-man acts.
pub const HEARTBEAT: units::DurationMs = units::DurationMs(50);
