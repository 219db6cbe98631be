//! The configuration of a board's channel: what it drives, its limits and its safe state. Sent in both directions.

use crate::layout::{Reader, Writer, coded};
use crate::packet::Packet;
use crate::units::{Channel, Name, PulseWidthUs, RateUsPerS, Sequence};

coded! {
    /// What a channel drives.
    ChannelKind {
        /// A servo: its pulse is an angle, its rate limited.
        Servo = 0, "servo";
        /// The device that holds the mechanism until a release.
        Release = 1, "release actuator";
        /// A lamp in view of the camera: lit at its greatest pulse, dark at its least.
        SyncLed = 2, "sync LED";
    }
}

coded! {
    /// What a channel does when the board stops by itself.
    SafeState {
        /// No pulse: a servo goes limp. What hangs from it keeps still; what stands on it falls.
        Detach = 0, "detach";
        /// Keeps the pulse that it had: a servo stays where it is.
        Hold = 1, "hold";
        /// Goes to the park pulse, at no more than the greatest rate, and stays there.
        Park = 2, "park";
    }
}

/// A channel's limits and safe state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChannelConfig {
    /// Which channel.
    pub channel: Channel,
    /// What it drives.
    pub kind: ChannelKind,
    /// What it does when the board stops by itself.
    pub safe_state: SafeState,
    /// Shortest pulse.
    pub min_pulse: PulseWidthUs,
    /// Longest pulse.
    pub max_pulse: PulseWidthUs,
    /// Pulse for [`SafeState::Park`]; within the limits whatever the safe state.
    pub park_pulse: PulseWidthUs,
    /// Fastest change of the pulse; 0 for steps (refused for a servo).
    pub max_rate: RateUsPerS,
    /// Name in messages.
    pub name: Name<16>,
}

impl ChannelConfig {
    pub(crate) fn write(&self, body: Writer) -> Writer {
        body.u8(self.channel.0)
            .u8(self.kind.code())
            .u8(self.safe_state.code())
            .u8(0)
            .u16(self.min_pulse.0)
            .u16(self.max_pulse.0)
            .u16(self.park_pulse.0)
            .u32(self.max_rate.0)
            .bytes(self.name.bytes())
    }

    pub(crate) fn read(body: &mut Reader<'_>) -> Option<Self> {
        let channel = Channel(body.u8()?);
        let kind = ChannelKind::from_code(body.u8()?)?;
        let safe_state = SafeState::from_code(body.u8()?)?;
        body.reserved()?;
        Some(Self {
            channel,
            kind,
            safe_state,
            min_pulse: PulseWidthUs(body.u16()?),
            max_pulse: PulseWidthUs(body.u16()?),
            park_pulse: PulseWidthUs(body.u16()?),
            max_rate: RateUsPerS(body.u32()?),
            name: Name::from_bytes(body.array()?)?,
        })
    }

    pub(crate) fn encode(&self, kind: u8, sequence: Sequence) -> Packet {
        Packet::new(kind, sequence, self.write(Writer::new()).as_slice())
    }

    pub(crate) fn decode(body: &[u8]) -> Option<Self> {
        let mut body = Reader(body);
        let config = Self::read(&mut body)?;
        body.end(config)
    }
}
