//! A board under test: virtual ticks, recorded pulses and bytes.

#![allow(dead_code, reason = "each test file uses its part")]
#![allow(unreachable_pub, reason = "shared between test files")]
#![allow(missing_docs, reason = "test helpers")]

pub mod dice;

use std::fmt::Write as _;

use firmware_protocol::board::{Board, BoardConfig, Hardware};
use firmware_protocol::channel::{ChannelConfig, ChannelKind, SafeState};
use firmware_protocol::command::{Command, Segment, Segments};
use firmware_protocol::event::{Ack, Event, Fault, Refusal};
use firmware_protocol::packet::Decoder;
use firmware_protocol::units::{Channel, DurationUs, Name, PulseWidthUs, RateUsPerS, Sequence, Ticks};

pub const SERVO: Channel = Channel(0);
pub const CENTRE: PulseWidthUs = PulseWidthUs(1500);
/// Ticks begin near their end, so that every test crosses the wrap.
pub const BOOT: Ticks = Ticks(u32::MAX - 100_000);

/// Records what the board does.
#[derive(Default)]
pub struct Bench {
    pub pulses: Vec<(u8, Option<u16>, u32)>,
    pub sent: Vec<u8>,
}

impl Hardware for Bench {
    fn pulse(&mut self, channel: Channel, pulse: Option<PulseWidthUs>, at: Ticks) {
        self.pulses.push((channel.0, pulse.map(|p| p.0), at.0));
    }

    fn send(&mut self, bytes: &[u8]) {
        self.sent.extend_from_slice(bytes);
    }
}

pub struct Setup {
    pub board: Board<64>,
    pub bench: Bench,
    pub now: Ticks,
    sequence: Sequence,
}

impl Setup {
    pub fn new() -> Self {
        let config = BoardConfig {
            boot_id: 0x1234_5678,
            channels: 8,
            firmware: Name::new("bench").unwrap(),
            fault: Fault::None,
        };
        Self::of(config, BOOT)
    }

    pub fn of(config: BoardConfig, now: Ticks) -> Self {
        Self { board: Board::new(config, now), bench: Bench::default(), now, sequence: Sequence(0) }
    }

    /// A session with servo channel 0 at its centre.
    pub fn ready(safe_state: SafeState) -> Self {
        let mut setup = Self::new();
        setup.say(Command::Hello);
        setup.must(Command::Configure(servo(safe_state)));
        setup.must(Command::Jog { channel: SERVO, pulse: CENTRE, duration: DurationUs(0) });
        setup
    }

    pub fn feed(&mut self, bytes: &[u8]) -> Vec<Event> {
        self.board.receive(bytes, self.now, &mut self.bench);
        self.take_events()
    }

    fn take_events(&mut self) -> Vec<Event> {
        let mut decoder = Decoder::default();
        let packets = self.bench.sent.drain(..).filter_map(|b| decoder.push(b));
        packets.map(|p| Event::decode(&p.unwrap()).unwrap()).collect()
    }

    pub fn say(&mut self, command: Command) -> Event {
        self.sequence.0 = self.sequence.0.wrapping_add(1);
        *self.feed(&command.encode(self.sequence).encode()).last().expect("an answer")
    }

    pub fn ack(&mut self, command: Command) -> Ack {
        match self.say(command) {
            Event::Ack(ack) => ack,
            other => panic!("{command:?} was answered by {other:?}"),
        }
    }

    pub fn must(&mut self, command: Command) {
        let ack = self.ack(command);
        assert_eq!(ack.refusal, Refusal::None, "{command:?}: {ack:?}");
    }

    pub fn refused(&mut self, command: Command) -> (Refusal, u32, u32) {
        let ack = self.ack(command);
        (ack.refusal, ack.limit, ack.got)
    }

    /// Lets time pass in one leap, without a host.
    pub fn silence(&mut self, duration: DurationUs) -> Vec<Event> {
        self.now = self.now.plus(duration);
        self.board.advance(self.now, &mut self.bench);
        self.take_events()
    }

    /// Lets time pass with a host that pings.
    pub fn pass(&mut self, ms: u32) -> Vec<Event> {
        let mut events = Vec::new();
        for _ in 0..ms.div_ceil(50) {
            events.extend(self.silence(DurationUs(50_000)));
            self.sequence.0 = self.sequence.0.wrapping_add(1);
            events.extend(self.feed(&Command::Ping.encode(self.sequence).encode()));
        }
        events
    }

    pub fn upload(&mut self, segments: &[(u32, u16)]) {
        let count = segments.len() as u16;
        self.must(Command::Track { channel: SERVO, start_pulse: CENTRE, segments: count });
        for (index, part) in segments.chunks(10).enumerate() {
            let part: Vec<_> = part
                .iter()
                .map(|&(d, p)| Segment { duration: DurationUs(d), end_pulse: PulseWidthUs(p) })
                .collect();
            let segments = Segments::new(&part).unwrap();
            self.must(Command::Segments { channel: SERVO, first: 10 * index as u16, segments });
        }
    }

    pub fn arm(&mut self, segments: &[(u32, u16)]) -> Ticks {
        self.upload(segments);
        let start = self.now.plus(DurationUs(20_000));
        self.must(Command::Arm { start, segments: segments.len() as u16 });
        start
    }
}

pub fn servo(safe_state: SafeState) -> ChannelConfig {
    ChannelConfig {
        channel: SERVO,
        kind: ChannelKind::Servo,
        safe_state,
        min_pulse: PulseWidthUs(1000),
        max_pulse: PulseWidthUs(2000),
        park_pulse: PulseWidthUs(1400),
        max_rate: RateUsPerS(2000),
        name: Name::new("base").unwrap(),
    }
}

pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

impl Setup {
    /// Lets time pass, writing down what the board does.
    pub fn silence_recorded(&mut self, wait_us: u32, text: &mut String) {
        let until = self.now.plus(DurationUs(wait_us));
        while let Some(due) = self.board.next_due().filter(|due| due.reached(until)) {
            self.now = due;
            self.board.advance(due, &mut self.bench);
            self.drain(text);
        }
        self.now = until;
    }

    /// A millisecond later hands bytes to the board, writing down both.
    pub fn say_recorded(&mut self, bytes: &[u8], text: &mut String) {
        self.silence_recorded(1_000, text);
        writeln!(text, "{} > {}", self.now.0, hex(bytes)).unwrap();
        self.board.receive(bytes, self.now, &mut self.bench);
        self.drain(text);
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
