//! The host's end of the line to a board: asking and asking again, heartbeats, clock samples, and noticing that
//! something is wrong. No port and no clock of its own: bytes and instants are handed in, packets to send come out.

use std::collections::VecDeque;

use firmware_protocol::VERSION;
use firmware_protocol::command::{Command, kind as command_kind};
use firmware_protocol::event::{Event, Fault, Identity, Occurrence, State, kind as event_kind};
use firmware_protocol::packet::{Decoder, Line, Packet};
use firmware_protocol::units::Sequence;

use super::ServoEvent;
use crate::clock::{MonotonicNs, Ping, TickExtender};

const HEARTBEAT_S: f64 = 0.050;
/// Time between the first pings, for a clock to arm with.
const BURST_S: f64 = 0.010;
/// Wait for an answer before asking again; doubles each time.
const FIRST_WAIT_S: f64 = 0.025;
/// How often a command is sent at most.
const TRIES: u32 = 3;
const E_STOP_EVERY_S: f64 = 0.020;
/// Clock samples kept: a minute's worth.
const SAMPLES: usize = 1200;
/// Pings whose answer may still come.
const PINGS: usize = 64;

/// What is wrong with the board or the line to it.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Trouble {
    /// No valid packet for too long \[s\], so many damaged ones so far.
    Silent(f64, u64),
    /// The port is gone: what the system said.
    Gone(String),
    /// Another boot id than at the handshake.
    Restarted { before: u32, after: u32 },
    /// The board stopped by itself.
    Fault(Fault),
}

/// A command under way.
#[derive(Debug)]
struct UnderWay {
    command: Command,
    sequence: Sequence,
    sent: u32,
    next: MonotonicNs,
    wait_s: f64,
}

/// How a command ended: answered by a packet, or not at all.
pub(super) type Answer = Result<Event, Unanswered>;

/// No answer came to a command however often it was sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Unanswered;

#[derive(Debug, Default)]
struct EStop {
    /// When to send it next; none: at once.
    next: Option<MonotonicNs>,
    acknowledged: bool,
    /// There was a heartbeat to go on with afterwards.
    resume: bool,
}

/// A profile the board was armed with.
#[derive(Debug, Clone, Copy)]
struct Armed {
    start_us: u64,
    end_us: u64,
    started: bool,
}

/// The host's end of the line.
#[derive(Debug)]
pub(super) struct Link {
    decoder: Decoder,
    sequence: Sequence,
    under_way: Option<UnderWay>,
    answer: Option<Answer>,
    e_stop: Option<EStop>,
    /// The board at the handshake and its protocol version.
    pub(super) board: Option<(Identity, u8)>,
    heartbeat: Option<MonotonicNs>,
    burst: u32,
    pings: VecDeque<(Sequence, MonotonicNs)>,
    samples: VecDeque<Ping>,
    ticks: TickExtender,
    armed: Option<Armed>,
    heard: MonotonicNs,
    silence_s: f64,
    events: Vec<ServoEvent>,
    trouble: Option<Trouble>,
    known_fault: Fault,
    muted: bool,
    /// Bytes received.
    pub(super) bytes: u64,
    /// Damaged packets received.
    pub(super) damaged: u64,
}

impl Link {
    /// A link on which nothing was said yet. `first` is the first sequence number; a session that goes on where
    /// another left off should not begin with its numbers.
    pub(super) fn new(silence_s: f64, first: u16, now: MonotonicNs) -> Self {
        Self {
            decoder: Decoder::default(),
            sequence: Sequence(first),
            under_way: None,
            answer: None,
            e_stop: None,
            board: None,
            heartbeat: None,
            burst: 0,
            pings: VecDeque::new(),
            samples: VecDeque::new(),
            ticks: TickExtender::default(),
            armed: None,
            heard: now,
            silence_s,
            events: Vec::new(),
            trouble: None,
            known_fault: Fault::None,
            muted: false,
            bytes: 0,
            damaged: 0,
        }
    }

    /// Puts a command under way; whatever was before it is forgotten.
    pub(super) fn ask(&mut self, command: Command, now: MonotonicNs) {
        self.answer = None;
        let sequence = self.number();
        self.under_way = Some(UnderWay { command, sequence, sent: 0, next: now, wait_s: FIRST_WAIT_S });
    }

    /// The end of the command under way, once.
    pub(super) fn take_answer(&mut self) -> Option<Answer> {
        self.answer.take()
    }

    /// Begins the heartbeat with a burst of `burst` pings.
    pub(super) fn keep_alive(&mut self, burst: u32, now: MonotonicNs) {
        self.heartbeat = Some(now);
        self.burst = burst;
    }

