//! The host's end of the line to a board: commands and their repetition, heartbeats, clock samples, and noticing that
//! something is wrong. No port and no clock of its own: bytes and instants are handed in, packets to send come out.

mod hearing;

use std::collections::VecDeque;

use firmware_protocol::command::Command;
use firmware_protocol::event::{Event, Fault, Identity};
use firmware_protocol::packet::{Decoder, Line};
use firmware_protocol::units::Sequence;

use super::ServoEvent;
use ground::clock::{MonotonicNs, Ping, TickExtender};

/// Time between heartbeats, which are pings \[s\], chosen.
const HEARTBEAT_PERIOD_S: f64 = 0.050;
/// Time between the pings of a burst, for a clock to arm with \[s\], chosen: no multiple or simple fraction of the milliseconds in which USB
/// and kernel timers forward bytes, so that some pings meet no wait.
const BURST_PING_PERIOD_S: f64 = 0.010_47;
/// How long the first answer is awaited before a command is sent again \[s\], chosen; doubles each time.
const FIRST_ANSWER_WAIT_S: f64 = 0.025;
/// How often a command is sent at most, chosen.
const MAX_SENDS_PER_COMMAND: u32 = 3;
/// Time between repetitions of an e-stop \[s\], chosen.
const E_STOP_PERIOD_S: f64 = 0.020;
/// Clock samples that are stored: those of a minute.
const MAX_CLOCK_SAMPLES: usize = 1200;
/// Most pings that are stored while their answers may still come, chosen.
const MAX_OPEN_PINGS: usize = 64;
/// Most events that are stored for an owner that does not poll, those of some minutes; later ones are dropped and counted.
const MAX_STORED_EVENTS: usize = 50_000;

/// What is wrong with the board or the line to it.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Trouble {
    /// No valid packet for this long \[s\]; the number of damaged ones so far.
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

/// No answer came to a command although it was repeated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Unanswered;

#[derive(Debug, Default)]
struct EStop {
    /// When to send it next; none: at once.
    next: Option<MonotonicNs>,
    acknowledged: bool,
    /// Whether there was a heartbeat before, which goes on afterwards.
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
    /// Channels whose pulses are reported.
    watched: Vec<u8>,
    armed: Option<Armed>,
    last_packet: MonotonicNs,
    silence_s: f64,
    events: Vec<ServoEvent>,
    dropped_events: u64,
    trouble: Option<Trouble>,
    /// What ended the link for good.
    ended: Option<Trouble>,
    /// The handshake is over: another boot id is a restart.
    established: bool,
    known_fault: Fault,
    muted: bool,
    /// Bytes received.
    pub(super) bytes: u64,
    /// Damaged packets received.
    pub(super) damaged: u64,
}

