//! A board on a serial port.
//!
//! One thread owns the port: it reads, sends pings and whatever else the link has to send. The owner's calls put one
//! command under way and wait for its end; an e-stop goes ahead of it. A port that is gone ends the thread.

use std::io::Write as _;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use firmware_protocol::VERSION;
use firmware_protocol::command::{Command, MAX_SEGMENTS_PER_PACKET, Segment, Segments};
use firmware_protocol::event::{Ack, Event, Fault, Identity, Refusal, Status};
use firmware_protocol::units::{Channel, DurationMs, DurationUs, PulseWidthUs, Ticks};
use serialport::SerialPort;

use super::link::{Link, Trouble};
use super::port::{self, HELLO_TIMEOUT, Received};
pub use super::sessionless::{emergency_stop, query_status, release};
use super::{BoardInfo, ServoBoard, ServoConfig, ServoError, ServoEvent, StopOutcome, refusal};
use crate::PulseProfile;
use ground::clock::{ClockFit, MonotonicNs, Wire};
use ground::urgency::Urgency;

/// Time between two hellos while no answer has come, chosen.
const HELLO_PERIOD: Duration = Duration::from_millis(200);
/// Pings of a burst, for a clock good enough to arm by; chosen.
const CLOCK_BURST_PINGS: u32 = 8;
/// How long a command's end is awaited, chosen: its three tries take 175 ms, so more means that the thread is held up.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);
/// How long an e-stop is repeated before the board is left to its dead-man, chosen.
const STOP_TIMEOUT: Duration = Duration::from_millis(200);
/// How long pings are gathered for a clock that a run may be armed by, chosen: on a busy line few of them are quick, and only quick ones
/// determine the clock. A line without a quick one by then will not have one later.
const CLOCK_TIMEOUT: Duration = Duration::from_secs(3);
/// How far ahead of the present the clock must be known, to start a profile that is armed at once \[s\]; chosen. Quick pings close together
/// determine the clock's rate badly.
const CLOCK_FORECAST_S: f64 = 1.0;
/// Greatest standard deviation of the clock at the start of a profile with which arming is allowed \[s\], chosen.
const MAX_CLOCK_SIGMA_S: f64 = 1e-3;

/// A board on a serial port.
pub struct SerialBoard {
    port_name: String,
    info: BoardInfo,
    identity: Identity,
    wire: Wire,
    shared: Arc<Shared>,
    /// A second handle of the port, to drop DTR while the thread may be held up.
    port: Box<dyn SerialPort>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    link: Mutex<Link>,
    changed: Condvar,
    quit: std::sync::atomic::AtomicBool,
}

