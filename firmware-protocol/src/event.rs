//! The messages of the board to the host.

use crate::channel::ChannelConfig;
use crate::layout::{Reader, Writer, coded};
use crate::packet::Packet;
use crate::units::{Channel, DurationMs, Name, PulseWidthUs, Sequence, Ticks};

/// Most channels of a board, chosen.
pub const MAX_CHANNELS: usize = 16;

coded! {
    /// What the board is doing.
    State {
        /// Nothing moves.
        Idle = 0, "idle";
        /// Waits for the tick at which the profile starts.
        Armed = 1, "armed";
        /// Plays the profile.
        Running = 2, "running";
        /// One or more channels move by a jog.
        Jogging = 3, "jogging";
        /// Stopped by itself; stays so until acknowledged.
        Faulted = 4, "faulted";
    }
}

coded! {
    /// Why a board stopped by itself.
    Fault {
        /// It did not.
        None = 0, "none";
        /// The host was silent for too long.
        DeadMan = 1, "dead-man: the host was silent for too long; check the cable and the host's load";
        /// The host asked for it.
        EStop = 2, "emergency stop";
        /// A host said hello in the middle of a profile.
        HostRestarted = 3, "another host session began while a profile was armed or running";
        /// The supply voltage fell.
        Supply = 4, "supply voltage too low; check the servo supply";
        /// A servo draws too much current or does not reach its angle.
        Overload = 5, "a servo is blocked or overloaded; free the mechanism";
        /// The board's watchdog had to restart it.
        Watchdog = 6, "the board's watchdog restarted it";
    }
}

coded! {
    /// Whether a command was carried out, and if not, why not. `limit` and `got` of an [`Ack`] are in the unit of what
    /// was exceeded.
    Refusal {
        /// It was.
        None = 0, "done";
        /// Kind unknown, or body not of that kind's form.
        Malformed = 1, "not a command of this protocol version";
        /// Sender's version is another: limit is the board's, got the host's.
        Version = 2, "protocol versions differ";
        /// There is no such channel: limit is their number.
        NoSuchChannel = 3, "no such channel";
        /// The channel was never configured in this start of the board.
        NotConfigured = 4, "channel is not configured";
        /// Pulse \[µs\] below the channel's limit.
        PulseTooShort = 5, "pulse is shorter than the channel's limit";
        /// Pulse \[µs\] above the channel's limit.
        PulseTooLong = 6, "pulse is longer than the channel's limit";
        /// Rate \[µs/s\] above the channel's limit.
        RateTooHigh = 7, "pulse changes faster than the channel's limit";
        /// Not in this state: got is the [`State`].
        Busy = 8, "not possible in the board's present state";
        /// A fault is latched: got is the [`Fault`].
        Latched = 9, "a fault is latched and must be acknowledged first";
        /// Start in the past or too near: limit and got are leads \[µs\], 0 for the past.
        Underflow = 10, "start tick is in the past or too near";
        /// Start too far ahead: leads \[µs\].
        TooFar = 11, "start tick is too far ahead";
        /// Channel is not at the profile's start: limit is its pulse \[µs\], 0 detached.
        NotAtStart = 12, "channel is not at the profile's start pulse; jog it there first";
        /// Segments or tracks out of order: limit is the index expected.
        OutOfOrder = 13, "profile segments are out of order";
        /// More segments than the board holds.
        NoRoom = 14, "profile has more segments than the board holds";
        /// Fewer segments than announced.
        Incomplete = 15, "profile is incomplete";
        /// Duration \[µs\] beyond the horizon of the tick.
        TooLong = 16, "profile is too long";
        /// Another fault is latched: limit is that one.
        OtherFault = 17, "another fault is latched";
        /// Limits in the wrong order, park pulse outside them, or a servo without a rate limit.
        BadLimits = 18, "channel limits contradict each other";
        /// Dead-man or telemetry time out of range: limit \[ms\].
        BadTiming = 19, "dead-man time is out of range";
        /// No host has said hello since the start, the last goodbye or the dead-man.
        NoSession = 20, "no session; say hello first";
    }
}

coded! {
    /// What happened, in a [`Event::Happened`].
    Occurrence {
        /// The profile began.
        Started = 1, "profile started";
        /// The profile ended by itself.
        Finished = 2, "profile finished";
        /// A fault was latched.
        Faulted = 3, "fault latched";
    }
}

