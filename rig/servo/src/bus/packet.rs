//! Packets of both protocols: bytes from and to instruction and status.
//!
//! Dynamixel protocol 2.0 is `FF FF FD 00, id, length, instruction, parameters, CRC`; `FF FF FD` among instruction and parameters gets
//! another `FD` behind it. Feetech's STS speak Dynamixel's older form, `FF FF, id, length, instruction or error, parameters, checksum`.
//!
//! # Source
//! ROBOTIS e-manual, "DYNAMIXEL Protocol 2.0" (<https://emanual.robotis.com/docs/en/dxl/protocol2/>) and "CRC Calculation"
//! (<https://emanual.robotis.com/docs/en/dxl/crc/>); Feetech, "Servo SCS Communication Protocol". Their worked examples are the tests.

use crc::{CRC_16_UMTS, Crc};

/// To all servos at once, none of which answers.
pub const BROADCAST: u8 = 0xFE;

/// The checksum of protocol 2.0: polynomial 0x8005, initial value 0, nothing reflected.
const CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_UMTS);
/// The header of a packet in Dynamixel's protocol 2.0.
const DYNAMIXEL2_HEADER: [u8; 4] = [0xFF, 0xFF, 0xFD, 0x00];
/// The header of a packet in Feetech's protocol.
const FEETECH_HEADER: [u8; 2] = [0xFF, 0xFF];
/// Longest packet that is believed \[bytes\], chosen: no servo sends half of this, so longer ones are noise.
const MAX_PACKET_BYTES: usize = 256;

/// Codes of the instructions, alike in both protocols.
pub mod instruction {
    /// Asks whether a servo is there.
    pub const PING: u8 = 0x01;
    /// Asks for registers.
    pub const READ: u8 = 0x02;
    /// Sets registers.
    pub const WRITE: u8 = 0x03;
    /// Asks several servos for the same registers.
    pub const SYNC_READ: u8 = 0x82;
    /// Sets the same registers of several servos.
    pub const SYNC_WRITE: u8 = 0x83;
    /// An answer, in protocol 2.0 only.
    pub const STATUS: u8 = 0x55;
}

/// Which protocol a bus speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Protocol {
    /// Dynamixel protocol 2.0.
    Dynamixel2,
    /// Feetech's, for its servos with a magnetic encoder (low byte first).
    Feetech,
}

/// The content of a packet between header and checksum, without byte stuffing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packet {
    /// ID of the servo that it is for, or from.
    pub id: u8,
    /// The instruction; in a status of Feetech's protocol the error.
    pub code: u8,
    /// The parameters, without stuffing.
    pub parameters: Vec<u8>,
}

/// A servo's answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Status {
    /// ID of the servo that answers.
    pub id: u8,
    /// Protocol 2.0: number of an error, and bit 7 for an alert; Feetech: bits of what is wrong.
    pub error: u8,
    /// The registers asked for.
    pub data: Vec<u8>,
}

/// A packet whose checksum is wrong, or whose length cannot be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Damaged;

impl Protocol {
    /// An instruction to `id` about the registers from `address` on.
    fn addressed(self, id: u8, code: u8, address: u16, rest: impl IntoIterator<Item = u8>) -> Packet {
        let mut parameters = match self {
            Self::Dynamixel2 => address.to_le_bytes().to_vec(),
            // All registers of these servos are below 256.
            Self::Feetech => vec![address as u8],
        };
        parameters.extend(rest);
        Packet { id, code, parameters }
    }

    fn length(self, length: u8) -> Vec<u8> {
        match self {
            Self::Dynamixel2 => vec![length, 0],
            Self::Feetech => vec![length],
        }
    }

    /// Asks whether `id` is there.
    pub fn ping(self, id: u8) -> Packet {
        Packet { id, code: instruction::PING, parameters: Vec::new() }
    }

    /// Asks `id` for `length` registers from `address` on.
    pub fn read(self, id: u8, address: u16, length: u8) -> Packet {
        self.addressed(id, instruction::READ, address, self.length(length))
    }

    /// Sets registers of `id` from `address` on.
    pub fn write(self, id: u8, address: u16, data: &[u8]) -> Packet {
        self.addressed(id, instruction::WRITE, address, data.iter().copied())
    }

