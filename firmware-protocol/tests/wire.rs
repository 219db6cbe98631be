//! Bytes on the line: pinned, and found again after whatever else was on it.

#![expect(clippy::unwrap_used, reason = "a test may")]

use firmware_protocol::channel::{ChannelConfig, ChannelKind, SafeState};
use firmware_protocol::command::{Command, MAX_SEGMENTS_PER_PACKET, Segment, Segments};
use firmware_protocol::event::{
    Ack, Event, Fault, Identity, MAX_CHANNELS, Occurrence, Refusal, State, Status, Telemetry,
};
use firmware_protocol::packet::{Decoder, MAX_PACKET_BYTES, Packet};
use firmware_protocol::units::{
    Channel, DurationMs, DurationUs, Name, PulseWidthUs, RateUsPerS, Sequence, Ticks,
};
use proptest::prelude::*;

fn decode(bytes: &[u8]) -> Vec<Packet> {
    let mut decoder = Decoder::default();
    bytes.iter().filter_map(|&byte| decoder.push(byte)).filter_map(Result::ok).collect()
}

fn segments(count: usize) -> Segments {
    let all: Vec<_> = (0..count)
        .map(|i| Segment {
            duration: DurationUs(1_000_000 * (1 + i as u32 % 2)),
            end_pulse: PulseWidthUs(1100 + 80 * i as u16),
        })
        .collect();
    Segments::new(&all).unwrap()
}

fn channel() -> ChannelConfig {
    ChannelConfig {
        channel: Channel(1),
        kind: ChannelKind::Servo,
        safe_state: SafeState::Park,
        min_pulse: PulseWidthUs(800),
        max_pulse: PulseWidthUs(2200),
        park_pulse: PulseWidthUs(1500),
        max_rate: RateUsPerS(4000),
        name: Name::new("base").unwrap(),
    }
}

fn commands() -> Vec<Command> {
    use Command::*;
    vec![
        Hello,
        Status,
        EStop,
        Ping,
        Describe(Channel(1)),
        Configure(channel()),
        Timing { dead_man: DurationMs(250), telemetry: DurationMs(20) },
        Clear,
        Track { channel: Channel(1), start_pulse: PulseWidthUs(1500), segments: 258 },
        Segments { channel: Channel(1), first: 0, segments: segments(1) },
        Segments { channel: Channel(1), first: 10, segments: segments(MAX_SEGMENTS_PER_PACKET) },
        Arm { start: Ticks(0x0102_0304), segments: 258 },
        Jog { channel: Channel(0), pulse: PulseWidthUs(1500), duration: DurationUs(500_000) },
        Abort,
        Acknowledge(Fault::DeadMan),
        Goodbye,
    ]
}

fn events() -> Vec<Event> {
    let ack = |refusal, channel, limit, got| Event::Ack(Ack { command: 0x16, refusal, channel, limit, got });
    let mut all = vec![
        ack(Refusal::None, None, 0, 0),
        ack(Refusal::PulseTooLong, Some(Channel(1)), 2200, 2300),
        Event::Hello(Identity {
            boot_id: 0xdead_beef,
            channels: 16,
            max_segments: 1024,
            firmware: Name::new("rig mock 1").unwrap(),
        }),
        Event::Status(Status {
            state: State::Faulted,
            fault: Fault::DeadMan,
            dead_man: DurationMs(250),
            now: Ticks(0xffff_ff00),
            fault_at: Ticks(0xffff_0000),
            boot_id: 0xdead_beef,
            damaged: 3,
            refused: 1,
        }),
        Event::Pong { at: Ticks(0), boot_id: 0xdead_beef, state: State::Running, fault: Fault::None },
        Event::Description(channel()),
        Event::Telemetry(Telemetry::new(
            Ticks(1000),
            State::Running,
            &[Some(PulseWidthUs(1500)), None, Some(PulseWidthUs(900))],
        )),
        Event::Telemetry(Telemetry::new(Ticks(1000), State::Idle, &[Some(PulseWidthUs(1500)); MAX_CHANNELS])),
        Event::Happened { occurrence: Occurrence::Started, fault: Fault::None, at: Ticks(7) },
        Event::Happened { occurrence: Occurrence::Faulted, fault: Fault::EStop, at: Ticks(8) },
    ];
    all.extend(Refusal::ALL.iter().map(|&refusal| ack(refusal, None, 1, 2)));
    all.extend(Fault::ALL.iter().map(|&fault| Event::Pong {
        at: Ticks(1),
        boot_id: 1,
        state: State::Faulted,
        fault,
    }));
    all
}