impl Shared {
    fn link(&self) -> MutexGuard<'_, Link> {
        // A panic elsewhere must not prevent an e-stop.
        self.link.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until `done` returns something, at most `timeout`.
    fn wait<T>(
        &self,
        mut link: MutexGuard<'_, Link>,
        timeout: Duration,
        mut done: impl FnMut(&mut Link) -> Option<T>,
    ) -> Option<T> {
        let deadline = Instant::now() + timeout;
        loop {
            if let Some(found) = done(&mut link) {
                return Some(found);
            }
            let left = deadline.checked_duration_since(Instant::now())?;
            link = self.changed.wait_timeout(link, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl SerialBoard {
    /// Opens the port named `port_name`, shakes hands, configures the board's channels and starts its heartbeat.
    ///
    /// A fault latched because a host fell silent or restarted is acknowledged, with a note: whoever opens the board again accepts it.
    /// An emergency stop, and what the board found itself (supply, overload, watchdog), only a person acknowledges: [`release`].
    ///
    /// # Errors
    /// [`ServoError::Open`], [`ServoError::Handshake`], [`ServoError::Stopped`], [`ServoError::Fault`], [`ServoError::Refused`].
    pub fn open(port_name: &str, config: &ServoConfig) -> Result<Self, ServoError> {
        let port = port::open(port_name, config.baud)?;
        let clone = |port: &dyn SerialPort| {
            port.try_clone()
                .map_err(|error| ServoError::Open { port: port_name.into(), why: error.to_string() })
        };
        let silence_s = f64::from(config.dead_man_ms) * 1e-3;
        let now = MonotonicNs::now();
        let shared = Arc::new(Shared {
            link: Mutex::new(Link::new(silence_s, now.0 as u16, now)),
            changed: Condvar::new(),
            quit: false.into(),
        });
        let thread = {
            let (shared, port) = (Arc::clone(&shared), clone(&*port)?);
            std::thread::Builder::new()
                .name("servo link".into())
                .spawn(move || {
                    Urgency::Servo.take();
                    converse(port, &shared)
                })
                .map_err(|error| ServoError::Open { port: port_name.into(), why: error.to_string() })?
        };
        let nobody = Identity {
            boot_id: 0,
            channels: 0,
            max_segments: 0,
            firmware: firmware_protocol::units::Name::new("unknown").expect("a printable name"),
        };
        let info = BoardInfo { name: port_name.into(), protocol_version: VERSION, boot_id: 0, channels: 0 };
        let mut board = Self {
            port_name: port_name.into(),
            info,
            identity: nobody,
            wire: config.wire(),
            shared,
            port,
            thread: Some(thread),
        };
        board.shake_hands()?;
        board.set_up(config)?;
        Ok(board)
    }

    /// The line between the board's ticks and the host's clock, from the last minute's pings.
    pub fn clock(&self) -> Option<ClockFit> {
        ClockFit::new(self.shared.link().samples(), self.wire)
    }

    fn shake_hands(&mut self) -> Result<(), ServoError> {
        let deadline = Instant::now() + HELLO_TIMEOUT;
        let (identity, version) = loop {
            let mut link = self.shared.link();
            link.ask(Command::Hello, MonotonicNs::now());
            let answered = self.shared.wait(link, HELLO_PERIOD, |link| match link.take_answer() {
                Some(Ok(Event::Hello(_))) => link.board,
                _ => None,
            });
            if let Some(board) = answered {
                break board;
            }
            let mut link = self.shared.link();
            if let Some(Trouble::Gone(why)) = link.take_trouble() {
                return Err(ServoError::Lost { port: self.port_name.clone(), why });
            }
            if Instant::now() > deadline {
                return Err(ServoError::Handshake {
                    port: self.port_name.clone(),
                    why: port::no_hello(link.bytes, link.damaged),
                });
            }
        };
        if version != VERSION {
            return Err(ServoError::Handshake {
                port: self.port_name.clone(),
                why: format!(
                    "firmware `{}` speaks protocol version {version}, this program {VERSION}; flash firmware of version \
                     {VERSION} (status and estop work meanwhile)",
                    identity.firmware
                ),
            });
        }
        self.identity = identity;
        self.info = BoardInfo {
            name: format!("{} ({})", self.port_name, identity.firmware),
            protocol_version: version,
            boot_id: identity.boot_id,
            channels: identity.channels,
        };
        Ok(())
    }

    fn set_up(&mut self, config: &ServoConfig) -> Result<(), ServoError> {
        match self.status()?.fault {
            Fault::None => {}
            fault @ (Fault::DeadMan | Fault::HostRestarted) => {
                self.request("acknowledge", Command::Acknowledge(fault))?;
                self.shared.link().note(format!("board had stopped before ({fault}); acknowledged"));
            }
            Fault::EStop => return Err(ServoError::Stopped { port: self.port_name.clone() }),
            fault => {
                let reason = format!(
                    "{fault}; latched since before this session: see to it, then `rig release CONFIG --by NAME`"
                );
                return Err(ServoError::Fault { reason });
            }
        }
        // From the hello on the dead-man watches; the commands so far have kept it from acting.
        let mut link = self.shared.link();
        link.keep_alive(CLOCK_BURST_PINGS, MonotonicNs::now());
        link.expect_fault(Fault::None);
        match link.take_trouble() {
            // The fault acknowledged above, if the board has reported it too.
            None | Some(Trouble::Fault(_)) => drop(link),
            Some(trouble) => {
                drop(link);
                return Err(self.error(trouble));
            }
        }
        for channel in &config.channels {
            let wire = channel.to_wire().ok_or_else(|| ServoError::Refused {
                request: format!("configuring channel `{}`", channel.name),
                why: "its name does not fit; use 1 to 16 ASCII characters".into(),
            })?;
            self.request(&format!("configuring channel `{}`", channel.name), Command::Configure(wire))?;
        }
        self.shared.link().watch(config.channels.iter().map(|channel| channel.id).collect());
        let timing = Command::Timing {
            dead_man: DurationMs(config.dead_man_ms),
            telemetry: DurationMs(config.telemetry_ms),
        };
        self.request("setting the dead-man", timing)?;
        self.gather_pings();
        Ok(())
    }

    /// Pings until the clock is good enough to arm by, for [`CLOCK_TIMEOUT`] at most. Without success nothing is refused yet: only
    /// arming needs a clock.
    fn gather_pings(&self) {
        let deadline = Instant::now() + CLOCK_TIMEOUT;
        loop {
            let link = self.shared.link();
            let over = |link: &mut Link| (link.burst_is_over() || link.ended().is_some()).then_some(());
            self.shared.wait(link, ANSWER_TIMEOUT, over);
            let at = MonotonicNs::now().plus_seconds(CLOCK_FORECAST_S);
            let is_known = || self.clock().is_some_and(|clock| clock.sigma_s(at) <= MAX_CLOCK_SIGMA_S);
            if is_known() || Instant::now() >= deadline || self.shared.link().ended().is_some() {
                return;
            }
            self.shared.link().burst(CLOCK_BURST_PINGS);
        }
    }

    /// How the board is.
    ///
    /// # Errors
    /// [`ServoError::Lost`] when it does not answer.
    pub fn status(&mut self) -> Result<Status, ServoError> {
        match self.ask("status", Command::Status)? {
            Event::Status(status) => Ok(status),
            other => Err(self.nonsense("status", &other)),
        }
    }

    /// Puts one command under way and waits for its end.
    fn ask(&mut self, request: &str, command: Command) -> Result<Event, ServoError> {
        let mut link = self.shared.link();
        link.ask(command, MonotonicNs::now());
        let answer = self.shared.wait(link, ANSWER_TIMEOUT, Link::take_answer);
        if let Some(Ok(event)) = answer {
            return Ok(event);
        }
        let mut link = self.shared.link();
        let trouble = link.take_trouble().or_else(|| link.ended().cloned());
        drop(link);
        Err(match trouble {
            Some(trouble) => self.error(trouble),
            None => ServoError::Lost {
                port: self.port_name.clone(),
                why: format!("no answer to {request}, sent 3 times; check cable and supply"),
            },
        })
    }

    /// Sends a command whose answer is an acknowledgement.
    fn request(&mut self, request: &str, command: Command) -> Result<(), ServoError> {
        match self.ask(request, command)? {
            Event::Ack(Ack { refusal: Refusal::None, .. }) => Ok(()),
            Event::Ack(ack) => {
                Err(ServoError::Refused { request: request.into(), why: refusal::explain(&ack) })
            }
            other => Err(self.nonsense(request, &other)),
        }
    }

    fn nonsense(&self, request: &str, answer: &Event) -> ServoError {
        let why = format!("{request} was answered by {answer:?}; its firmware is at fault");
        ServoError::Handshake { port: self.port_name.clone(), why }
    }

    fn error(&self, trouble: Trouble) -> ServoError {
        let port = self.port_name.clone();
        match trouble {
            Trouble::Silent(silent_s, damaged) => {
                let why = format!(
                    "nothing valid for {:.0} ms ({damaged} damaged packets since opening); check cable and supply",
                    silent_s * 1e3
                );
                ServoError::Lost { port, why }
            }
            Trouble::Gone(why) => ServoError::Lost { port, why },
            Trouble::Restarted { before, after } => ServoError::Restarted { port, before, after },
            Trouble::Fault(Fault::EStop) => ServoError::Stopped { port },
            Trouble::Fault(fault) => ServoError::Fault { reason: fault.text().into() },
        }
    }

    fn upload(&mut self, profile: &PulseProfile) -> Result<u16, ServoError> {
        let count: usize = profile.tracks.iter().map(|track| track.segments.len()).sum();
        let too_many = || ServoError::Refused {
            request: "uploading the profile".into(),
            why: format!(
                "{count} segments, and the board holds {}; reduce cycles",
                self.identity.max_segments
            ),
        };
        let total = u16::try_from(count).map_err(|_| too_many())?;
        if total > self.identity.max_segments {
            return Err(too_many());
        }
        self.request("clearing the profile", Command::Clear)?;
        for track in &profile.tracks {
            let (channel, request) =
                (Channel(track.channel), format!("uploading the profile of channel {}", track.channel));
            let start_pulse = PulseWidthUs(track.start_pulse);
            // The total fits in u16, so does each track.
            let announce = Command::Track { channel, start_pulse, segments: track.segments.len() as u16 };
            self.request(&request, announce)?;
            let wire: Vec<Segment> = track
                .segments
                .iter()
                .map(|&(us, pulse)| Segment { duration: DurationUs(us), end_pulse: PulseWidthUs(pulse) })
                .collect();
            for (part, first) in
                wire.chunks(MAX_SEGMENTS_PER_PACKET).zip((0u16..).step_by(MAX_SEGMENTS_PER_PACKET))
            {
                if let Some(segments) = Segments::new(part) {
                    self.request(&request, Command::Segments { channel, first, segments })?;
                }
            }
        }
        Ok(total)
    }
}

impl ServoBoard for SerialBoard {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    fn arm(&mut self, profile: &PulseProfile, start: MonotonicNs) -> Result<(), ServoError> {
        let segments = self.upload(profile)?;
        let refused = |why: String| ServoError::Refused { request: "arming".into(), why };
        let clock = self.clock().ok_or_else(|| refused("no clock pings answered yet; try again".into()))?;
        let sigma_s = clock.sigma_s(start);
        if sigma_s > MAX_CLOCK_SIGMA_S {
            return Err(refused(format!(
                "the board's clock is known to {:.1} ms only, limit {:.1} ms; shortest round trip {:.1} ms: set a USB \
                 bridge's latency timer to 1 ms, or relieve this computer",
                sigma_s * 1e3,
                MAX_CLOCK_SIGMA_S * 1e3,
                clock.round_trip_min_s * 1e3
            )));
        }
        let tick_us = clock.board_tick_us(start);
        self.request("arming", Command::Arm { start: Ticks(tick_us as u32), segments })?;
        self.shared.link().armed(tick_us, tick_us + profile.duration_us());
        Ok(())
    }

    fn jog(&mut self, channel: u8, pulse_us: u16, duration_s: f64) -> Result<(), ServoError> {
        let us = (duration_s * 1e6).round();
        if !(0.0..=f64::from(u32::MAX)).contains(&us) {
            let why = format!("{duration_s} s is no duration between 0 and 4294 s");
            return Err(ServoError::Refused { request: "jog".into(), why });
        }
        let (pulse, duration) = (PulseWidthUs(pulse_us), DurationUs(us as u32));
        self.request("jog", Command::Jog { channel: Channel(channel), pulse, duration })
    }

    fn poll(&mut self) -> Result<Vec<ServoEvent>, ServoError> {
        let mut link = self.shared.link();
        match link.take_trouble() {
            Some(trouble) => {
                drop(link);
                Err(self.error(trouble))
            }
            None => Ok(link.take_events()),
        }
    }

    fn stop(&mut self) -> StopOutcome {
        let mut link = self.shared.link();
        link.e_stop();
        let thread_lives = || self.thread.as_ref().is_some_and(|thread| !thread.is_finished());
        let stopped = self.shared.wait(link, STOP_TIMEOUT, |link| {
            if link.is_stopped() { Some(true) } else { (!thread_lives()).then_some(false) }
        });
        if stopped == Some(true) {
            return StopOutcome::Acknowledged;
        }
        let mut link = self.shared.link();
        link.mute();
        // Boards with a USB port of their own stop when DTR falls. Where there is no such line it fails: no matter.
        let dtr = self.port.write_data_terminal_ready(false);
        link.note(match dtr {
            Ok(()) => "e-stop not acknowledged: dropped DTR, left to the dead-man".to_owned(),
            Err(error) => {
                format!("e-stop not acknowledged: dropping DTR failed ({error}), left to the dead-man")
            }
        });
        StopOutcome::LeftToDeadMan
    }

    fn leave(&mut self) -> StopOutcome {
        let is_stopped = self.shared.link().is_stopped();
        // a goodbye never latches anything; in the middle of a profile it is refused
        if !is_stopped && self.request("goodbye", Command::Goodbye).is_ok() {
            return StopOutcome::Acknowledged;
        }
        let outcome = if is_stopped { StopOutcome::Acknowledged } else { self.stop() };
        if outcome == StopOutcome::Acknowledged
            && self.request("acknowledge", Command::Acknowledge(Fault::EStop)).is_ok()
        {
            self.shared.link().expect_fault(Fault::None);
        }
        outcome
    }
}

impl Drop for SerialBoard {
    fn drop(&mut self) {
        if self.shared.link().is_armed() {
            self.stop();
        } else if self.identity.channels > 0 {
            // Without a goodbye the dead-man would latch a fault, which does no harm.
            let _ = self.ask("goodbye", Command::Goodbye);
        }
        self.shared.quit.store(true, std::sync::atomic::Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The thread: reads first, judges silence after, so that its own lateness is not taken for the board's.
fn converse(mut port: Box<dyn SerialPort>, shared: &Shared) {
    let mut bytes = [0; 256];
    while !shared.quit.load(std::sync::atomic::Ordering::Relaxed) {
        // A ping goes out when it is due, not when a read has ended: reads end in step with the USB bus, and pings must not.
        let due_s = shared.link().next_ping().map(|at| at.seconds_since(MonotonicNs::now()).max(0.0));
        let within = due_s.map_or(port::READ_TIMEOUT, ground::strict::duration);
        let received = port::read_within(&mut *port, &mut bytes, within);
        let now = MonotonicNs::now();
        let mut link = shared.link();
        match received {
            Received::Bytes(length) => link.receive(&bytes[..length], now),
            Received::Nothing => {}
            Received::Gone(why) => {
                link.gone(why);
                // No answer will come: this ends the wait for one.
                link.next_packet(now);
                shared.changed.notify_all();
                return;
            }
        }
        while let Some(line) = link.next_packet(MonotonicNs::now()) {
            // A line that takes no bytes answers none either: silence or the next read reports it.
            if let Err(error) = port.write_all(&line) {
                tracing::debug!("writing to the servo board: {error}");
                break;
            }
        }
        drop(link);
        shared.changed.notify_all();
    }
}
