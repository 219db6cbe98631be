//! The board's side: what it needs of its hardware, and the state machine above it.
//!
//! ```text
//!            track, segments, arm            start tick
//!   idle ───────────────────────────▶ armed ───────────▶ running ──▶ idle
//!    │  ▲                               │                  │
//!    │  └──── abort ────────────────────┴──────────────────┤
//!    └ jog ─▶ jogging ─▶ idle                              │
//!   any: e-stop, dead-man, another host's hello, hardware fault ──▶ faulted ── acknowledge ──▶ idle
//! ```
//!
//! [`Board`] has no clock and no port of its own: whoever owns it hands in bytes and ticks. So the same code runs on a
//! microcontroller, behind a pseudo-terminal and in a test with virtual time. Everything that is due happens at its
//! own tick, in order, however late [`Board::advance`] is called; a profile's timing is exact in ticks.

mod commands;
mod motion;

pub use motion::PULSE_UPDATE_PERIOD;

use crate::channel::{ChannelConfig, SafeState};
use crate::event::{Ack, Event, Fault, Identity, MAX_CHANNELS, Occurrence, State, Telemetry};
use crate::packet::Decoder;
use crate::units::{Channel, DurationMs, DurationUs, Name, PulseWidthUs, Sequence, Ticks};
use motion::{Line, Store, Track};

/// Longest silence of the host until the host sets another, chosen.
pub const DEFAULT_DEAD_MAN: DurationMs = DurationMs(250);
/// Range of the longest silence that a host may set \[ms\], chosen.
pub const DEAD_MAN_RANGE_MS: core::ops::RangeInclusive<u16> = 50..=2000;
/// Least time between arming and starting, chosen.
pub const MIN_LEAD: DurationUs = DurationUs(5_000);
/// Most time between arming and starting, chosen.
pub const MAX_LEAD: DurationUs = DurationUs(60_000_000);
/// Longest track and longest jog, chosen: 30 minutes, within the horizon of a wrapping tick.
pub const MAX_DURATION: DurationUs = DurationUs(1_800_000_000);

/// Answers that are stored for resent commands, chosen; a host has one command under way at a time.
const STORED_ANSWERS: usize = 8;

/// The hardware of a board, as the state machine uses it.
pub trait Hardware {
    /// From `at` on, `channel` puts out `pulse`, or nothing. Called only when that changes.
    fn pulse(&mut self, channel: Channel, pulse: Option<PulseWidthUs>, at: Ticks);

    /// Sends bytes to the host. What cannot be sent is dropped: the host asks again.
    fn send(&mut self, bytes: &[u8]);
}

/// Properties of a board that are fixed for one start.
#[derive(Debug, Clone, Copy)]
pub struct BoardConfig {
    /// A number that differs after each start.
    pub boot_id: u32,
    /// Number of channels, at most [`MAX_CHANNELS`].
    pub channels: u8,
    /// Name and version of the firmware.
    pub firmware: Name<24>,
    /// Why the board starts with a fault, or [`Fault::None`].
    pub fault: Fault,
}

#[derive(Debug, Clone, Copy, Default)]
struct ChannelState {
    config: Option<ChannelConfig>,
    pulse: Option<PulseWidthUs>,
    line: Option<Line>,
    track: Option<Track>,
}

/// A board's state machine, with room for `SEGMENTS` profile segments.
#[derive(Debug)]
pub struct Board<const SEGMENTS: usize = 1024> {
    identity: Identity,
    decoder: Decoder,
    state: State,
    fault: Fault,
    fault_at: Ticks,
    /// When a valid packet came last, while a host's session lasts.
    last_packet: Option<Ticks>,
    dead_man: DurationMs,
    telemetry: DurationMs,
    telemetry_due: Ticks,
    channels: [ChannelState; MAX_CHANNELS],
    store: Store<SEGMENTS>,
    /// The channel whose track was announced last.
    uploading: Option<Channel>,
    start: Ticks,
    answers: [Option<(Sequence, Ack)>; STORED_ANSWERS],
    next_answer: usize,
    sequence: Sequence,
    damaged: u16,
    refused: u16,
}

/// What is due next.
#[derive(Debug, Clone, Copy)]
enum Due {
    Start,
    Pulse(usize),
    Telemetry,
    DeadMan,
}

