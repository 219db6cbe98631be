//! The Uno's firmware in an emulator against the crate's own board: the same answers to the same bytes.

#![expect(clippy::unwrap_used, reason = "a test may")]

mod bench;
mod emulator;

use firmware_protocol::channel::SafeState;
use firmware_protocol::command::Command;
use firmware_protocol::event::{Ack, Event, Fault, Refusal, State, Status, Telemetry};
use firmware_protocol::packet::Decoder;
use firmware_protocol::units::{Channel, DurationUs, Sequence, Ticks};

use bench::dice::*;
use bench::*;
use emulator::*;

/// How far the board's stamp of a packet may be from the emulator's [µs]: an interrupt may come late by this much.
const STAMP_US: u32 = 80;
/// Time that a host needs to send the profile, chosen.
const PROFILE_UPLOAD_TIME: DurationUs = DurationUs(90_000);

/// The emulated board and the crate's own, which hears the same bytes at the same ticks.
struct Both {
    emulator: Emulator,
    model: Setup,
    origin: u64,
    /// Packets of the model, with their numbers.
    answers: Vec<(Sequence, Event)>,
    compared: usize,
    /// Number of events of the emulator from before it ran alongside the model.
    events_before: usize,
    /// States that the model was in.
    states: Vec<(State, Fault)>,
    decoder: Decoder,
}

impl Both {
    fn new(built: &Built) -> Self {
        let mut emulator = Emulator::new(built, &[]);
        let config = emulator.board_config();
        let origin = emulator.tick_origin();
        let mut model = Setup::of(config, Ticks(0));
        // The board introduced itself when it started, and so its own count is one.
        model.board.greet(&mut model.bench);
        let events_before = emulator.events.len();
        let mut both = Self {
            emulator,
            model,
            origin,
            answers: Vec::new(),
            compared: 0,
            events_before,
            states: Vec::new(),
            decoder: Decoder::default(),
        };
        both.collect();
        both.answers.clear();
        both
    }

    fn collect(&mut self) {
        for byte in std::mem::take(&mut self.model.bench.sent) {
            if let Some(packet) = self.decoder.push(byte) {
                let packet = packet.unwrap();
                self.answers.push((packet.sequence, Event::decode(&packet).unwrap()));
            }
        }
        self.model.bench.pulses.clear();
    }

    fn advance(&mut self, cycle: u64) {
        self.model.now = Ticks(((cycle - self.origin) / CYCLES_PER_US) as u32);
        self.model.board.advance(self.model.now, &mut self.model.bench);
        self.collect();
    }

    /// Hands bytes to both; the board's answers have been received when this returns.
    fn say(&mut self, bytes: &[u8]) {
        let cycle = self.emulator.hand_over(bytes);
        self.advance(cycle);
        self.model.board.receive(bytes, self.model.now, &mut self.model.bench);
        self.collect();
        self.wait(12_000);
    }

    fn wait(&mut self, us: u64) {
        self.emulator.run_us(us);
        self.advance(self.emulator.now_us * CYCLES_PER_US);
        self.states.push((self.model.board.state(), self.model.board.fault()));
    }

    /// Lets the last packet come, and compares all packets since.
    fn compare(&mut self) {
        let theirs: Vec<_> =
            self.emulator.events[self.events_before..].iter().map(|(_, event)| *event).collect();
        let both = self.answers.len().min(theirs.len());
        for (ours, theirs) in self.answers[self.compared..both].iter().zip(&theirs[self.compared..both]) {
            assert_eq!(ours.0, theirs.0, "{ours:?}, on the Uno {theirs:?}");
            assert!(alike(&ours.1, &theirs.1), "{ours:?}, on the Uno {theirs:?}");
        }
        self.compared = both;
        // One may be on the line.
        assert!(
            self.answers.len().abs_diff(theirs.len()) <= 2,
            "{} and {}",
            self.answers.len(),
            theirs.len()
        );
    }
}

fn near(ours: Ticks, theirs: Ticks) -> bool {
    ours.since(theirs).unsigned_abs() <= STAMP_US
}

/// Alike but for the ticks, and what was computed from them: a moving pulse, a lead, a rate.
fn alike(ours: &Event, theirs: &Event) -> bool {
    match (ours, theirs) {
        (Event::Ack(a), Event::Ack(b)) => {
            let timed = [Refusal::RateTooHigh, Refusal::Underflow, Refusal::TooFar, Refusal::NotAtStart];
            let measured =
                |ack: &Ack| if timed.contains(&ack.refusal) { (0, 0) } else { (ack.limit, ack.got) };
            let parts = |ack: &Ack| (ack.command, ack.refusal, ack.channel, measured(ack));
            parts(a) == parts(b)
        }
        (Event::Pong { at: a, boot_id, state, fault }, Event::Pong { at: b, .. }) => {
            *theirs == Event::Pong { at: *b, boot_id: *boot_id, state: *state, fault: *fault } && near(*a, *b)
        }
        (Event::Status(a), Event::Status(b)) => {
            let fault_near = near(a.fault_at, b.fault_at);
            *b == Status { now: b.now, fault_at: b.fault_at, ..*a } && near(a.now, b.now) && fault_near
        }
        (Event::Happened { occurrence, fault, at: a }, Event::Happened { at: b, .. }) => {
            *theirs == Event::Happened { occurrence: *occurrence, fault: *fault, at: *b } && near(*a, *b)
        }
        (Event::Telemetry(a), Event::Telemetry(b)) => {
            let pulses = |t: &Telemetry| t.pulses().iter().map(|p| p.map_or(0, |p| p.0)).collect::<Vec<_>>();
            let close = pulses(a).iter().zip(&pulses(b)).all(|(a, b)| a.abs_diff(*b) <= 5);
            near(a.at, b.at) && a.state == b.state && close
        }
        _ => ours == theirs,
    }
}