    /// Asks all of `ids` for `length` registers from `address` on; they answer in this order.
    pub fn sync_read(self, ids: &[u8], address: u16, length: u8) -> Packet {
        let rest = self.length(length).into_iter().chain(ids.iter().copied());
        self.addressed(BROADCAST, instruction::SYNC_READ, address, rest)
    }

    /// Sets `length` registers of each servo from `address` on. Nobody answers.
    pub fn sync_write(self, address: u16, length: u8, data: &[(u8, Vec<u8>)]) -> Packet {
        let each = data.iter().flat_map(|(id, bytes)| std::iter::once(*id).chain(bytes.iter().copied()));
        self.addressed(
            BROADCAST,
            instruction::SYNC_WRITE,
            address,
            self.length(length).into_iter().chain(each),
        )
    }

    /// An answer as a servo sends it.
    pub fn status(self, status: &Status) -> Packet {
        match self {
            Self::Dynamixel2 => {
                let parameters = std::iter::once(status.error).chain(status.data.iter().copied()).collect();
                Packet { id: status.id, code: instruction::STATUS, parameters }
            }
            Self::Feetech => Packet { id: status.id, code: status.error, parameters: status.data.clone() },
        }
    }

    /// A packet as an answer; none where it is an instruction. Feetech's protocol does not say which it is.
    pub fn as_status(self, packet: Packet) -> Option<Status> {
        let Packet { id, code, parameters } = packet;
        match self {
            Self::Dynamixel2 => {
                let (&error, data) = parameters.split_first().filter(|_| code == instruction::STATUS)?;
                Some(Status { id, error, data: data.to_vec() })
            }
            Self::Feetech => Some(Status { id, error: code, data: parameters }),
        }
    }

    /// The bytes to send.
    pub fn encode(self, packet: &Packet) -> Vec<u8> {
        match self {
            Self::Dynamixel2 => {
                let mut body = vec![packet.code];
                body.extend(&packet.parameters);
                let body = stuffed(&body);
                let mut bytes = DYNAMIXEL2_HEADER.to_vec();
                bytes.push(packet.id);
                bytes.extend((body.len() as u16 + 2).to_le_bytes());
                bytes.extend(body);
                bytes.extend(CRC.checksum(&bytes).to_le_bytes());
                bytes
            }
            Self::Feetech => {
                let mut bytes = FEETECH_HEADER.to_vec();
                bytes.extend([packet.id, packet.parameters.len() as u8 + 2, packet.code]);
                bytes.extend(&packet.parameters);
                bytes.push(checksum(&bytes[2..]));
                bytes
            }
        }
    }
}

/// The complement of the sum's low byte.
fn checksum(bytes: &[u8]) -> u8 {
    !bytes.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte))
}

fn stuffed(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len() + 2);
    for &byte in bytes {
        out.push(byte);
        if out.ends_with(&DYNAMIXEL2_HEADER[..3]) {
            out.push(0xFD);
        }
    }
    out
}

fn unstuffed(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len());
    let mut place = 0;
    while place < bytes.len() {
        out.push(bytes[place]);
        // The byte behind the pattern is the stuffing.
        let ends = place >= 2 && bytes[place - 2..=place] == DYNAMIXEL2_HEADER[..3];
        place += if ends { 2 } else { 1 };
    }
    out
}

/// Finds packets in whatever bytes come.
#[derive(Debug)]
pub struct Decoder {
    protocol: Protocol,
    waiting: Vec<u8>,
}

impl Decoder {
    /// A decoder for a line on which nothing was received yet.
    pub fn new(protocol: Protocol) -> Self {
        Self { protocol, waiting: Vec::new() }
    }

    /// Forgets half a packet.
    pub fn reset(&mut self) {
        self.waiting.clear();
    }

    /// Takes in bytes; the packets that they complete, in order. A damaged one costs its first byte only, so that a whole one
    /// behind it is found.
    pub fn receive(&mut self, bytes: &[u8]) -> Vec<Result<Packet, Damaged>> {
        self.waiting.extend(bytes);
        let mut found = Vec::new();
        while let Some((packet, taken)) = self.first() {
            self.waiting.drain(..taken);
            found.extend(packet);
        }
        found
    }

