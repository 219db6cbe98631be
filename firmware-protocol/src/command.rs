//! The messages of the host to the board.

use crate::channel::ChannelConfig;
use crate::event::Fault;
use crate::layout::{Reader, Writer};
use crate::packet::Packet;
use crate::units::{Channel, DurationMs, DurationUs, PulseWidthUs, Sequence, Ticks};

/// Most segments in one [`Segments`] message.
pub const MAX_SEGMENTS_PER_PACKET: usize = 10;

/// One straight line of a track: from the pulse before it to `end_pulse` in `duration`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Segment {
    /// How long it takes.
    pub duration: DurationUs,
    /// Where it ends.
    pub end_pulse: PulseWidthUs,
}

/// Up to [`MAX_SEGMENTS_PER_PACKET`] consecutive segments.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct Segments {
    segments: [Segment; MAX_SEGMENTS_PER_PACKET],
    length: usize,
}

impl Segments {
    /// The segments, when they are between 1 and [`MAX_SEGMENTS_PER_PACKET`].
    pub fn new(segments: &[Segment]) -> Option<Self> {
        let mut all = Self { segments: Default::default(), length: segments.len() };
        all.segments.get_mut(..segments.len())?.copy_from_slice(segments);
        (!segments.is_empty()).then_some(all)
    }

    /// The segments, in order.
    pub fn as_slice(&self) -> &[Segment] {
        &self.segments[..self.length]
    }
}

impl core::fmt::Debug for Segments {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_list().entries(self.as_slice()).finish()
    }
}

/// A message of the host to the board. Layouts: the table in the crate's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// Begins a session and asks for the board's identity. Drops any uploaded profile and the answers stored for resent commands.
    /// While a profile is armed or running it is a fault: the host that sent it does not know of the profile.
    Hello,
    /// Asks for the board's status.
    Status,
    /// Emergency stop: every channel goes to its safe state, latched.
    EStop,
    /// Asks for the board's tick. Any valid packet keeps the dead-man from acting; this one is sent when there is no other.
    Ping,
    /// Asks for a channel's configuration.
    Describe(Channel),
    /// Configures a channel.
    Configure(ChannelConfig),
    /// Sets the dead-man's time and the period of telemetry (0: none).
    Timing {
        /// Longest silence of the host, 50 to 2000 ms.
        dead_man: DurationMs,
        /// Time between telemetry packets; 0 for none.
        telemetry: DurationMs,
    },
    /// Drops the uploaded profile.
    Clear,
    /// Announces a channel's part of the profile.
    Track {
        /// Which channel.
        channel: Channel,
        /// Its pulse when the profile starts; it must be there already.
        start_pulse: PulseWidthUs,
        /// How many segments will come.
        segments: u16,
    },
    /// The next segments of the track announced last.
    Segments {
        /// Which channel.
        channel: Channel,
        /// Index of the first of them in its track.
        first: u16,
        /// The segments.
        segments: Segments,
    },
    /// Starts the uploaded profile at a tick to come.
    Arm {
        /// When it starts.
        start: Ticks,
        /// Segments of all tracks together, as a check that nothing is missing.
        segments: u16,
    },
    /// Moves one channel, now. A detached channel goes there at once, since its position is not known.
    Jog {
        /// Which channel.
        channel: Channel,
        /// Pulse at the end.
        pulse: PulseWidthUs,
        /// How long it takes.
        duration: DurationUs,
    },
    /// Ends profile and jogs; every channel keeps the pulse it has. Not a fault.
    Abort,
    /// Clears a latched fault, which is named so that no other one is cleared by mistake.
    Acknowledge(Fault),
    /// The host leaves: every channel goes to its safe state, nothing is latched, the dead-man is off. Refused while a
    /// profile is armed or running.
    Goodbye,
}

/// Kinds of the host's packets.
pub mod kind {
    #![expect(missing_docs, reason = "the table in the crate's documentation says what each is")]
    pub const HELLO: u8 = 0x01;
    pub const STATUS: u8 = 0x02;
    pub const E_STOP: u8 = 0x03;
    pub const PING: u8 = 0x04;
    pub const DESCRIBE: u8 = 0x05;
    pub const CONFIGURE: u8 = 0x10;
    pub const TIMING: u8 = 0x11;
    pub const CLEAR: u8 = 0x12;
    pub const TRACK: u8 = 0x13;
    pub const SEGMENTS: u8 = 0x14;
    pub const ARM: u8 = 0x15;
    pub const JOG: u8 = 0x16;
    pub const ABORT: u8 = 0x17;
    pub const ACKNOWLEDGE: u8 = 0x18;
    pub const GOODBYE: u8 = 0x19;
}

