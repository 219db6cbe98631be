//! A mock board: the firmware's own state machine on a thread, behind a pseudo-terminal, on a clock that drifts.
//!
//! Whoever opens its port finds a serial port like any other; [`SerialBoard`] speaks to it byte by byte. Its pulses go
//! to a [`PulseSink`], stamped by the mock's true clock, and it can be made to fail at given times.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use firmware_protocol::board::{Board, BoardConfig, Hardware};
use firmware_protocol::event::Fault;
use firmware_protocol::sync_led;
use firmware_protocol::units::{Channel, Name, PulseWidthUs, Ticks};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde::{Deserialize, Serialize};

use super::pty::{Attached, Device, Pty};
use super::{SerialBoard, ServoConfig, ServoError};
use crate::PulseSink;
use ground::clock::MonotonicNs;

/// How a mock board fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum BoardFault {
    /// Its port goes away, as when the cable is pulled; the board itself goes on.
    #[serde(rename = "board-off")]
    Off,
    /// It neither receives nor answers; its dead-man and its pulses go on.
    #[serde(rename = "board-stuck")]
    Stuck,
    /// What it sends is damaged.
    #[serde(rename = "board-garbage")]
    Garbage,
    /// What it sends comes 100 ms late.
    #[serde(rename = "board-slow")]
    Slow,
    /// It restarts, as after a dip of its supply.
    #[serde(rename = "board-reset")]
    Reset,
}

impl std::str::FromStr for BoardFault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let full = if text.starts_with("board-") { text.to_owned() } else { format!("board-{text}") };
        serde_json::from_value(full.into())
            .map_err(|_| format!("no fault `{text}`; there are off, stuck, garbage, slow, reset"))
    }
}

/// Options of a mock board.
#[derive(Debug, Clone)]
pub struct MockOptions {
    /// Number of channels, at most 16.
    pub channels: u8,
    /// How fast its clock runs against the host's \[parts per million\].
    pub drift_ppm: f64,
    /// Its tick when it starts \[µs\].
    pub first_tick_us: u32,
    /// Boot id of its first start; each restart adds one.
    pub boot_id: u32,
    /// Faults and when they begin \[s\] after `run_start`.
    pub faults: Vec<(f64, BoardFault)>,
    /// When the run starts; faults wait until it is known.
    pub run_start: Arc<OnceLock<MonotonicNs>>,
}

impl Default for MockOptions {
    fn default() -> Self {
        Self {
            channels: 16,
            drift_ppm: 35.0,
            // Wraps 30 s after the start.
            first_tick_us: u32::MAX - 30_000_000,
            boot_id: MonotonicNs::now().0 as u32,
            faults: Vec::new(),
            run_start: Arc::default(),
        }
    }
}

/// A mock board at work; it ends when dropped.
#[derive(Debug)]
pub struct MockBoard(Device);

impl MockBoard {
    /// Starts a board that puts its pulses into `sink`.
    ///
    /// # Errors
    /// What the system says when it has no pseudo-terminal left.
    pub fn start(options: MockOptions, sink: Box<dyn PulseSink>) -> std::io::Result<Self> {
        Device::start("mock board", |pty, quit| Machine::new(options, pty, sink).run(quit)).map(Self)
    }

    /// The serial port to open.
    pub fn port(&self) -> &Path {
        self.0.port()
    }
}

/// A mock board and the serial connection to it, as one board.
pub type MockServo = Attached<SerialBoard, MockBoard>;

impl MockServo {
    /// Starts a mock board and opens its port.
    ///
    /// # Errors
    /// As [`SerialBoard::open`].
    pub fn open(
        config: &ServoConfig,
        options: MockOptions,
        sink: Box<dyn PulseSink>,
    ) -> Result<Self, ServoError> {
        Self::new(MockBoard::start(options, sink), |mock| {
            SerialBoard::open(&mock.port().to_string_lossy(), config)
        })
    }
}

