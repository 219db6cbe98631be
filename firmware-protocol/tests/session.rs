//! One whole conversation as a file, bytes and pulses.

#![expect(clippy::unwrap_used, reason = "a test may")]

mod bench;

use firmware_protocol::channel::SafeState;
use firmware_protocol::command::{Command, Segment, Segments};
use firmware_protocol::event::Fault;
use firmware_protocol::packet::Packet;
use firmware_protocol::units::{DurationMs, DurationUs, PulseWidthUs, Sequence};

use bench::*;

/// A conversation that firmware in C can be held to: `tick > bytes` to the board, `tick < bytes` from it, and
/// `tick channel pulse_us` on its pins.
#[test]
fn session_vector_and_board_agree() {
    let mut setup = Setup::new();
    let mut text = String::from(
        "# tick > bytes to the board | tick < bytes from it | tick channel pulse_us (- detached) on a pin\n\
         # Board: 8 channels, room for 64 segments, boot id 12345678, firmware \"bench\"; first tick 4294867295.\n",
    );
    let mut sequence = Sequence(0);
    let mut packet = |command: Command| -> Packet {
        sequence.0 += 1;
        command.encode(sequence)
    };
    let line = |us, pulse| Segment { duration: DurationUs(us), end_pulse: PulseWidthUs(pulse) };
    let segments = Segments::new(&[line(20_000, 1508), line(10_000, 1500)]).unwrap();
    let upload = [
        Command::Track { channel: SERVO, start_pulse: CENTRE, segments: 2 },
        Command::Segments { channel: SERVO, first: 0, segments },
    ];
    let jog =
        |pulse, us| Command::Jog { channel: SERVO, pulse: PulseWidthUs(pulse), duration: DurationUs(us) };

    // Before a hello, and by a host of another version.
    setup.say_recorded(&packet(Command::Abort).encode(), &mut text);
    let mut foreign = packet(Command::Ping);
    foreign.version = 9;
    setup.say_recorded(&foreign.encode(), &mut text);
    for command in [
        Command::Hello,
        Command::Configure(servo(SafeState::Park)),
        Command::Describe(SERVO),
        Command::Timing { dead_man: DurationMs(250), telemetry: DurationMs(100) },
        jog(1500, 0),
        jog(2500, 1_000_000),
        jog(1600, 1),
    ] {
        setup.say_recorded(&packet(command).encode(), &mut text);
    }
    // Garbage, a packet cut short and a damaged one: only the last packet is received, and a resent one is carried out once.
    let [track, segments] = upload.map(|command| packet(command).encode());
    setup.say_recorded(&[0x55; 100], &mut text);
    setup.say_recorded(&track[..9], &mut text);
    let mut damaged = track.to_vec();
    damaged[4] ^= 0x10;
    setup.say_recorded(&damaged, &mut text);
    for bytes in [&track, &track, &segments, &segments] {
        setup.say_recorded(bytes, &mut text);
    }
    // A whole profile, then silence until the dead-man parks the servo.
    let start = setup.now.plus(DurationUs(50_000));
    let too_late = Command::Arm { start: setup.now, segments: 2 };
    setup.say_recorded(&packet(too_late).encode(), &mut text);
    setup.say_recorded(&packet(Command::Arm { start, segments: 2 }).encode(), &mut text);
    setup.silence_recorded(60_000, &mut text);
    setup.say_recorded(&packet(Command::Ping).encode(), &mut text);
    setup.silence_recorded(60_000, &mut text);
    setup.say_recorded(&packet(Command::Status).encode(), &mut text);
    setup.silence_recorded(320_000, &mut text);
    // A new session, a profile aborted half-way, an e-stop, and the end.
    for command in [Command::Hello, jog(1400, 0), Command::Acknowledge(Fault::DeadMan), jog(1500, 50_000)] {
        setup.say_recorded(&packet(command).encode(), &mut text);
    }
    setup.silence_recorded(60_000, &mut text);
    for command in upload {
        setup.say_recorded(&packet(command).encode(), &mut text);
    }
    let start = setup.now.plus(DurationUs(10_000));
    setup.say_recorded(&packet(Command::Arm { start, segments: 2 }).encode(), &mut text);
    setup.silence_recorded(18_000, &mut text);
    for command in [Command::Abort, Command::EStop, Command::Acknowledge(Fault::EStop), Command::Goodbye] {
        setup.say_recorded(&packet(command).encode(), &mut text);
    }
    setup.silence_recorded(300_000, &mut text);

    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/vectors/session.txt");
    if std::env::var_os("BLESS_VECTORS").is_some() {
        std::fs::write(path, &text).unwrap();
    }
    assert_eq!(text, std::fs::read_to_string(path).unwrap());
}