impl Command {
    /// Its kind on the wire.
    pub const fn kind(&self) -> u8 {
        match self {
            Self::Hello => kind::HELLO,
            Self::Status => kind::STATUS,
            Self::EStop => kind::E_STOP,
            Self::Ping => kind::PING,
            Self::Describe(_) => kind::DESCRIBE,
            Self::Configure(_) => kind::CONFIGURE,
            Self::Timing { .. } => kind::TIMING,
            Self::Clear => kind::CLEAR,
            Self::Track { .. } => kind::TRACK,
            Self::Segments { .. } => kind::SEGMENTS,
            Self::Arm { .. } => kind::ARM,
            Self::Jog { .. } => kind::JOG,
            Self::Abort => kind::ABORT,
            Self::Acknowledge(_) => kind::ACKNOWLEDGE,
            Self::Goodbye => kind::GOODBYE,
        }
    }

    /// Whether commands of this kind keep their meaning and layout in every version of the protocol.
    pub const fn is_frozen(kind: u8) -> bool {
        matches!(kind, kind::HELLO | kind::STATUS | kind::E_STOP)
    }

    /// The command as a packet.
    pub fn encode(&self, sequence: Sequence) -> Packet {
        let body = Writer::new();
        let body = match self {
            Self::Hello
            | Self::Status
            | Self::EStop
            | Self::Ping
            | Self::Clear
            | Self::Abort
            | Self::Goodbye => body,
            Self::Describe(channel) => body.u8(channel.0),
            Self::Configure(config) => config.write(body),
            Self::Timing { dead_man, telemetry } => body.u16(dead_man.0).u16(telemetry.0),
            Self::Track { channel, start_pulse, segments } => {
                body.u8(channel.0).u8(0).u16(start_pulse.0).u16(*segments)
            }
            Self::Segments { channel, first, segments } => {
                let head = body.u8(channel.0).u8(segments.length as u8).u16(*first);
                segments.as_slice().iter().fold(head, |body, s| body.u32(s.duration.0).u16(s.end_pulse.0))
            }
            Self::Arm { start, segments } => body.u32(start.0).u16(*segments),
            Self::Jog { channel, pulse, duration } => body.u8(channel.0).u8(0).u16(pulse.0).u32(duration.0),
            Self::Acknowledge(fault) => body.u8(fault.code()),
        };
        Packet::new(self.kind(), sequence, body.as_slice())
    }

    /// The command in `packet`; `None` when its kind is unknown or its body is not exactly of that kind's form.
    pub fn decode(packet: &Packet) -> Option<Self> {
        let mut body = Reader(packet.body());
        let command = match packet.kind {
            kind::HELLO => Self::Hello,
            kind::STATUS => Self::Status,
            kind::E_STOP => Self::EStop,
            kind::PING => Self::Ping,
            kind::DESCRIBE => Self::Describe(Channel(body.u8()?)),
            kind::CONFIGURE => Self::Configure(ChannelConfig::read(&mut body)?),
            kind::TIMING => {
                Self::Timing { dead_man: DurationMs(body.u16()?), telemetry: DurationMs(body.u16()?) }
            }
            kind::CLEAR => Self::Clear,
            kind::TRACK => {
                let channel = Channel(body.u8()?);
                body.reserved()?;
                Self::Track { channel, start_pulse: PulseWidthUs(body.u16()?), segments: body.u16()? }
            }
            kind::SEGMENTS => {
                let (channel, count, first) = (Channel(body.u8()?), body.u8()?, body.u16()?);
                let mut all = [Segment::default(); MAX_SEGMENTS_PER_PACKET];
                let used = all.get_mut(..usize::from(count))?;
                for segment in used.iter_mut() {
                    *segment =
                        Segment { duration: DurationUs(body.u32()?), end_pulse: PulseWidthUs(body.u16()?) };
                }
                Self::Segments { channel, first, segments: Segments::new(used)? }
            }
            kind::ARM => Self::Arm { start: Ticks(body.u32()?), segments: body.u16()? },
            kind::JOG => {
                let channel = Channel(body.u8()?);
                body.reserved()?;
                Self::Jog { channel, pulse: PulseWidthUs(body.u16()?), duration: DurationUs(body.u32()?) }
            }
            kind::ABORT => Self::Abort,
            kind::ACKNOWLEDGE => Self::Acknowledge(Fault::from_code(body.u8()?)?),
            kind::GOODBYE => Self::Goodbye,
            _ => return None,
        };
        body.end(command)
    }
}