/// Answer to a command that asks for nothing back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ack {
    /// Kind of the command answered.
    pub command: u8,
    /// Whether it was carried out.
    pub refusal: Refusal,
    /// The channel concerned, if one.
    pub channel: Option<Channel>,
    /// The limit, in the unit [`Refusal`] says; else 0.
    pub limit: u32,
    /// What was asked for, in the same unit; else 0.
    pub got: u32,
}

/// The board's identity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity {
    /// Differs after each start of the board.
    pub boot_id: u32,
    /// Number of channels, at most [`MAX_CHANNELS`].
    pub channels: u8,
    /// Segments it holds, over all channels.
    pub max_segments: u16,
    /// Name and version of the firmware.
    pub firmware: Name<24>,
}

/// The status of the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Status {
    /// What it is doing.
    pub state: State,
    /// The latched fault.
    pub fault: Fault,
    /// Longest silence of the host before the dead-man acts.
    pub dead_man: DurationMs,
    /// The present tick.
    pub now: Ticks,
    /// When the latched fault occurred; 0 without one.
    pub fault_at: Ticks,
    /// Boot id, as in [`Identity`].
    pub boot_id: u32,
    /// Damaged packets since the start, wrapping.
    pub damaged: u16,
    /// Commands refused since the start, wrapping.
    pub refused: u16,
}

/// Pulses of all channels at one tick.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Telemetry {
    /// The tick of these pulses.
    pub at: Ticks,
    /// What the board was doing.
    pub state: State,
    /// Number of channels.
    pub channels: u8,
    pulses: [Option<PulseWidthUs>; MAX_CHANNELS],
}

impl Telemetry {
    /// Pulses of `pulses.len()` channels.
    ///
    /// # Panics
    /// With more than [`MAX_CHANNELS`].
    pub fn new(at: Ticks, state: State, pulses: &[Option<PulseWidthUs>]) -> Self {
        let mut all = [None; MAX_CHANNELS];
        all[..pulses.len()].copy_from_slice(pulses);
        Self { at, state, channels: pulses.len() as u8, pulses: all }
    }

    /// Each channel's pulse; none while detached.
    pub fn pulses(&self) -> &[Option<PulseWidthUs>] {
        &self.pulses[..usize::from(self.channels)]
    }
}

impl core::fmt::Debug for Telemetry {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "at {}, {}, pulses {:?}", self.at, self.state, self.pulses())
    }
}

/// A message of the board to the host. Layouts: the table in the crate's documentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// Answers every command that has no answer of its own.
    Ack(Ack),
    /// Answers [`Hello`](crate::command::Command::Hello); also sent once, unasked, when the board starts.
    Hello(Identity),
    /// Answers [`Status`](crate::command::Command::Status).
    Status(Status),
    /// Answers [`Ping`](crate::command::Command::Ping).
    Pong {
        /// Tick at which the ping's last byte came.
        at: Ticks,
        /// Boot id, as in [`Identity`]: it reveals a restart whose hello was lost.
        boot_id: u32,
        /// What the board is doing.
        state: State,
        /// The latched fault.
        fault: Fault,
    },
    /// Answers [`Describe`](crate::command::Command::Describe).
    Description(ChannelConfig),
    /// Sent without being asked, with the period set by [`Timing`](crate::command::Command::Timing).
    Telemetry(Telemetry),
    /// Sent without being asked when something happens; only once, so that a lost packet is not repeated.
    Happened {
        /// What happened.
        occurrence: Occurrence,
        /// The fault, if it is one.
        fault: Fault,
        /// When it happened.
        at: Ticks,
    },
}

/// Kinds of the board's packets.
pub mod kind {
    #![expect(missing_docs, reason = "the table in the crate's documentation says what each is")]
    pub const ACK: u8 = 0x80;
    pub const HELLO: u8 = 0x81;
    pub const STATUS: u8 = 0x82;
    pub const PONG: u8 = 0x84;
    pub const DESCRIPTION: u8 = 0x85;
    pub const TELEMETRY: u8 = 0x90;
    pub const HAPPENED: u8 = 0x91;
}

/// The channel number that means "no channel" on the wire.
const NO_CHANNEL: u8 = 0xff;