/// Every message with the direction it goes, its packet and its meaning in words.
fn messages() -> Vec<(&'static str, Packet, String)> {
    let commands = commands().into_iter().zip(1..).map(|(command, n)| {
        let packet = command.encode(Sequence(n));
        assert_eq!(Command::decode(&packet), Some(command));
        (">", packet, format!("{command:?}"))
    });
    let events = events().into_iter().zip(0xff00..).map(|(event, n)| {
        let packet = event.encode(Sequence(n));
        assert_eq!(Event::decode(&packet), Some(event));
        ("<", packet, format!("{event:?}"))
    });
    commands.chain(events).collect()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

fn unhex(text: &str) -> Vec<u8> {
    (0..text.len()).step_by(2).map(|i| u8::from_str_radix(&text[i..i + 2], 16).unwrap()).collect()
}

/// These bytes are what firmware in the field speaks. A test that fails here means a new protocol version, not a new
/// expectation. The bytes come from an independent encoder (Python's `binascii.crc_hqx` and a split at zeros).
#[test]
fn bytes_of_version_1_stay_as_they_are() {
    let line = |command: Command| hex(&command.encode(Sequence(0x0201)).encode());
    assert_eq!(line(Command::Hello), "00070101010237d600");
    assert_eq!(line(Command::EStop), "0007030101025f3b00");
    assert_eq!(
        line(Command::Jog { channel: Channel(2), pulse: PulseWidthUs(1500), duration: DurationUs(500_000) }),
        "0006160101020206dc0520a107032fee00"
    );
}

#[test]
fn vectors_and_code_say_the_same() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/vectors/messages.txt");
    let ours: Vec<String> = messages()
        .iter()
        .map(|(direction, packet, meaning)| {
            format!("{direction} {} #{} {meaning}", hex(&packet.encode()), packet.sequence)
        })
        .collect();
    if std::env::var_os("BLESS_VECTORS").is_some() {
        let head =
            "# Packets of protocol version 1: direction (> to the board), bytes, sequence number, meaning.\n";
        std::fs::write(path, format!("{head}{}\n", ours.join("\n"))).unwrap();
    }
    let text = std::fs::read_to_string(path).unwrap();
    let theirs: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
    assert_eq!(ours, theirs);

    for line in theirs {
        let mut fields = line.splitn(4, ' ');
        let (direction, bytes) = (fields.next().unwrap(), unhex(fields.next().unwrap()));
        let packets = decode(&bytes);
        assert_eq!(packets.len(), 1, "{line}");
        assert_eq!(fields.next().unwrap(), format!("#{}", packets[0].sequence));
        let meaning = match direction {
            ">" => format!("{:?}", Command::decode(&packets[0]).unwrap()),
            _ => format!("{:?}", Event::decode(&packets[0]).unwrap()),
        };
        assert_eq!(fields.next().unwrap(), meaning);
    }
}

#[test]
fn every_one_and_two_bit_flip_is_rejected() {
    for (_, packet, meaning) in messages() {
        let line = packet.encode();
        assert!(line.len() <= MAX_PACKET_BYTES);
        let bits = line.len() * 8;
        let mut bytes = line.to_vec();
        for first in 0..bits {
            bytes[first / 8] ^= 1 << (first % 8);
            for second in first..bits {
                // At second == first only the one bit is flipped.
                if second != first {
                    bytes[second / 8] ^= 1 << (second % 8);
                }
                // Flips in the zeros around it may leave the packet itself unharmed, never another one.
                let packets = decode(&bytes);
                assert!(
                    packets.iter().all(|p| *p == packet),
                    "{meaning}: bits {first}, {second} gave {packets:?}"
                );
                let inside = |bit: usize| (8..bits - 8).contains(&bit);
                assert!(packets.is_empty() || !(inside(first) || inside(second)), "{meaning}");
                if second != first {
                    bytes[second / 8] ^= 1 << (second % 8);
                }
            }
            bytes[first / 8] ^= 1 << (first % 8);
        }
    }
}

#[test]
fn packet_cut_anywhere_is_nothing_and_the_next_one_is_heard() {
    for (_, packet, _) in messages() {
        let line = packet.encode();
        for cut in 0..line.len() {
            let mut decoder = Decoder::default();
            let mut hear = |bytes: &[u8]| -> Vec<Packet> {
                bytes.iter().filter_map(|&b| decoder.push(b)).filter_map(Result::ok).collect()
            };
            assert_eq!(hear(&line[..cut]), []);
            // Short of its last zero alone it is whole: the next packet's first zero ends it.
            let whole = usize::from(cut == line.len() - 1);
            assert_eq!(hear(&line), vec![packet; 1 + whole]);
        }
    }
}

#[test]
fn bodies_too_short_too_long_or_with_unknown_codes_are_no_messages() {
    for (direction, packet, meaning) in messages() {
        let is_message = |body: &[u8]| {
            let packet = Packet::new(packet.kind, packet.sequence, body);
            if direction == ">" {
                Command::decode(&packet).is_some()
            } else {
                Event::decode(&packet).is_some()
            }
        };
        let body = packet.body();
        assert!(is_message(body));
        for short in 0..body.len() {
            assert!(!is_message(&body[..short]), "{meaning} cut to {short}");
        }
        if body.len() < 64 {
            assert!(!is_message(&[body, &[0]].concat()), "{meaning} with a byte too many");
        }
    }
    assert_eq!(Command::decode(&Packet::new(0x18, Sequence(0), &[99])), None);
    assert_eq!(Command::decode(&Packet::new(0x7f, Sequence(0), &[])), None);
}

fn any_packet() -> impl Strategy<Value = Packet> {
    (any::<u8>(), any::<u16>(), prop::collection::vec(any::<u8>(), 0..=64))
        .prop_map(|(kind, sequence, body)| Packet::new(kind, Sequence(sequence), &body))
}

proptest! {
    #[test]
    fn packets_are_heard_whatever_garbage_is_between_them(
        parts in prop::collection::vec((prop::collection::vec(any::<u8>(), 0..200), any_packet()), 1..20)
    ) {
        let mut bytes = Vec::new();
        for (garbage, packet) in &parts {
            bytes.extend_from_slice(garbage);
            bytes.extend_from_slice(&packet.encode());
        }
        let received = decode(&bytes);
        let sent: Vec<Packet> = parts.iter().map(|(_, packet)| *packet).collect();
        prop_assert_eq!(received, sent);
    }

    #[test]
    fn any_body_is_read_or_refused_but_never_panics(packet in any_packet()) {
        let again = |read: Option<Packet>| read.is_none_or(|p| p.body() == packet.body());
        prop_assert!(again(Command::decode(&packet).map(|c| c.encode(packet.sequence))));
        prop_assert!(again(Event::decode(&packet).map(|e| e.encode(packet.sequence))));
    }
}