/// The board's clock: ticks against the host's monotonic clock.
#[derive(Debug, Clone, Copy)]
struct TrueClock {
    start: MonotonicNs,
    first_tick_us: u32,
    rate: f64,
}

impl TrueClock {
    /// Whole ticks since the start.
    fn ticks(&self, at: MonotonicNs) -> i64 {
        (at.seconds_since(self.start) * 1e6 * self.rate).floor() as i64
    }

    fn tick(&self, at: MonotonicNs) -> Ticks {
        Ticks(self.first_tick_us.wrapping_add(self.ticks(at) as u32))
    }

    /// The host's time of `tick`, which lies within half a wrap of `near`.
    fn host(&self, tick: Ticks, near: MonotonicNs) -> MonotonicNs {
        let ticks = self.ticks(near) + i64::from(tick.since(self.tick(near)));
        self.start.plus_seconds(ticks as f64 * 1e-6 / self.rate)
    }
}

/// Longest sleep \[ns\], chosen: a fault or the end may come at any time, and pictures wait for it.
const MAX_SLEEP_NS: i64 = 5_000_000;
/// How much later answers come with [`BoardFault::Slow`] \[s\], chosen.
const SLOW_ANSWER_DELAY_S: f64 = 0.100;

struct Machine {
    options: MockOptions,
    clock: TrueClock,
    board: Board,
    pins: Pins,
    starts: u32,
    sync_led: SyncLed,
}

/// The pattern of the sync LED, which the tick alone decides: a restart goes on in it.
struct SyncLed {
    lit: bool,
    /// When the next slot begins.
    next: Ticks,
}

impl SyncLed {
    /// Reports to `pins` all slots that have begun by `now`.
    fn advance(&mut self, now: Ticks, pins: &mut Pins) {
        while now.since(self.next) >= 0 {
            let lit = sync_led::lit(self.next);
            if lit != std::mem::replace(&mut self.lit, lit) {
                pins.sink.sync_led(lit, pins.clock.host(self.next, pins.now));
            }
            self.next = Ticks(self.next.0.wrapping_add(sync_led::SLOT.0));
        }
    }
}

/// What the state machine touches.
struct Pins {
    clock: TrueClock,
    sink: Box<dyn PulseSink>,
    pty: Option<Pty>,
    now: MonotonicNs,
    stuck: bool,
    garbage: bool,
    slow: bool,
    noise: u32,
    delayed: std::collections::VecDeque<(MonotonicNs, Vec<u8>)>,
}

impl Hardware for Pins {
    fn pulse(&mut self, channel: Channel, pulse: Option<PulseWidthUs>, at: Ticks) {
        self.sink.pulse(channel.0, pulse.map(|p| p.0), self.clock.host(at, self.now));
    }

    fn send(&mut self, bytes: &[u8]) {
        if self.stuck {
            return;
        }
        let mut bytes = bytes.to_vec();
        if self.garbage {
            for byte in &mut bytes {
                self.noise = self.noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                *byte ^= (self.noise >> 24) as u8;
            }
        }
        if self.slow {
            self.delayed.push_back((self.now.plus_seconds(SLOW_ANSWER_DELAY_S), bytes));
        } else {
            self.write(&bytes);
        }
    }
}

impl Pins {
    fn write(&mut self, bytes: &[u8]) {
        if let Some(pty) = &self.pty {
            // Nobody reads, or not fast enough: lost, like on a wire.
            let _ = rustix::io::write(&pty.board, bytes);
        }
    }

    fn write_delayed(&mut self) {
        while self.delayed.front().is_some_and(|(due, _)| *due <= self.now)
            && let Some((_, bytes)) = self.delayed.pop_front()
        {
            self.write(&bytes);
        }
    }
}

