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

/// Most bytes in a packet's body, chosen.
pub const MAX_BODY_BYTES: usize = 64;
/// Bytes of the header: kind, version, sequence number.
const HEADER_BYTES: usize = 4;
/// Bytes of the checksum.
const CHECKSUM_BYTES: usize = 2;
/// Most bytes before COBS.
const MAX_PLAIN_BYTES: usize = HEADER_BYTES + MAX_BODY_BYTES + CHECKSUM_BYTES;
/// Most bytes between the zeros.
const MAX_STUFFED_BYTES: usize = cobs::max_encoding_length(MAX_PLAIN_BYTES);
/// Most bytes of a packet on the line, both zeros included.
pub const MAX_PACKET_BYTES: usize = MAX_STUFFED_BYTES + 2;

/// The checksum: CRC-16/IBM-3740.
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
    body: [u8; MAX_BODY_BYTES],
    length: u8,
}

impl Packet {
    /// A packet of this crate's version.
    ///
    /// # Panics
    /// When `body` is longer than [`MAX_BODY_BYTES`], which no message is.
    pub fn new(kind: u8, sequence: Sequence, body: &[u8]) -> Self {
        let mut packet = Self {
            kind,
            version: crate::VERSION,
            sequence,
            body: [0; MAX_BODY_BYTES],
            length: body.len() as u8,
        };
        packet.body[..body.len()].copy_from_slice(body);
        packet
    }

    /// The message's own bytes.
    pub fn body(&self) -> &[u8] {
        &self.body[..usize::from(self.length)]
    }

    /// The packet as it goes on the line.
    pub fn encode(&self) -> Line {
        let mut plain = [0; MAX_PLAIN_BYTES];
        plain[0] = self.kind;
        plain[1] = self.version;
        plain[2..HEADER_BYTES].copy_from_slice(&self.sequence.0.to_le_bytes());
        let end = HEADER_BYTES + usize::from(self.length);
        plain[HEADER_BYTES..end].copy_from_slice(self.body());
        let crc = CRC.checksum(&plain[..end]);
        plain[end..end + CHECKSUM_BYTES].copy_from_slice(&crc.to_le_bytes());

        let mut line = Line { bytes: [0; MAX_PACKET_BYTES], length: 0 };
        let stuffed = cobs::encode(&plain[..end + CHECKSUM_BYTES], &mut line.bytes[1..=MAX_STUFFED_BYTES]);
        line.length = stuffed + 2;
        line
    }

    /// Decodes the bytes between two zeros.
    fn decode(stuffed: &[u8]) -> Result<Self, Damaged> {
        let mut plain = [0; MAX_STUFFED_BYTES];
        let report = cobs::decode(stuffed, &mut plain).map_err(|_| Damaged::Framing)?;
        let plain = &plain[..report.frame_size()];
        let Some(end) = plain
            .len()
            .checked_sub(CHECKSUM_BYTES)
            .filter(|&end| (HEADER_BYTES..=HEADER_BYTES + MAX_BODY_BYTES).contains(&end))
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
            &contents[HEADER_BYTES..],
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
    bytes: [u8; MAX_PACKET_BYTES],
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
    stuffed: [u8; MAX_STUFFED_BYTES],
    length: usize,
}

impl Default for Decoder {
    fn default() -> Self {
        Self { stuffed: [0; MAX_STUFFED_BYTES], length: 0 }
    }
}

impl Decoder {
    /// Takes the next byte; returns the packet that it ends, if it ends one.
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
