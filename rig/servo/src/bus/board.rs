//! Servos on a bus as one board: a thread of its own sends them positions, reads their positions back, and makes them safe when anything
//! is wrong, without waiting for its owner.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use super::line::{Gone, MAX_ANSWER_DELAY_S};
use super::punctuality::Punctuality;
use super::servos::{PositionReading, Servos};
use super::stream::{MIN_START_LEAD_S, Stream};
use crate::{BoardInfo, PulseProfile, ServoBoard, ServoConfig, ServoError, ServoEvent, StopOutcome};
use ground::clock::MonotonicNs;
use ground::urgency::Urgency;

/// Time between reading positions while nothing has torque \[s\], chosen.
const IDLE_READ_PERIOD_S: f64 = 0.1;
/// Without torque a servo counts as lost no sooner than after this silence \[s\]: four readings, chosen.
const IDLE_SILENCE_LIMIT_S: f64 = 0.4;
/// Time between checks of one servo's torque and watchdog \[s\], chosen.
const TORQUE_CHECK_PERIOD_S: f64 = 0.1;
/// The answer to such a check is awaited until the next position is due, and at least for this long \[s\], chosen.
const TORQUE_CHECK_MIN_WAIT_S: f64 = 0.002;
/// Time between pings, which only record that the bus's clock is this computer's \[s\], chosen.
const PING_PERIOD_S: f64 = 0.5;
/// Share of a streaming period in which answers are awaited, chosen.
const ANSWER_WINDOW_SHARE: f64 = 0.7;
/// Most events that are stored for an owner that does not poll; later ones are dropped and counted.
const MAX_STORED_EVENTS: usize = 50_000;

enum Order {
    Jog { id: u8, count: u16, duration_s: f64, reply: SyncSender<Result<(), ServoError>> },
    Arm { profile: PulseProfile, start: MonotonicNs, reply: SyncSender<Result<(), ServoError>> },
    Stop { reply: SyncSender<StopOutcome> },
}

/// What the thread has to hand to the board's owner.
#[derive(Default)]
struct Outbox {
    events: Vec<ServoEvent>,
    dropped: u64,
    trouble: Option<ServoError>,
}

impl Outbox {
    fn push(&mut self, event: ServoEvent) {
        if self.events.len() < MAX_STORED_EVENTS {
            self.events.push(event);
        } else {
            self.dropped += 1;
        }
    }
}

fn lock(outbox: &Mutex<Outbox>) -> MutexGuard<'_, Outbox> {
    outbox.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Servos on a bus.
pub struct BusBoard {
    info: BoardInfo,
    orders: Option<Sender<Order>>,
    outbox: Arc<Mutex<Outbox>>,
    thread: Option<JoinHandle<()>>,
}

impl BusBoard {
    /// Opens the port named `port_name` and looks at each servo of `config`. None gets torque before the first move.
    ///
    /// # Errors
    /// [`ServoError::Open`]; [`ServoError::Handshake`], [`ServoError::Fault`] and [`ServoError::Lost`] naming the servo.
    pub fn open(port_name: &str, config: &ServoConfig) -> Result<Self, ServoError> {
        let mut servos = Servos::open(port_name, config)?;
        servos.check()?;
        let count = servos.servos.len();
        let info = BoardInfo {
            name: format!("{port_name} ({count} {} on a bus)", servos.registers.name),
            protocol_version: match servos.registers.protocol {
                super::packet::Protocol::Dynamixel2 => 2,
                super::packet::Protocol::Feetech => 1,
            },
            boot_id: 0,
            channels: u8::try_from(count).unwrap_or(u8::MAX),
        };
        let (orders, inbox) = channel();
        let mut outbox = Outbox::default();
        std::mem::take(&mut servos.notes).into_iter().for_each(|text| outbox.push(ServoEvent::Note { text }));
        let outbox = Arc::new(Mutex::new(outbox));
        let courses = servos.servos.iter().map(|s| (s.id, s.name.clone(), s.travel.clone()));
        let period_s = config.stream_period_s();
        let driver = Driver {
            stream: Stream::new(courses, period_s),
            servos,
            outbox: Arc::clone(&outbox),
            period_s,
            max_late_s: config.max_late_s(),
            engaged: false,
            ended: None,
            punctuality: Punctuality::new(period_s),
            due: MonotonicNs::now(),
            next_check: MonotonicNs(0),
            next_ping: MonotonicNs(0),
            checks: 0,
        };
        let thread = std::thread::Builder::new()
            .name("servo bus".into())
            .spawn(move || {
                Urgency::Servo.take();
                driver.run(&inbox)
            })
            .map_err(|error| ServoError::Open { port: port_name.into(), why: error.to_string() })?;
        Ok(Self { info, orders: Some(orders), outbox, thread: Some(thread) })
    }