impl Event {
    /// The event as a packet.
    pub fn encode(&self, sequence: Sequence) -> Packet {
        let body = Writer::new();
        let (kind, body) = match self {
            Self::Ack(ack) => (
                kind::ACK,
                body.u8(ack.command)
                    .u8(ack.refusal.code())
                    .u8(ack.channel.map_or(NO_CHANNEL, |c| c.0))
                    .u8(0)
                    .u32(ack.limit)
                    .u32(ack.got),
            ),
            Self::Hello(identity) => (
                kind::HELLO,
                body.u32(identity.boot_id)
                    .u16(identity.max_segments)
                    .u8(identity.channels)
                    .u8(0)
                    .bytes(identity.firmware.bytes()),
            ),
            Self::Status(status) => (
                kind::STATUS,
                body.u8(status.state.code())
                    .u8(status.fault.code())
                    .u16(status.dead_man.0)
                    .u32(status.now.0)
                    .u32(status.fault_at.0)
                    .u32(status.boot_id)
                    .u16(status.damaged)
                    .u16(status.refused),
            ),
            Self::Pong { at, boot_id, state, fault } => {
                (kind::PONG, body.u32(at.0).u32(*boot_id).u8(state.code()).u8(fault.code()))
            }
            Self::Description(config) => return config.encode(kind::DESCRIPTION, sequence),
            Self::Telemetry(telemetry) => {
                let head = body.u32(telemetry.at.0).u8(telemetry.state.code()).u8(telemetry.channels);
                let pulses = telemetry.pulses().iter();
                (kind::TELEMETRY, pulses.fold(head, |body, pulse| body.u16(pulse.map_or(0, |p| p.0))))
            }
            Self::Happened { occurrence, fault, at } => {
                (kind::HAPPENED, body.u8(occurrence.code()).u8(fault.code()).u32(at.0))
            }
        };
        Packet::new(kind, sequence, body.as_slice())
    }

    /// The event in `packet`; `None` when its kind is unknown or its body is not exactly of that kind's form.
    pub fn decode(packet: &Packet) -> Option<Self> {
        let mut body = Reader(packet.body());
        let event = match packet.kind {
            kind::ACK => {
                let (command, refusal) = (body.u8()?, Refusal::from_code(body.u8()?)?);
                let channel = match body.u8()? {
                    NO_CHANNEL => None,
                    number => Some(Channel(number)),
                };
                body.reserved()?;
                Self::Ack(Ack { command, refusal, channel, limit: body.u32()?, got: body.u32()? })
            }
            kind::HELLO => {
                let (boot_id, max_segments, channels) = (body.u32()?, body.u16()?, body.u8()?);
                body.reserved()?;
                if usize::from(channels) > MAX_CHANNELS {
                    return None;
                }
                Self::Hello(Identity {
                    boot_id,
                    max_segments,
                    channels,
                    firmware: Name::from_bytes(body.array()?)?,
                })
            }
            kind::STATUS => Self::Status(Status {
                state: State::from_code(body.u8()?)?,
                fault: Fault::from_code(body.u8()?)?,
                dead_man: DurationMs(body.u16()?),
                now: Ticks(body.u32()?),
                fault_at: Ticks(body.u32()?),
                boot_id: body.u32()?,
                damaged: body.u16()?,
                refused: body.u16()?,
            }),
            kind::PONG => Self::Pong {
                at: Ticks(body.u32()?),
                boot_id: body.u32()?,
                state: State::from_code(body.u8()?)?,
                fault: Fault::from_code(body.u8()?)?,
            },
            kind::DESCRIPTION => return ChannelConfig::decode(packet.body()).map(Self::Description),
            kind::TELEMETRY => {
                let (at, state, channels) = (Ticks(body.u32()?), State::from_code(body.u8()?)?, body.u8()?);
                let mut pulses = [None; MAX_CHANNELS];
                let used = pulses.get_mut(..usize::from(channels))?;
                for pulse in used.iter_mut() {
                    *pulse = Some(PulseWidthUs(body.u16()?)).filter(|p| p.0 != 0);
                }
                Self::Telemetry(Telemetry::new(at, state, used))
            }
            kind::HAPPENED => Self::Happened {
                occurrence: Occurrence::from_code(body.u8()?)?,
                fault: Fault::from_code(body.u8()?)?,
                at: Ticks(body.u32()?),
            },
            _ => return None,
        };
        body.end(event)
    }
}
