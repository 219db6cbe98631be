//! One whole conversation as a file, bytes and pulses.

#![expect(clippy::unwrap_used, reason = "a test may")]

mod bench;

use std::fmt::Write as _;

use firmware_protocol::command::{Command, SafeState, Segment, Segments};
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
    let mut step = |setup: &mut Setup, wait_us: u32, command: Option<Command>| {
        setup.silence_recorded(wait_us, &mut text);
        if let Some(command) = command {
            sequence.0 += 1;
            let packet: Packet = command.encode(sequence);
            writeln!(text, "{} > {}", setup.now.0, hex(&packet.encode())).unwrap();
            setup.board.receive(&packet.encode(), setup.now, &mut setup.bench);
            setup.drain(&mut text);
        }
    };
    let segments = Segments::new(&[
        Segment { duration: DurationUs(20_000), end_pulse: PulseWidthUs(1508) },
        Segment { duration: DurationUs(10_000), end_pulse: PulseWidthUs(1500) },
    ])
    .unwrap();
    step(&mut setup, 0, Some(Command::Hello));
    step(&mut setup, 1_000, Some(Command::Configure(servo(SafeState::Park))));
    step(&mut setup, 1_000, Some(Command::Timing { dead_man: DurationMs(250), telemetry: DurationMs(100) }));
    step(&mut setup, 1_000, Some(Command::Jog { channel: SERVO, pulse: CENTRE, duration: DurationUs(0) }));
    step(&mut setup, 1_000, Some(Command::Track { channel: SERVO, start_pulse: CENTRE, segments: 2 }));
    step(&mut setup, 1_000, Some(Command::Segments { channel: SERVO, first: 0, segments }));
    let start = setup.now.plus(DurationUs(50_000));
    step(&mut setup, 1_000, Some(Command::Arm { start, segments: 2 }));
    step(&mut setup, 60_000, Some(Command::Ping));
    step(&mut setup, 50_000, Some(Command::Status));
    step(&mut setup, 300_000, None);
    step(&mut setup, 10_000, Some(Command::Hello));
    step(&mut setup, 1_000, Some(Command::Acknowledge(Fault::DeadMan)));
    step(&mut setup, 1_000, Some(Command::Goodbye));
    step(&mut setup, 100_000, None);

    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/vectors/session.txt");
    if std::env::var_os("BLESS_VECTORS").is_some() {
        std::fs::write(path, &text).unwrap();
    }
    assert_eq!(text, std::fs::read_to_string(path).unwrap());
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

impl Setup {
    fn silence_recorded(&mut self, wait_us: u32, text: &mut String) {
        let until = self.now.plus(DurationUs(wait_us));
        while let Some(due) = self.board.next_due().filter(|due| due.reached(until)) {
            self.now = due;
            self.board.advance(due, &mut self.bench);
            self.drain(text);
        }
        self.now = until;
    }

    fn drain(&mut self, text: &mut String) {
        for (channel, pulse, at) in self.bench.pulses.drain(..) {
            let pulse = pulse.map_or("-".to_owned(), |p| p.to_string());
            writeln!(text, "{at} {channel} {pulse}").unwrap();
        }
        if !self.bench.sent.is_empty() {
            writeln!(text, "{} < {}", self.now.0, hex(&self.bench.sent)).unwrap();
            self.bench.sent.clear();
        }
    }
}