    fn request(
        &self,
        request: &str,
        order: impl FnOnce(SyncSender<Result<(), ServoError>>) -> Order,
    ) -> Result<(), ServoError> {
        let (reply, answer) = sync_channel(1);
        let sent = self.orders.as_ref().is_some_and(|orders| orders.send(order(reply)).is_ok());
        let answer = if sent { answer.recv().ok() } else { None };
        answer.unwrap_or_else(|| {
            Err(ServoError::Lost {
                port: self.info.name.clone(),
                why: format!("the bus's thread ended before {request}"),
            })
        })
    }
}

impl ServoBoard for BusBoard {
    fn info(&self) -> &BoardInfo {
        &self.info
    }

    fn arm(&mut self, profile: &PulseProfile, start: MonotonicNs) -> Result<(), ServoError> {
        self.request("arming", |reply| Order::Arm { profile: profile.clone(), start, reply })
    }

    fn jog(&mut self, channel: u8, pulse: u16, duration_s: f64) -> Result<(), ServoError> {
        self.request("a jog", |reply| Order::Jog { id: channel, count: pulse, duration_s, reply })
    }

    fn poll(&mut self) -> Result<Vec<ServoEvent>, ServoError> {
        let mut outbox = lock(&self.outbox);
        if let Some(trouble) = outbox.trouble.take() {
            return Err(trouble);
        }
        let dropped = std::mem::take(&mut outbox.dropped);
        if dropped > 0 {
            let text = format!("{dropped} servo events dropped: nobody took them");
            outbox.events.push(ServoEvent::Note { text });
        }
        Ok(std::mem::take(&mut outbox.events))
    }

    fn stop(&mut self) -> StopOutcome {
        let (reply, answer) = sync_channel(1);
        let sent = self.orders.as_ref().is_some_and(|orders| orders.send(Order::Stop { reply }).is_ok());
        let answer = if sent { answer.recv().ok() } else { None };
        answer.unwrap_or(StopOutcome::LeftToDeadMan)
    }
}

