//! A bus of emulated servos behind a pseudo-terminal, in this process: whoever opens its port finds a serial port, and servos that speak
//! their maker's protocol byte by byte. They turn as servos do, and can be made to fail at given times.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde::{Deserialize, Serialize};

use super::BusBoard;
use super::emulated_servo::EmulatedServo;
use super::packet::{Decoder, Packet, Protocol};
use super::registers::Registers;
use crate::pty::{Attached, Device, Pty};
use crate::travel::Travel;
use crate::{PulseSink, ServoConfig, ServoError};
use ground::clock::MonotonicNs;

/// How an emulated bus fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum BusFault {
    /// Its port goes away, as when the cable is pulled.
    #[serde(rename = "bus-off")]
    Off,
    /// Nothing that is sent reaches a servo, and nothing comes back.
    #[serde(rename = "bus-stuck")]
    Stuck,
    /// What servos send is damaged.
    #[serde(rename = "bus-garbage")]
    Garbage,
    /// What servos send comes 100 ms late.
    #[serde(rename = "bus-slow")]
    Slow,
    /// The first servo is unplugged; the others go on.
    #[serde(rename = "servo-off")]
    ServoOff,
    /// The first servo restarts, as after a dip of its supply.
    #[serde(rename = "servo-reset")]
    ServoReset,
    /// The first servo switches its torque off: overload.
    #[serde(rename = "servo-overload")]
    ServoOverload,
    /// The first servo cannot turn.
    #[serde(rename = "servo-blocked")]
    ServoBlocked,
    /// The first servo answers as if it were another one.
    #[serde(rename = "servo-wrong-id")]
    ServoWrongId,
}

/// What an emulated bus is like.
#[derive(Debug, Clone)]
pub struct BusOptions {
    /// The protocol of its servos.
    pub protocol: Protocol,
    /// ID of each servo, and where it stands at first \[counts\].
    pub servos: Vec<(u8, u16)>,
    /// Faults and when they begin \[s\] after `run_start`.
    pub faults: Vec<(f64, BusFault)>,
    /// When the run starts; faults wait until it is known.
    pub run_start: Arc<OnceLock<MonotonicNs>>,
}

impl BusOptions {
    /// The servos of `config`, each at its zero; without faults. None for a config without a bus.
    pub fn of(config: &ServoConfig) -> Option<Self> {
        let servos = config.channels.iter().filter_map(|channel| match &channel.travel {
            Travel::Counts(travel) => Some((channel.id, travel.zero_count)),
            Travel::Pulses(_) => None,
        });
        Some(Self {
            protocol: Registers::of(config.kind)?.protocol,
            servos: servos.collect(),
            faults: Vec::new(),
            run_start: Arc::default(),
        })
    }
}

/// A bus of emulated servos at work; it ends when dropped.
#[derive(Debug)]
pub struct EmulatedBus(Device);

impl EmulatedBus {
    /// Starts a bus whose servos' motion goes into `sink`.
    ///
    /// # Errors
    /// What the system says when it has no pseudo-terminal left.
    pub fn start(options: BusOptions, sink: Box<dyn PulseSink>) -> std::io::Result<Self> {
        Device::start("emulated bus", |pty, quit| Machine::new(options, pty, sink).run(quit)).map(Self)
    }

    /// The serial port to open.
    pub fn port(&self) -> &Path {
        self.0.port()
    }
}

/// An emulated bus and the connection to it, as one board.
pub type EmulatedBusBoard = Attached<BusBoard, EmulatedBus>;

impl EmulatedBusBoard {
    /// Starts the emulated bus and opens its port.
    ///
    /// # Errors
    /// As [`BusBoard::open`].
    pub fn open(
        config: &ServoConfig,
        options: BusOptions,
        sink: Box<dyn PulseSink>,
    ) -> Result<Self, ServoError> {
        Self::new(EmulatedBus::start(options, sink), |bus| {
            BusBoard::open(&bus.port().to_string_lossy(), config)
        })
    }
}

/// Time step in which the motion is computed and reported \[ns\], chosen.
const MOTION_STEP_NS: u64 = 1_000_000;
/// How much later answers come with [`BusFault::Slow`] \[s\], chosen.
const SLOW_ANSWER_DELAY_S: f64 = 0.100;

struct Machine {
    options: BusOptions,
    decoder: Decoder,
    servos: Vec<EmulatedServo>,
    pty: Option<Pty>,
    sink: Box<dyn PulseSink>,
    /// Motion was computed and reported until here.
    reported_until: MonotonicNs,
    /// The position that was last reported of each servo \[counts\].
    last_reported: Vec<Option<f64>>,
    stuck: bool,
    garbage: bool,
    slow: bool,
    off: bool,
    wrong_id: bool,
    noise: u32,
    delayed: VecDeque<(MonotonicNs, Vec<u8>)>,
}

impl Machine {
    fn new(options: BusOptions, pty: Pty, sink: Box<dyn PulseSink>) -> Self {
        let now = MonotonicNs::now();
        let servo = |&(id, count): &(u8, u16)| EmulatedServo::new(options.protocol, id, count, now);
        Self {
            decoder: Decoder::new(options.protocol),
            servos: options.servos.iter().map(servo).collect(),
            pty: Some(pty),
            sink,
            reported_until: now,
            last_reported: vec![None; options.servos.len()],
            stuck: false,
            garbage: false,
            slow: false,
            off: false,
            wrong_id: false,
            noise: 1,
            delayed: VecDeque::new(),
            options,
        }
    }