impl<const SEGMENTS: usize> Board<SEGMENTS> {
    /// A board just started at `now`: every channel detached, no host.
    pub fn new(config: BoardConfig, now: Ticks) -> Self {
        Self {
            identity: Identity {
                boot_id: config.boot_id,
                channels: config.channels.min(MAX_CHANNELS as u8),
                max_segments: u16::try_from(SEGMENTS).unwrap_or(u16::MAX),
                firmware: config.firmware,
            },
            decoder: Decoder::default(),
            state: if config.fault == Fault::None { State::Idle } else { State::Faulted },
            fault: config.fault,
            fault_at: now,
            last_packet: None,
            dead_man: DEFAULT_DEAD_MAN,
            telemetry: DurationMs(0),
            telemetry_due: now,
            channels: [ChannelState::default(); MAX_CHANNELS],
            store: Store::new(),
            uploading: None,
            start: now,
            answers: [None; STORED_ANSWERS],
            next_answer: 0,
            sequence: Sequence(0),
            damaged: 0,
            refused: 0,
        }
    }

    /// Sends a hello without being asked, as a board does when it starts.
    pub fn greet(&mut self, hardware: &mut impl Hardware) {
        self.send_event(&Event::Hello(self.identity), hardware);
    }

    /// The present state.
    pub fn state(&self) -> State {
        self.state
    }

    /// The latched fault.
    pub fn fault(&self) -> Fault {
        self.fault
    }

    /// The pulse of a channel, none while detached.
    pub fn pulse(&self, channel: Channel) -> Option<PulseWidthUs> {
        self.channels.get(usize::from(channel.0)).and_then(|c| c.pulse)
    }

    /// What a channel drives and within which limits, once configured: for ports that show more than its pulse.
    pub fn channel(&self, channel: Channel) -> Option<&ChannelConfig> {
        self.channels.get(usize::from(channel.0)).and_then(|c| c.config.as_ref())
    }

    /// Takes bytes from the host, the last of which came at `now`. Hand bytes in *before* [`Board::advance`]: then a
    /// main loop that was held up does not take its own lateness for the host's silence.
    pub fn receive(&mut self, bytes: &[u8], now: Ticks, hardware: &mut impl Hardware) {
        for &byte in bytes {
            match self.decoder.push(byte) {
                None => {}
                Some(Err(_)) => self.damaged = self.damaged.wrapping_add(1),
                Some(Ok(packet)) => {
                    if self.last_packet.is_some() {
                        self.last_packet = Some(now);
                    }
                    self.advance(now, hardware);
                    self.handle(&packet, now, hardware);
                }
            }
        }
    }

    /// Does what is due up to `now`, each at its own tick. To be called at least every few minutes, or the wrapping
    /// tick becomes ambiguous; for smooth pulses, at [`Board::next_due`].
    pub fn advance(&mut self, now: Ticks, hardware: &mut impl Hardware) {
        while let Some((at, due)) = self.due().filter(|(at, _)| at.reached(now)) {
            match due {
                Due::Start => self.begin(at, hardware),
                Due::Pulse(channel) => self.update(channel, at, hardware),
                Due::Telemetry => {
                    self.telemetry_due = at.plus(self.telemetry.into());
                    let mut pulses = [None; MAX_CHANNELS];
                    for (pulse, channel) in pulses.iter_mut().zip(&self.channels) {
                        *pulse = channel.pulse;
                    }
                    let used = &pulses[..usize::from(self.identity.channels)];
                    self.send_event(&Event::Telemetry(Telemetry::new(at, self.state, used)), hardware);
                }
                Due::DeadMan => {
                    self.last_packet = None;
                    self.telemetry = DurationMs(0);
                    self.trip(Fault::DeadMan, at, hardware);
                }
            }
        }
    }

    /// When [`Board::advance`] has something to do next.
    pub fn next_due(&self) -> Option<Ticks> {
        self.due().map(|(at, _)| at)
    }

    /// Latches a fault that the hardware found and puts every channel in its safe state. The first fault stays.
    pub fn trip(&mut self, fault: Fault, at: Ticks, hardware: &mut impl Hardware) {
        if self.state == State::Faulted {
            return;
        }
        self.state = State::Faulted;
        self.fault = fault;
        self.fault_at = at;
        self.make_safe(at, hardware);
        self.send_event(&Event::Happened { occurrence: Occurrence::Faulted, fault, at }, hardware);
    }