impl Drop for BusBoard {
    fn drop(&mut self) {
        // Without orders the thread makes safe what has torque, and ends.
        self.orders = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Driver {
    servos: Servos,
    stream: Stream,
    outbox: Arc<Mutex<Outbox>>,
    period_s: f64,
    max_late_s: f64,
    /// The servos have torque and positions are streamed to them.
    engaged: bool,
    /// Why nothing moves any more, until the bus is opened again.
    ended: Option<String>,
    punctuality: Punctuality,
    due: MonotonicNs,
    next_check: MonotonicNs,
    next_ping: MonotonicNs,
    checks: usize,
}

impl Driver {
    fn run(mut self, orders: &Receiver<Order>) {
        loop {
            let wait_s = self.due.seconds_since(MonotonicNs::now()).max(0.0);
            match orders.recv_timeout(ground::strict::duration(wait_s)) {
                Ok(order) => self.carry_out(order),
                Err(RecvTimeoutError::Timeout) => self.round(),
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        if self.engaged {
            self.make_safe();
        }
    }

    fn carry_out(&mut self, order: Order) {
        match order {
            Order::Jog { id, count, duration_s, reply } => {
                let done = self
                    .engage("jog")
                    .and_then(|()| self.stream.jog(id, count, duration_s, MonotonicNs::now()));
                let _ = reply.send(done);
            }
            Order::Arm { profile, start, reply } => {
                let done = self.engage("arming").and_then(|()| {
                    self.stream.arm(&profile, start, MonotonicNs::now())?;
                    self.punctuality = Punctuality::new(self.period_s);
                    Ok(())
                });
                let _ = reply.send(done);
            }
            Order::Stop { reply } => {
                let (all, parks) = self.begin_safe();
                let _ = reply.send(if all { StopOutcome::Acknowledged } else { StopOutcome::LeftToDeadMan });
                self.finish_safe(&parks);
                self.ended.get_or_insert_with(|| "it was stopped".into());
            }
        }
    }

    /// Switches torque on, if it is off.
    fn engage(&mut self, request: &str) -> Result<(), ServoError> {
        if let Some(why) = &self.ended {
            return Err(ServoError::Refused {
                request: request.into(),
                why: format!("{why}; open the bus again"),
            });
        }
        if self.engaged {
            return Ok(());
        }
        self.engaged = true;
        match self.servos.engage() {
            Ok(positions) => {
                let now = MonotonicNs::now();
                positions.into_iter().for_each(|(id, count)| self.stream.hold_at(id, count, now));
                self.due = now;
                self.next_check = now.plus_seconds(TORQUE_CHECK_PERIOD_S);
                self.punctuality = Punctuality::new(self.period_s);
                Ok(())
            }
            Err(error) => {
                self.make_safe();
                self.ended = Some(error.to_string());
                Err(error)
            }
        }
    }

    /// One round of the stream: sends positions, reads positions, looks for faults.
    fn round(&mut self) {
        let now = MonotonicNs::now();
        if self.ended.is_some() {
            self.due = now.plus_seconds(IDLE_READ_PERIOD_S);
            return;
        }
        if now >= self.next_ping {
            let tick = now.0 / 1000;
            let at = MonotonicNs(tick * 1000);
            lock(&self.outbox).push(ServoEvent::Ping { sent: at, board_tick_us: tick, received: at });
            self.next_ping = now.plus_seconds(PING_PERIOD_S);
        }
        if let Err(error) = if self.engaged { self.stream_round(now) } else { self.idle_round(now) } {
            self.fail(error);
        }
        self.pass_notes();
    }

    fn idle_round(&mut self, now: MonotonicNs) -> Result<(), ServoError> {
        self.due = now.plus_seconds(IDLE_READ_PERIOD_S);
        let readings = self.servos.read_positions(now.plus_seconds(IDLE_READ_PERIOD_S / 2.0));
        let readings = readings.map_err(|Gone(why)| self.servos.lost(why))?;
        self.take(readings)?;
        self.servos.silence_error(MonotonicNs::now(), IDLE_SILENCE_LIMIT_S).map_or(Ok(()), Err)
    }

    fn stream_round(&mut self, now: MonotonicNs) -> Result<(), ServoError> {
        let (late_s, next) = self.punctuality.round(self.due, now);
        if late_s > self.max_late_s && self.stream.moves(now) {
            return Err(ServoError::Fault {
                reason: format!(
                    "a position was {:.0} ms late, max_late_ms is {:.0}: relieve this computer; {}",
                    late_s * 1e3,
                    self.max_late_s * 1e3,
                    self.punctuality
                ),
            });
        }
        self.due = next;
        let events = self.stream.advance(now);
        let gone = |servos: &Servos, Gone(why)| servos.lost(why);
        self.servos.send_goals(&self.stream.goals(now)).map_err(|error| gone(&self.servos, error))?;
        // By the time the end is reported the servo has received the last position.
        let finished = events.iter().any(|event| matches!(event, ServoEvent::Finished { .. }));
        events.into_iter().for_each(|event| lock(&self.outbox).push(event));
        if finished {
            self.note(self.punctuality.to_string());
        }
        let until = now.plus_seconds(ANSWER_WINDOW_SHARE * self.period_s);
        let readings = self.servos.read_positions(until).map_err(|error| gone(&self.servos, error))?;
        let unanswered = self.servos.servos.len() - readings.len();
        self.take(readings)?;
        let after = MonotonicNs::now();
        if let Some(error) = self.servos.silence_error(after, 0.0) {
            return Err(error);
        }
        self.punctuality.done(after, next, unanswered);
        if after >= self.next_check && unanswered == 0 {
            self.next_check = after.plus_seconds(TORQUE_CHECK_PERIOD_S);
            let id = self.servos.servos[self.checks % self.servos.servos.len()].id;
            self.checks += 1;
            let wait_s = next.seconds_since(after).max(TORQUE_CHECK_MIN_WAIT_S);
            let fault = self.servos.engagement_error(id, wait_s);
            let fault = fault.map_err(|error| gone(&self.servos, error))?;
            return fault.map_or(Ok(()), Err);
        }
        Ok(())
    }

    fn take(&mut self, readings: Vec<PositionReading>) -> Result<(), ServoError> {
        let mut wrong = None;
        for PositionReading { id, count, sent, received, alerts } in readings {
            lock(&self.outbox).push(ServoEvent::Position { channel: id, count, sent, received });
            let middle = sent.plus_seconds(received.seconds_since(sent) / 2.0);
            if alerts {
                self.servos.check_hardware(id)?;
            }
            if let Some(reason) = self.stream.following_fault(id, count, middle) {
                wrong.get_or_insert((id, reason));
            }
        }
        let Some((id, reason)) = wrong else { return Ok(()) };
        // A servo without torque does not follow either; the lost torque is the better explanation.
        let cause = self.servos.engagement_error(id, MAX_ANSWER_DELAY_S);
        let cause = cause.map_err(|Gone(why)| self.servos.lost(why))?;
        Err(cause.unwrap_or(ServoError::Fault { reason }))
    }

    fn fail(&mut self, error: ServoError) {
        // The servos are made safe first, the error is reported after.
        if self.engaged {
            self.make_safe();
        }
        self.ended = Some(error.to_string());
        lock(&self.outbox).trouble.get_or_insert(error);
    }

    fn make_safe(&mut self) {
        let (_, parks) = self.begin_safe();
        self.finish_safe(&parks);
    }

    fn begin_safe(&mut self) -> (bool, Vec<u8>) {
        if self.engaged {
            self.note(self.punctuality.to_string());
        }
        let safe = self.servos.make_safe();
        self.pass_notes();
        safe
    }

    /// Moves the servos named by `parks` to their park positions, and ends the stream.
    fn finish_safe(&mut self, parks: &[u8]) {
        if self.engaged && !parks.is_empty() {
            let begin = MonotonicNs::now();
            let end = begin.plus_seconds(self.stream.park(parks, begin) + MIN_START_LEAD_S);
            while MonotonicNs::now() < end {
                let now = MonotonicNs::now();
                let goals: Vec<_> =
                    self.stream.goals(now).into_iter().filter(|(id, _)| parks.contains(id)).collect();
                if self.servos.send_goals(&goals).is_err() {
                    break;
                }
                std::thread::sleep(ground::strict::duration(self.period_s));
            }
        }
        self.servos.dismiss_watchdogs();
        self.engaged = false;
        self.stream.clear();
    }

    fn note(&self, text: String) {
        lock(&self.outbox).push(ServoEvent::Note { text });
    }

    fn pass_notes(&mut self) {
        for text in std::mem::take(&mut self.servos.notes) {
            self.note(text);
        }
    }
}