    fn run(mut self, quit: &AtomicBool) {
        let mut bytes = [0; 512];
        while !quit.load(Ordering::Relaxed) {
            let length = self.wait(&mut bytes);
            let now = MonotonicNs::now();
            self.play_faults(now);
            self.turn(now);
            if !self.stuck {
                for packet in self.decoder.receive(&bytes[..length]).into_iter().flatten() {
                    self.handle(&packet, now);
                }
            }
            self.report_positions(now);
            self.sink.complete(now);
            self.send_delayed(now);
        }
        self.sink.complete(MonotonicNs(u64::MAX));
    }

    /// Sleeps until bytes come or the next motion step is due.
    fn wait(&mut self, bytes: &mut [u8]) -> usize {
        let step = Timespec { tv_sec: 0, tv_nsec: MOTION_STEP_NS.cast_signed() };
        let Some(pty) = &self.pty else {
            std::thread::sleep(std::time::Duration::from_nanos(MOTION_STEP_NS));
            return 0;
        };
        let mut fds = [PollFd::new(&pty.board, PollFlags::IN)];
        match poll(&mut fds, Some(&step)) {
            Ok(1..) => rustix::io::read(&pty.board, bytes).unwrap_or(0),
            _ => 0,
        }
    }

    /// Turns the servos step by step until `now`, and reports each step.
    fn turn(&mut self, now: MonotonicNs) {
        while self.reported_until.0 + MOTION_STEP_NS <= now.0 {
            self.reported_until = MonotonicNs(self.reported_until.0 + MOTION_STEP_NS);
            self.servos.iter_mut().for_each(|servo| servo.turn(self.reported_until));
            self.report_positions(self.reported_until);
        }
    }

    fn report_positions(&mut self, at: MonotonicNs) {
        for (servo, last) in self.servos.iter().zip(&mut self.last_reported) {
            let position = servo.powered_position();
            if position != *last {
                self.sink.position(servo.id, position, at);
                *last = position;
            }
        }
    }

    fn handle(&mut self, packet: &Packet, now: MonotonicNs) {
        let first = self.servos.first().map(|servo| servo.id);
        let mut answers = Vec::new();
        for servo in &mut self.servos {
            if self.off && Some(servo.id) == first {
                continue;
            }
            answers.extend(servo.handle(packet, now));
        }
        // In the order of the question; behind one that is missing nobody answers.
        let asked: Vec<u8> = packet.parameters.clone();
        answers.sort_by_key(|status| asked.iter().rposition(|id| *id == status.id));
        if packet.code == super::packet::instruction::SYNC_READ && self.off {
            let place = asked.iter().rposition(|id| Some(*id) == first);
            answers.retain(|status| asked.iter().rposition(|id| *id == status.id) < place);
        }
        for mut status in answers {
            if self.wrong_id && Some(status.id) == first {
                status.id = status.id.wrapping_add(100);
            }
            let protocol = self.options.protocol;
            let bytes = protocol.encode(&protocol.status(&status));
            self.send(bytes, now);
        }
    }

    fn send(&mut self, mut bytes: Vec<u8>, now: MonotonicNs) {
        if self.garbage {
            for byte in &mut bytes {
                self.noise = self.noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                *byte ^= (self.noise >> 24) as u8;
            }
            // A header, so that it is a packet, with a wrong checksum.
            bytes[0] = 0xFF;
            bytes[1] = 0xFF;
        }
        let delay_s = if self.slow { SLOW_ANSWER_DELAY_S } else { 0.0 };
        self.delayed.push_back((now.plus_seconds(delay_s), bytes));
        self.send_delayed(now);
    }

    fn send_delayed(&mut self, now: MonotonicNs) {
        while self.delayed.front().is_some_and(|(due, _)| *due <= now)
            && let Some((_, bytes)) = self.delayed.pop_front()
        {
            if let Some(pty) = &self.pty {
                // Nobody reads, or not fast enough: lost, like on a wire.
                let _ = rustix::io::write(&pty.board, &bytes);
            }
        }
    }

    fn play_faults(&mut self, now: MonotonicNs) {
        let Some(&start) = self.options.run_start.get() else { return };
        let since_s = now.seconds_since(start);
        let due: Vec<BusFault> = self
            .options
            .faults
            .extract_if(.., |(at_s, _)| *at_s <= since_s)
            .map(|(_, fault)| fault)
            .collect();
        for fault in due {
            tracing::info!("emulated bus: {fault:?} at {since_s:.3} s");
            match fault {
                BusFault::Off => self.pty = None,
                BusFault::Stuck => self.stuck = true,
                BusFault::Garbage => self.garbage = true,
                BusFault::Slow => self.slow = true,
                BusFault::ServoOff => self.off = true,
                BusFault::ServoWrongId => self.wrong_id = true,
                BusFault::ServoReset => self.first(EmulatedServo::power_up),
                BusFault::ServoOverload => self.first(EmulatedServo::overload),
                BusFault::ServoBlocked => self.first(|servo| servo.blocked = true),
            }
        }
    }

    fn first(&mut self, does: impl FnOnce(&mut EmulatedServo)) {
        if let Some(servo) = self.servos.first_mut() {
            does(servo);
        }
    }
}