    fn due(&self) -> Option<(Ticks, Due)> {
        let start = (self.state == State::Armed).then_some((self.start, Due::Start));
        let pulses = self
            .channels
            .iter()
            .enumerate()
            .filter_map(|(index, channel)| channel.line.map(|line| (line.next, Due::Pulse(index))));
        let telemetry = (self.telemetry.0 > 0).then_some((self.telemetry_due, Due::Telemetry));
        let dead_man = self.last_packet.map(|at| (at.plus(self.dead_man.into()), Due::DeadMan));
        // Of what is due at the same tick the first named comes first; the dead-man has the last word.
        start
            .into_iter()
            .chain(pulses)
            .chain(telemetry)
            .chain(dead_man)
            .reduce(|first, other| if other.0.since(first.0) < 0 { other } else { first })
    }

    fn begin(&mut self, at: Ticks, hardware: &mut impl Hardware) {
        self.state = State::Running;
        self.send_event(
            &Event::Happened { occurrence: Occurrence::Started, fault: Fault::None, at },
            hardware,
        );
        for index in 0..MAX_CHANNELS {
            if self.channels[index].track.is_some() {
                self.next_segment(index, at);
            }
        }
        self.rest_if_still(at, hardware);
    }

    /// The next line of a running profile; where none runs, as after a jog during an upload, the channel comes to rest.
    fn next_segment(&mut self, index: usize, at: Ticks) {
        let runs = self.state == State::Running;
        let channel = &mut self.channels[index];
        channel.line = match (&mut channel.track, channel.pulse) {
            (Some(track), Some(pulse)) if runs => self.store.next_line(track, pulse, at),
            _ => None,
        };
    }

    fn update(&mut self, index: usize, at: Ticks, hardware: &mut impl Hardware) {
        let Some(mut line) = self.channels[index].line else { return };
        self.set_pulse(index, Some(line.at(at)), at, hardware);
        if line.end().reached(at) {
            self.next_segment(index, at);
            self.rest_if_still(at, hardware);
        } else {
            line.step(at);
            self.channels[index].line = Some(line);
        }
    }

    /// A profile or jogs are over when no channel moves any more.
    fn rest_if_still(&mut self, at: Ticks, hardware: &mut impl Hardware) {
        if self.channels.iter().any(|channel| channel.line.is_some()) {
            return;
        }
        match self.state {
            State::Running => {
                self.state = State::Idle;
                self.forget_profile();
                self.send_event(
                    &Event::Happened { occurrence: Occurrence::Finished, fault: Fault::None, at },
                    hardware,
                );
            }
            State::Jogging => self.state = State::Idle,
            State::Idle | State::Armed | State::Faulted => {}
        }
    }

    fn set_pulse(
        &mut self,
        index: usize,
        pulse: Option<PulseWidthUs>,
        at: Ticks,
        hardware: &mut impl Hardware,
    ) {
        let channel = &mut self.channels[index];
        if channel.pulse != pulse {
            channel.pulse = pulse;
            hardware.pulse(Channel(index as u8), pulse, at);
        }
    }

    fn make_safe(&mut self, at: Ticks, hardware: &mut impl Hardware) {
        self.forget_profile();
        for index in 0..MAX_CHANNELS {
            let ChannelState { config, pulse, .. } = self.channels[index];
            self.channels[index].line = None;
            let Some(config) = config else { continue };
            match config.safe_state {
                SafeState::Detach => self.set_pulse(index, None, at, hardware),
                SafeState::Hold => {}
                SafeState::Park => {
                    // Where a detached servo stands is unknown: a pulse could make it jump.
                    self.channels[index].line = pulse.map(|from| {
                        let duration = config.max_rate.shortest(from, config.park_pulse);
                        Line::new(from, config.park_pulse, at, duration)
                    });
                }
            }
        }
    }

    fn forget_profile(&mut self) {
        self.store.clear();
        self.uploading = None;
        for channel in &mut self.channels {
            channel.track = None;
        }
    }

    fn send_event(&mut self, event: &Event, hardware: &mut impl Hardware) {
        self.sequence.0 = self.sequence.0.wrapping_add(1);
        hardware.send(&event.encode(self.sequence).encode());
    }
}