    /// Sends an e-stop ahead of everything else, and again until it is acknowledged.
    pub(super) fn e_stop(&mut self) {
        self.under_way = None;
        self.armed = None;
        self.known_fault = Fault::EStop;
        self.muted = false;
        // E-stops are heartbeat enough, and must go out to a board that has been silent for long.
        let resume = self.heartbeat.take().is_some();
        self.e_stop = Some(EStop { resume, ..EStop::default() });
    }

    /// Whether the e-stop was acknowledged.
    pub(super) fn is_stopped(&self) -> bool {
        self.e_stop.as_ref().is_some_and(|stop| stop.acknowledged)
    }

    /// Says nothing more, so that the board's dead-man acts.
    pub(super) fn mute(&mut self) {
        self.muted = true;
    }

    /// The board was armed to play from `start_us` to `end_us` of its extended ticks.
    pub(super) fn armed(&mut self, start_us: u64, end_us: u64) {
        self.armed = Some(Armed { start_us, end_us, started: false });
    }

    /// Whether a profile may be moving the mechanism.
    pub(super) fn is_armed(&self) -> bool {
        self.armed.is_some()
    }

    /// The board's latched fault as far as known is `fault`: only another one is trouble.
    pub(super) fn expect_fault(&mut self, fault: Fault) {
        self.known_fault = fault;
    }

    /// Clock samples, the newest minute of them.
    pub(super) fn samples(&mut self) -> &[Ping] {
        self.samples.make_contiguous()
    }

    /// What happened since the last call.
    pub(super) fn take_events(&mut self) -> Vec<ServoEvent> {
        std::mem::take(&mut self.events)
    }

    /// Adds a line for the journal.
    pub(super) fn note(&mut self, text: impl Into<String>) {
        self.events.push(ServoEvent::Note { text: text.into() });
    }

    /// What is wrong, once.
    pub(super) fn take_trouble(&mut self) -> Option<Trouble> {
        self.trouble.take()
    }

    /// The port is gone.
    pub(super) fn gone(&mut self, why: String) {
        self.muted = true;
        self.raise(Trouble::Gone(why));
    }

    /// Takes bytes that came at `now`.
    pub(super) fn receive(&mut self, bytes: &[u8], now: MonotonicNs) {
        self.bytes += bytes.len() as u64;
        for &byte in bytes {
            match self.decoder.push(byte) {
                None => {}
                Some(Err(_)) => self.damaged += 1,
                Some(Ok(packet)) => self.take(&packet, now),
            }
        }
    }

    /// The next packet to send at `now`, if any; to be called until there is none. Notices silence, too.
    pub(super) fn next_packet(&mut self, now: MonotonicNs) -> Option<Line> {
        let silent_s = now.seconds_since(self.heard);
        if self.heartbeat.is_some() && !self.muted && silent_s > self.silence_s {
            // Without heartbeats the board's dead-man acts, should it still hear.
            self.muted = true;
            self.raise(Trouble::Silent(silent_s, self.damaged));
        }
        if self.muted {
            self.fail_under_way();
            return None;
        }
        if let Some(stop) = self.e_stop.as_mut().filter(|stop| !stop.acknowledged)
            && stop.next.is_none_or(|next| now >= next)
        {
            stop.next = Some(now.plus_seconds(E_STOP_EVERY_S));
            let sequence = self.number();
            return Some(Command::EStop.encode(sequence).encode());
        }
        if let Some(asked) = self.under_way.as_mut().filter(|asked| now >= asked.next) {
            if asked.sent == TRIES {
                self.fail_under_way();
            } else {
                asked.sent += 1;
                asked.next = now.plus_seconds(asked.wait_s);
                asked.wait_s *= 2.0;
                return Some(asked.command.encode(asked.sequence).encode());
            }
        }
        if self.heartbeat.is_some_and(|at| now >= at) {
            let pause_s = if self.burst > 0 { BURST_S } else { HEARTBEAT_S };
            self.burst = self.burst.saturating_sub(1);
            self.heartbeat = Some(now.plus_seconds(pause_s));
            let sequence = self.number();
            self.pings.truncate(PINGS - 1);
            self.pings.push_front((sequence, now));
            return Some(Command::Ping.encode(sequence).encode());
        }
        None
    }

    /// Whether the first burst of pings is over.
    pub(super) fn burst_is_over(&self) -> bool {
        self.burst == 0
    }

