//! Packets on the line: framing, checksum, and finding the next packet after garbage.
//!
//! ```text
//! 00 | COBS( kind:u8 version:u8 sequence:u16 body:0..=64 crc:u16 ) | 00
//! ```
//!
//! Integers are little-endian. The checksum is CRC-16/IBM-3740 (polynomial 0x1021, start 0xFFFF, not reflected, no
//! final inversion; 0x29B1 for `123456789`) over kind to body. COBS keeps zeros out of what lies between two zeros,
//! so a zero always ends a packet. The zero in *front* ends whatever garbage came before: a packet that itself
//! arrives unharmed is always read. Nothing between two zeros is nothing, not an error.

use crate::units::Sequence;

/// Most bytes in a packet's body.
pub const MAX_BODY: usize = 64;
/// Kind, version, sequence number.
const HEADER: usize = 4;
/// Bytes of the checksum.
const CHECKSUM: usize = 2;
/// Most bytes before COBS.
const MAX_PLAIN: usize = HEADER + MAX_BODY + CHECKSUM;
/// Most bytes between the zeros.
const MAX_STUFFED: usize = cobs::max_encoding_length(MAX_PLAIN);
/// Most bytes of a packet on the line, both zeros included.
pub const MAX_PACKET: usize = MAX_STUFFED + 2;

const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

/// A packet's contents, whole and undamaged, not yet understood.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Packet {
    /// Which message: see the table in the crate's documentation.
    pub kind: u8,
    /// Protocol version of the sender.
    pub version: u8,
    /// The sender's count; an answer carries its question's.
    pub sequence: Sequence,
    body: [u8; MAX_BODY],
    length: u8,
}

impl Packet {
    /// A packet of this crate's version.
    ///
    /// # Panics
    /// When `body` is longer than [`MAX_BODY`], which no message is.
    pub fn new(kind: u8, sequence: Sequence, body: &[u8]) -> Self {
        let mut packet =
            Self { kind, version: crate::VERSION, sequence, body: [0; MAX_BODY], length: body.len() as u8 };
        packet.body[..body.len()].copy_from_slice(body);
        packet
    }

    /// The message's own bytes.
    pub fn body(&self) -> &[u8] {
        &self.body[..usize::from(self.length)]
    }

    /// The packet as it goes on the line.
    pub fn encode(&self) -> Line {
        let mut plain = [0; MAX_PLAIN];
        plain[0] = self.kind;
        plain[1] = self.version;
        plain[2..HEADER].copy_from_slice(&self.sequence.0.to_le_bytes());
        let end = HEADER + usize::from(self.length);
        plain[HEADER..end].copy_from_slice(self.body());
        let crc = CRC.checksum(&plain[..end]);
        plain[end..end + CHECKSUM].copy_from_slice(&crc.to_le_bytes());

        let mut line = Line { bytes: [0; MAX_PACKET], length: 0 };
        let stuffed = cobs::encode(&plain[..end + CHECKSUM], &mut line.bytes[1..=MAX_STUFFED]);
        line.length = stuffed + 2;
        line
    }

    /// What lies between two zeros, when it is a packet.
    fn decode(stuffed: &[u8]) -> Result<Self, Damaged> {
        let mut plain = [0; MAX_STUFFED];
        let report = cobs::decode(stuffed, &mut plain).map_err(|_| Damaged::Framing)?;
        let plain = &plain[..report.frame_size()];
        let Some(end) =
            plain.len().checked_sub(CHECKSUM).filter(|&end| (HEADER..=HEADER + MAX_BODY).contains(&end))
        else {
            return Err(Damaged::Length);
        };
        let (contents, crc) = plain.split_at(end);
        if CRC.checksum(contents).to_le_bytes() != *crc {
            return Err(Damaged::Checksum);
        }
        let mut packet = Self::new(
            contents[0],
            Sequence(u16::from_le_bytes([contents[2], contents[3]])),
            &contents[HEADER..],
        );
        packet.version = contents[1];
        Ok(packet)
    }
}

impl core::fmt::Debug for Packet {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "packet {:#04x} v{} #{} {:02x?}", self.kind, self.version, self.sequence, self.body())
    }
}

/// A packet's bytes for the line, zeros included.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    bytes: [u8; MAX_PACKET],
    length: usize,
}

impl core::ops::Deref for Line {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

/// Why the bytes between two zeros are no packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Damaged {
    /// Not COBS.
    Framing,
    /// Shorter or longer than any packet.
    Length,
    /// The checksum differs.
    Checksum,
}

/// Finds packets in a stream of bytes, whatever else is in it.
#[derive(Debug, Clone)]
pub struct Decoder {
    stuffed: [u8; MAX_STUFFED],
    length: usize,
}

impl Default for Decoder {
    fn default() -> Self {
        Self { stuffed: [0; MAX_STUFFED], length: 0 }
    }
}

impl Decoder {
    /// Takes the next byte; hands out what it ends, if anything.
    pub fn push(&mut self, byte: u8) -> Option<Result<Packet, Damaged>> {
        if byte != 0 {
            if let Some(free) = self.stuffed.get_mut(self.length) {
                *free = byte;
            }
            // Counted on beyond the buffer, so that too long a one is known as such at its end.
            self.length = self.length.saturating_add(1);
            return None;
        }
        match core::mem::take(&mut self.length) {
            0 => None,
            length => Some(self.stuffed.get(..length).ok_or(Damaged::Length).and_then(Packet::decode)),
        }
    }
}