impl Link {
    /// A link on which nothing was sent yet. `first` is the first sequence number; a session that goes on where
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
            watched: Vec::new(),
            armed: None,
            last_packet: now,
            silence_s,
            events: Vec::new(),
            dropped_events: 0,
            trouble: None,
            ended: None,
            established: false,
            known_fault: Fault::None,
            muted: false,
            bytes: 0,
            damaged: 0,
        }
    }

    /// Puts a command under way; whatever was before it is forgotten.
    pub(super) fn ask(&mut self, command: Command, now: MonotonicNs) {
        self.answer = None;
        if self.muted {
            self.answer = Some(Err(Unanswered));
            return;
        }
        let sequence = self.number();
        self.under_way =
            Some(UnderWay { command, sequence, sent: 0, next: now, wait_s: FIRST_ANSWER_WAIT_S });
    }

    /// The end of the command under way, once.
    pub(super) fn take_answer(&mut self) -> Option<Answer> {
        self.answer.take()
    }

    /// The handshake is over: begins the heartbeat with a burst of `burst` pings.
    pub(super) fn keep_alive(&mut self, burst: u32, now: MonotonicNs) {
        self.established = true;
        self.heartbeat = Some(now);
        self.burst = burst;
    }

    /// When the next ping is due.
    pub(super) fn next_ping(&self) -> Option<MonotonicNs> {
        self.heartbeat.filter(|_| !self.muted)
    }

    /// The next `count` pings come as quickly as the first ones.
    pub(super) fn burst(&mut self, count: u32) {
        self.burst = count;
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

    /// Sends nothing more, so that the board's dead-man acts.
    pub(super) fn mute(&mut self) {
        self.muted = true;
    }

    /// Of all pulses that the board reports, passes on those of these channels.
    pub(super) fn watch(&mut self, channels: Vec<u8>) {
        self.watched = channels;
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
        if self.dropped_events > 0 {
            let dropped = std::mem::take(&mut self.dropped_events);
            self.events
                .push(ServoEvent::Note { text: format!("{dropped} servo events dropped: nobody took them") });
        }
        std::mem::take(&mut self.events)
    }

    /// Adds a line for the journal.
    pub(super) fn note(&mut self, text: impl Into<String>) {
        self.push_event(ServoEvent::Note { text: text.into() });
    }

    fn push_event(&mut self, event: ServoEvent) {
        if self.events.len() < MAX_STORED_EVENTS {
            self.events.push(event);
        } else {
            self.dropped_events += 1;
        }
    }

    /// What is wrong, once.
    pub(super) fn take_trouble(&mut self) -> Option<Trouble> {
        self.trouble.take()
    }

    /// What ended the link for good, if it has ended.
    pub(super) fn ended(&self) -> Option<&Trouble> {
        self.ended.as_ref()
    }

    /// The port is gone.
    pub(super) fn gone(&mut self, why: String) {
        self.end(Trouble::Gone(why));
    }

    /// Takes bytes that came at `now`.
    pub(super) fn receive(&mut self, bytes: &[u8], now: MonotonicNs) {
        self.bytes += bytes.len() as u64;
        for &byte in bytes {
            match self.decoder.push(byte) {
                None => {}
                Some(Err(_)) => self.damaged += 1,
                Some(Ok(packet)) => self.take_packet(&packet, now),
            }
        }
    }

    /// The next packet to send at `now`, if any; to be called until there is none. Notices silence, too.
    pub(super) fn next_packet(&mut self, now: MonotonicNs) -> Option<Line> {
        let silent_s = now.seconds_since(self.last_packet);
        if self.heartbeat.is_some() && !self.muted && silent_s > self.silence_s {
            // Without heartbeats the board's dead-man acts.
            self.end(Trouble::Silent(silent_s, self.damaged));
        }
        if self.muted {
            self.fail_under_way();
            return None;
        }
        if let Some(stop) = self.e_stop.as_mut().filter(|stop| !stop.acknowledged)
            && stop.next.is_none_or(|next| now >= next)
        {
            stop.next = Some(now.plus_seconds(E_STOP_PERIOD_S));
            let sequence = self.number();
            return Some(Command::EStop.encode(sequence).encode());
        }
        if let Some(pending) = self.under_way.as_mut().filter(|pending| now >= pending.next) {
            if pending.sent == MAX_SENDS_PER_COMMAND {
                self.fail_under_way();
            } else {
                pending.sent += 1;
                pending.next = now.plus_seconds(pending.wait_s);
                pending.wait_s *= 2.0;
                return Some(pending.command.encode(pending.sequence).encode());
            }
        }
        if self.heartbeat.is_some_and(|at| now >= at) {
            let pause_s = if self.burst > 0 { BURST_PING_PERIOD_S } else { HEARTBEAT_PERIOD_S };
            self.burst = self.burst.saturating_sub(1);
            self.heartbeat = Some(now.plus_seconds(pause_s));
            let sequence = self.number();
            self.pings.truncate(MAX_OPEN_PINGS - 1);
            self.pings.push_front((sequence, now));
            return Some(Command::Ping.encode(sequence).encode());
        }
        None
    }

    /// Whether the last burst of pings is over.
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

    /// Trouble that ends the link: nothing more is sent, but for an e-stop.
    fn end(&mut self, trouble: Trouble) {
        self.muted = true;
        if self.ended.is_none() {
            self.ended = Some(trouble.clone());
            self.raise(trouble);
        }
    }

    fn fail_under_way(&mut self) {
        if self.under_way.take().is_some() {
            self.answer = Some(Err(Unanswered));
        }
    }
}

#[cfg(test)]
mod tests;
