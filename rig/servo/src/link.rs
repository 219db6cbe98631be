//! The host's end of the line to a board: asking and asking again, heartbeats, clock samples, and noticing that
//! something is wrong. No port and no clock of its own: bytes and instants are handed in, packets to send come out.

mod hearing;

use std::collections::VecDeque;

use firmware_protocol::command::Command;
use firmware_protocol::event::{Event, Fault, Identity};
use firmware_protocol::packet::{Decoder, Line};
use firmware_protocol::units::Sequence;

use super::ServoEvent;
use ground::clock::{MonotonicNs, Ping, TickExtender};

const HEARTBEAT_S: f64 = 0.050;
/// Time between the pings of a burst, for a clock to arm with: no multiple, and no simple fraction of one, of the milliseconds in which USB
/// and kernels' timers carry bytes on, so that some ping just catches each.
const BURST_S: f64 = 0.010_47;
/// Wait for an answer before asking again; doubles each time.
const FIRST_WAIT_S: f64 = 0.025;
/// How often a command is sent at most.
const MOST_TRIES: u32 = 3;
const E_STOP_EVERY_S: f64 = 0.020;
/// Clock samples kept: a minute's worth.
const CLOCK_SAMPLES: usize = 1200;
/// Pings whose answer may still come.
const OPEN_PINGS: usize = 64;
/// Events kept for an owner that does not ask: some minutes' worth.
const MOST_EVENTS: usize = 50_000;

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
    /// Channels whose pulses matter.
    watched: Vec<u8>,
    armed: Option<Armed>,
    heard: MonotonicNs,
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
            watched: Vec::new(),
            armed: None,
            heard: now,
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
        self.under_way = Some(UnderWay { command, sequence, sent: 0, next: now, wait_s: FIRST_WAIT_S });
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

    /// Says nothing more, so that the board's dead-man acts.
    pub(super) fn mute(&mut self) {
        self.muted = true;
    }

    /// Tells the pulses of these channels, of all that the board reports.
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
        self.tell(ServoEvent::Note { text: text.into() });
    }

    fn tell(&mut self, event: ServoEvent) {
        if self.events.len() < MOST_EVENTS {
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
                Some(Ok(packet)) => self.take(&packet, now),
            }
        }
    }

    /// The next packet to send at `now`, if any; to be called until there is none. Notices silence, too.
    pub(super) fn next_packet(&mut self, now: MonotonicNs) -> Option<Line> {
        let silent_s = now.seconds_since(self.heard);
        if self.heartbeat.is_some() && !self.muted && silent_s > self.silence_s {
            // Without heartbeats the board's dead-man acts, should it still hear.
            self.end(Trouble::Silent(silent_s, self.damaged));
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
            if asked.sent == MOST_TRIES {
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
            self.pings.truncate(OPEN_PINGS - 1);
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

    /// Trouble that the link does not outlive: nothing more is said, but for an e-stop.
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