impl Machine {
    fn new(options: MockOptions, pty: Pty, sink: Box<dyn PulseSink>) -> Self {
        let now = MonotonicNs::now();
        let clock = TrueClock {
            start: now,
            first_tick_us: options.first_tick_us,
            rate: 1.0 + options.drift_ppm * 1e-6,
        };
        let pins = Pins {
            clock,
            sink,
            pty: Some(pty),
            now,
            stuck: false,
            garbage: false,
            slow: false,
            noise: options.boot_id,
            delayed: Default::default(),
        };
        let tick = clock.tick(now);
        let board = Self::boot(&options, 0, tick);
        let sync_led = SyncLed { lit: false, next: Ticks(tick.0 - tick.0 % sync_led::SLOT.0) };
        Self { options, clock, board, pins, starts: 0, sync_led }
    }

    fn boot(options: &MockOptions, starts: u32, now: Ticks) -> Board {
        let config = BoardConfig {
            boot_id: options.boot_id.wrapping_add(starts),
            channels: options.channels,
            firmware: Name::new("rig mock 1").expect("a printable name"),
            fault: Fault::None,
        };
        Board::new(config, now)
    }

    fn run(mut self, quit: &AtomicBool) {
        self.board.greet(&mut self.pins);
        let mut bytes = [0; 512];
        while !quit.load(Ordering::Relaxed) {
            let length = self.wait(&mut bytes);
            let now = MonotonicNs::now();
            self.pins.now = now;
            let tick = self.clock.tick(now);
            self.play_faults(now, tick);
            if !self.pins.stuck {
                self.board.receive(&bytes[..length], tick, &mut self.pins);
            }
            self.board.advance(tick, &mut self.pins);
            self.sync_led.advance(tick, &mut self.pins);
            self.pins.sink.complete(now);
            self.pins.write_delayed();
        }
        // nothing comes from it any more
        self.pins.sink.complete(MonotonicNs(u64::MAX));
    }

    /// Sleeps until bytes come or something is due.
    fn wait(&mut self, bytes: &mut [u8]) -> usize {
        let due = self.board.next_due().map_or(i64::MAX, |due| {
            let at = self.clock.host(due, self.pins.now);
            at.0.saturating_sub(MonotonicNs::now().0).cast_signed()
        });
        let timeout = Timespec { tv_sec: 0, tv_nsec: due.clamp(0, MAX_SLEEP_NS) };
        let Some(pty) = &self.pins.pty else {
            std::thread::sleep(std::time::Duration::from_nanos(timeout.tv_nsec.unsigned_abs()));
            return 0;
        };
        let mut fds = [PollFd::new(&pty.board, PollFlags::IN)];
        match poll(&mut fds, Some(&timeout)) {
            Ok(1..) => rustix::io::read(&pty.board, bytes).unwrap_or(0),
            _ => 0,
        }
    }

    fn play_faults(&mut self, now: MonotonicNs, tick: Ticks) {
        let Some(&start) = self.options.run_start.get() else { return };
        let since_s = now.seconds_since(start);
        let due: Vec<BoardFault> = self
            .options
            .faults
            .extract_if(.., |(at_s, _)| *at_s <= since_s)
            .map(|(_, fault)| fault)
            .collect();
        for fault in due {
            tracing::info!("mock board: {fault:?} at {since_s:.3} s");
            match fault {
                BoardFault::Off => self.pins.pty = None,
                BoardFault::Stuck => self.pins.stuck = true,
                BoardFault::Garbage => self.pins.garbage = true,
                BoardFault::Slow => self.pins.slow = true,
                BoardFault::Reset => self.reset(now, tick),
            }
        }
    }

    fn reset(&mut self, now: MonotonicNs, tick: Ticks) {
        for number in (0..self.options.channels).filter(|&n| self.board.pulse(Channel(n)).is_some()) {
            self.pins.sink.pulse(number, None, now);
        }
        self.starts += 1;
        self.board = Self::boot(&self.options, self.starts, tick);
        self.board.greet(&mut self.pins);
    }
}