    fn number(&mut self) -> Sequence {
        self.sequence.0 = self.sequence.0.wrapping_add(1);
        self.sequence
    }

    fn raise(&mut self, trouble: Trouble) {
        self.armed = None;
        // The first cause explains the later ones.
        self.trouble.get_or_insert(trouble);
    }

    fn fail_under_way(&mut self) {
        if self.under_way.take().is_some() {
            self.answer = Some(Err(Unanswered));
        }
    }

    fn take(&mut self, packet: &Packet, now: MonotonicNs) {
        self.heard = now;
        let frozen = matches!(packet.kind, event_kind::HELLO | event_kind::STATUS | event_kind::ACK);
        if packet.version != VERSION && !frozen {
            return;
        }
        let Some(event) = Event::decode(packet) else {
            self.damaged += 1;
            return;
        };
        match event {
            Event::Ack(ack) if ack.command == command_kind::E_STOP => {
                if let Some(stop) = self.e_stop.as_mut().filter(|stop| !stop.acknowledged) {
                    stop.acknowledged = true;
                    self.heartbeat = stop.resume.then_some(now);
                }
                return;
            }
            Event::Hello(identity) => self.introduced(identity, packet.version),
            Event::Pong { at, boot_id, state, fault } => {
                self.same_board(boot_id);
                let board_tick_us = self.ticks.extend(at.0);
                self.ponged(packet.sequence, board_tick_us, now);
                self.follow(state, fault, board_tick_us);
                return;
            }
            Event::Telemetry(telemetry) => {
                let board_tick_us = self.ticks.extend(telemetry.at.0);
                for (channel, pulse) in (0..).zip(telemetry.pulses()) {
                    let pulse_us = pulse.map(|pulse| pulse.0);
                    self.events.push(ServoEvent::Pulse { channel, board_tick_us, pulse_us });
                }
                return;
            }
            Event::Happened { occurrence, fault, at } => {
                let tick_us = self.ticks.extend(at.0);
                match occurrence {
                    Occurrence::Started => self.started(tick_us),
                    Occurrence::Finished => self.finished(tick_us),
                    Occurrence::Faulted => self.faulted(fault),
                }
                return;
            }
            Event::Ack(_) | Event::Status(_) | Event::Description(_) => {}
        }
        if self.under_way.as_ref().is_some_and(|asked| asked.sequence == packet.sequence) {
            self.under_way = None;
            self.answer = Some(Ok(event));
        }
    }

    fn introduced(&mut self, identity: Identity, version: u8) {
        if self.board.is_some() {
            self.same_board(identity.boot_id);
        } else {
            self.board = Some((identity, version));
        }
    }

    fn same_board(&mut self, boot_id: u32) {
        if let Some((identity, _)) = self.board
            && identity.boot_id != boot_id
        {
            self.muted = true;
            self.raise(Trouble::Restarted { before: identity.boot_id, after: boot_id });
        }
    }

    fn ponged(&mut self, sequence: Sequence, board_tick_us: u64, received: MonotonicNs) {
        // Each ping is a new question with a number of its own, so an answer belongs to one sending only.
        let Some(index) = self.pings.iter().position(|&(number, _)| number == sequence) else { return };
        let Some((_, sent)) = self.pings.remove(index) else { return };
        if self.samples.len() == SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(Ping { sent, board_tick_us, received });
        self.events.push(ServoEvent::Ping { sent, board_tick_us, received });
    }

    /// What a pong says about the board's state makes up for a lost report of what happened.
    fn follow(&mut self, state: State, fault: Fault, tick_us: u64) {
        match (state, self.armed) {
            (State::Faulted, _) => self.faulted(fault),
            (State::Running, Some(armed)) => self.started(armed.start_us),
            (State::Idle, Some(armed)) if armed.started || tick_us > armed.end_us => {
                self.finished(armed.end_us)
            }
            _ => {}
        }
    }

    fn started(&mut self, board_tick_us: u64) {
        if let Some(armed) = self.armed.as_mut().filter(|armed| !armed.started) {
            armed.started = true;
            self.events.push(ServoEvent::Started { board_tick_us });
        }
    }

    fn finished(&mut self, board_tick_us: u64) {
        if let Some(armed) = self.armed.take() {
            if !armed.started {
                self.events.push(ServoEvent::Started { board_tick_us: armed.start_us });
            }
            self.events.push(ServoEvent::Finished { board_tick_us });
        }
    }

    fn faulted(&mut self, fault: Fault) {
        if fault != self.known_fault {
            self.known_fault = fault;
            self.raise(Trouble::Fault(fault));
        }
    }
}