    /// The packet at the beginning, if there is one, and how many bytes to remove; `None` until more bytes come.
    fn first(&self) -> Option<(Option<Result<Packet, Damaged>>, usize)> {
        let bytes = &self.waiting[..];
        let header: &[u8] = match self.protocol {
            Protocol::Dynamixel2 => &DYNAMIXEL2_HEADER,
            Protocol::Feetech => &FEETECH_HEADER,
        };
        if bytes.is_empty() {
            return None;
        }
        let begins = bytes.iter().zip(header).all(|(a, b)| a == b);
        if !begins {
            return Some((None, 1));
        }
        let id_at = header.len();
        let (&id, length_at) = (bytes.get(id_at)?, id_at + 1);
        let (length, start) = match self.protocol {
            Protocol::Dynamixel2 => {
                let length = bytes.get(length_at..length_at + 2)?;
                (usize::from(u16::from_le_bytes([length[0], length[1]])), length_at + 2)
            }
            Protocol::Feetech => (usize::from(*bytes.get(length_at)?), length_at + 1),
        };
        let least = if self.protocol == Protocol::Dynamixel2 { 3 } else { 2 };
        if id == 0xFF || !(least..=MAX_PACKET_BYTES).contains(&length) {
            // FF FF FF: the header may begin one byte later
            return Some((None, 1));
        }
        let whole = bytes.get(..start + length)?;
        let (content, sum) = whole.split_at(whole.len() - least + 1);
        let right = match self.protocol {
            Protocol::Dynamixel2 => CRC.checksum(content).to_le_bytes() == sum,
            Protocol::Feetech => [checksum(&content[2..])] == sum,
        };
        if !right {
            return Some((Some(Err(Damaged)), 1));
        }
        let body = match self.protocol {
            Protocol::Dynamixel2 => unstuffed(&content[start..]),
            Protocol::Feetech => content[start..].to_vec(),
        };
        let (&code, parameters) = body.split_first()?;
        Some((Some(Ok(Packet { id, code, parameters: parameters.to_vec() })), whole.len()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bytes(hex: &str) -> Vec<u8> {
        hex.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
    }

    fn decoded(protocol: Protocol, hex: &str) -> Packet {
        let mut found = Decoder::new(protocol).receive(&bytes(hex));
        assert_eq!(found.len(), 1, "{hex}");
        found.pop().unwrap().unwrap()
    }

    /// What the makers' manuals show: the packet as made here gives their bytes, and their bytes give it back.
    fn published(protocol: Protocol, packet: &Packet, hex: &str) {
        assert_eq!(protocol.encode(packet), bytes(hex), "{packet:?}");
        assert_eq!(&decoded(protocol, hex), packet);
    }

    #[test]
    fn packets_are_those_of_the_robotis_manual() {
        let dynamixel = Protocol::Dynamixel2;
        let packet = |packet, hex| published(dynamixel, &packet, hex);
        packet(dynamixel.ping(1), "FF FF FD 00 01 03 00 01 19 4E");
        packet(dynamixel.ping(BROADCAST), "FF FF FD 00 FE 03 00 01 31 42");
        packet(dynamixel.read(1, 132, 4), "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15");
        packet(
            dynamixel.write(1, 116, &512u32.to_le_bytes()),
            "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
        );
        packet(dynamixel.sync_read(&[1, 2], 132, 4), "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA");
        let goals = [(1, 150u32.to_le_bytes().to_vec()), (2, 170u32.to_le_bytes().to_vec())];
        packet(
            dynamixel.sync_write(116, 4, &goals),
            "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
        );
        for (id, error, data, hex) in [
            (1, 0, "06 04 26", "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D"),
            (2, 0, "06 04 26", "FF FF FD 00 02 07 00 55 00 06 04 26 6F 6D"),
            (1, 0, "A6 00 00 00", "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0"),
            (2, 0, "1F 08 00 00", "FF FF FD 00 02 08 00 55 00 1F 08 00 00 BA BE"),
            (1, 0, "", "FF FF FD 00 01 04 00 55 00 A1 0C"),
        ] {
            let status = Status { id, error, data: bytes(data) };
            packet(dynamixel.status(&status), hex);
            assert_eq!(dynamixel.as_status(decoded(dynamixel, hex)), Some(status));
        }
        assert_eq!(dynamixel.as_status(dynamixel.ping(1)), None, "an echo is no answer");
    }

    #[test]
    fn packets_are_those_of_the_feetech_manual() {
        let feetech = Protocol::Feetech;
        let packet = |packet, hex| published(feetech, &packet, hex);
        packet(feetech.ping(1), "FF FF 01 02 01 FB");
        packet(feetech.read(1, 0x38, 2), "FF FF 01 04 02 38 02 BE");
        packet(feetech.write(BROADCAST, 5, &[1]), "FF FF FE 04 03 05 01 F4");
        packet(feetech.write(1, 0x2A, &bytes("00 08 00 00 E8 03")), "FF FF 01 09 03 2A 00 08 00 00 E8 03 D5");
        packet(feetech.sync_read(&[1, 2], 0x38, 8), "FF FF FE 06 82 38 08 01 02 36");
        let goals: Vec<_> = (1..=4).map(|id| (id, bytes("00 08 00 00 E8 03"))).collect();
        packet(
            feetech.sync_write(0x2A, 6, &goals),
            "FF FF FE 20 83 2A 06 01 00 08 00 00 E8 03 02 00 08 00 00 E8 03 03 00 08 00 00 E8 03 04 00 08 00 00 E8 03 58",
        );
        for (id, data, hex) in [
            (1, "", "FF FF 01 02 00 FC"),
            (1, "18 05", "FF FF 01 04 00 18 05 DD"),
            (1, "00 08 00 00 00 00 79 1E", "FF FF 01 0A 00 00 08 00 00 00 00 79 1E 55"),
            (2, "FF 07 00 00 00 00 77 23", "FF FF 02 0A 00 FF 07 00 00 00 00 77 23 53"),
        ] {
            packet(feetech.status(&Status { id, error: 0, data: bytes(data) }), hex);
        }
    }

    #[test]
    fn headers_among_the_parameters_are_stuffed_as_the_manual_says() {
        let dynamixel = Protocol::Dynamixel2;
        let write = dynamixel.write(1, 116, &bytes("FF FF FD 00"));
        let sent = dynamixel.encode(&write);
        assert_eq!(sent[5..7], [10, 0], "the length counts the byte put in");
        assert_eq!(sent[8..15], bytes("74 00 FF FF FD FD 00"));
        let mut decoder = Decoder::new(dynamixel);
        assert_eq!(decoder.receive(&sent), [Ok(write)]);
    }

    proptest! {
        #[test]
        fn whatever_is_sent_is_received_in_any_pieces_between_any_noise(
            parameters in prop::collection::vec(prop_oneof![Just(0xFF), Just(0xFD), any::<u8>()], 0..60),
            noise in prop::collection::vec(0u8..0xFF, 0..20), pieces in 1..9usize, old in any::<bool>(),
        ) {
            let protocol = if old { Protocol::Feetech } else { Protocol::Dynamixel2 };
            let packet = Packet { id: 3, code: instruction::WRITE, parameters };
            let mut line = noise.clone();
            line.extend(protocol.encode(&packet));
            line.extend(&noise);
            let mut decoder = Decoder::new(protocol);
            let found: Vec<_> = line.chunks(pieces).flat_map(|piece| decoder.receive(piece)).collect();
            prop_assert_eq!(found, [Ok(packet)]);
        }

        #[test]
        fn no_bytes_make_the_decoder_panic_or_hoard(
            bytes in prop::collection::vec(prop_oneof![Just(0xFF), Just(0xFD), Just(0u8), any::<u8>()], 0..600),
            old in any::<bool>(),
        ) {
            let mut decoder = Decoder::new(if old { Protocol::Feetech } else { Protocol::Dynamixel2 });
            decoder.receive(&bytes);
            prop_assert!(decoder.waiting.len() <= MAX_PACKET_BYTES + 7);
        }
    }

    #[test]
    fn every_flipped_bit_is_noticed() {
        for protocol in [Protocol::Dynamixel2, Protocol::Feetech] {
            let whole = protocol.encode(&protocol.write(1, 42, &[1, 2, 3, 4]));
            for bit in 0..whole.len() * 8 {
                let mut flipped = whole.clone();
                flipped[bit / 8] ^= 1 << (bit % 8);
                let found = Decoder::new(protocol).receive(&flipped);
                assert!(found.iter().all(Result::is_err), "{protocol:?}, bit {bit}: {found:?}");
            }
        }
    }
}