#[test]
fn uno_and_board_agree_on_random_sessions() {
    let Some(built) = built() else { return };
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    let mut both = Both::new(built);
    for _ in 0..7 {
        let mut sequence = Sequence(dice.below(1 << 16) as u16);
        let mut sent: Vec<Vec<u8>> = Vec::new();
        let mut say = |both: &mut Both, dice: &mut Dice, command: Command| {
            sequence.0 = sequence.0.wrapping_add(1);
            let mut bytes = command.encode(sequence).encode().to_vec();
            match dice.below(20) {
                0 => bytes.truncate(dice.below(bytes.len() as u32) as usize),
                1 => {
                    let at = dice.below(bytes.len() as u32) as usize;
                    bytes[at] ^= 1 << dice.below(8);
                }
                2 => bytes = sent.iter().rev().nth(dice.below(12) as usize).cloned().unwrap_or(bytes),
                _ => {}
            }
            sent.push(bytes.clone());
            if !bytes.is_empty() {
                both.say(&bytes);
            }
        };
        say(&mut both, &mut dice, Command::Hello);
        for (number, safe_state) in (0..2).zip([SafeState::Park, SafeState::Detach]) {
            let channel = Channel(number);
            let config = firmware_protocol::channel::ChannelConfig { channel, ..servo(safe_state) };
            say(&mut both, &mut dice, Command::Configure(config));
            say(&mut both, &mut dice, Command::Jog { channel, pulse: CENTRE, duration: DurationUs(0) });
        }
        for _ in 0..50 {
            let profile = dice.below(6) == 0;
            let commands = if profile {
                // A host that comes back: after a silence, with a servo limp.
                say(&mut both, &mut dice, Command::Hello);
                let fault = both.model.board.fault();
                say(&mut both, &mut dice, Command::Acknowledge(fault));
                for channel in [0, 1].map(Channel) {
                    let jog = Command::Jog { channel, pulse: CENTRE, duration: DurationUs(0) };
                    say(&mut both, &mut dice, jog);
                }
                whole_profile(&mut dice, &both.model, PROFILE_UPLOAD_TIME)
            } else {
                vec![any_command(&mut dice, &both.model)]
            };
            for command in commands {
                say(&mut both, &mut dice, command);
            }
            let wait = dice.pick(&[0, 0, 0, 0, 500, 12_345, 30_000, 120_000, 400_000]);
            both.wait(wait);
            both.compare();
        }
    }
    for state in State::ALL {
        assert!(both.states.iter().any(|(s, _)| s == state), "never {state}");
    }
    for fault in [Fault::None, Fault::DeadMan, Fault::EStop, Fault::HostRestarted] {
        assert!(both.states.iter().any(|(_, f)| *f == fault), "never {fault}");
    }
    println!("{} answers alike; {} bytes of stack free", both.compared, both.emulator.stack_left());
}

fn from_hex(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

/// The host's side of the session vector, each packet when the line is free and the pauses as they are there. What an
/// arm says of ticks is moved to this board's.
#[test]
fn uno_conducts_the_session_vector() {
    let Some(built) = built() else { return };
    let mut both = Both::new(built);
    let mut last = None;
    for line in include_str!("../vectors/session.txt").lines() {
        let words: Vec<_> = line.split(' ').collect();
        let [tick, ">", hex] = words[..] else { continue };
        let tick: u32 = tick.parse().unwrap();
        let bytes = from_hex(hex);
        let mut decoder = Decoder::default();
        let packet = bytes.iter().find_map(|&byte| decoder.push(byte)).and_then(Result::ok);
        let pause = tick.wrapping_sub(last.unwrap_or(tick));
        last = Some(tick);
        both.wait(u64::from(pause));
        match packet.map(|packet| (packet.sequence, Command::decode(&packet))) {
            Some((sequence, Some(Command::Arm { start, segments }))) => {
                let lead = Ticks(start.0).since(Ticks(tick));
                // What the line takes for this packet is not of the lead.
                let line_us = 150 * bytes.len() as i32;
                let start = Ticks(both.model.now.0.wrapping_add_signed(lead + line_us));
                both.say(&Command::Arm { start, segments }.encode(sequence).encode());
            }
            _ => both.say(&bytes),
        }
    }
    both.wait(20_000);
    both.compare();
    // The same came of it as in the vector, and in the same order.
    let acks = |events: &mut dyn Iterator<Item = Event>| -> Vec<_> {
        events
            .filter_map(|e| if let Event::Ack(ack) = e { Some((ack.command, ack.refusal)) } else { None })
            .collect()
    };
    let mut decoder = Decoder::default();
    let vector = include_str!("../vectors/session.txt").lines().filter(|line| !line.starts_with('#'));
    let vector = vector.filter_map(|line| line.split_once(" < "));
    let bytes = vector.flat_map(|(_, hex)| from_hex(hex));
    let mut expected =
        bytes.filter_map(|byte| decoder.push(byte)).map(|p| Event::decode(&p.unwrap()).unwrap());
    assert_eq!(acks(&mut both.answers.iter().map(|(_, event)| *event)), acks(&mut expected));
    println!("{} answers alike", both.compared);
}
