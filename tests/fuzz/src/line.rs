//! What comes over a serial line.

use firmware_protocol::command::Command;
use firmware_protocol::event::Event;
use firmware_protocol::packet::{Decoder, Packet};
use servo::bus::packet::{self as bus_packet, Protocol};

fn packets(bytes: &[u8]) -> Vec<Packet> {
    let mut decoder = Decoder::default();
    bytes.iter().filter_map(|&byte| decoder.push(byte)).filter_map(Result::ok).collect()
}

/// Packets between host and board: what is read and sent again is read as the same, and no garbage hides a packet behind it.
pub(crate) fn wire(bytes: &[u8]) -> bool {
    let found = packets(bytes);
    for &packet in &found {
        // a packet of another version keeps it
        assert_eq!(packets(&packet.encode()), [packet]);
        if let Some(command) = Command::decode(&packet) {
            assert_eq!(Command::decode(&command.encode(packet.sequence)), Some(command));
        }
        if let Some(event) = Event::decode(&packet) {
            assert_eq!(Event::decode(&event.encode(packet.sequence)), Some(event));
        }
    }
    let stop = Command::EStop.encode(firmware_protocol::units::Sequence(7));
    let line = [bytes, &stop.encode()].concat();
    assert_eq!(packets(&line).last(), Some(&stop), "a stop behind garbage is heard");
    !found.is_empty()
}

/// Packets of servos on a bus, by both protocols: the same in any pieces, and what is read and sent again is read as the same.
pub(crate) fn bus(bytes: &[u8]) -> bool {
    let mut has_packet = false;
    for protocol in [Protocol::Dynamixel2, Protocol::Feetech] {
        let whole = bus_packet::Decoder::new(protocol).receive(bytes);
        let mut decoder = bus_packet::Decoder::new(protocol);
        let single: Vec<_> = bytes.iter().flat_map(|&byte| decoder.receive(&[byte])).collect();
        assert_eq!(whole, single);
        for packet in whole.into_iter().flatten() {
            let again = bus_packet::Decoder::new(protocol).receive(&protocol.encode(&packet));
            assert_eq!(again, [Ok(packet)]);
            has_packet = true;
        }
    }
    has_packet
}
