//! The servos on a bus: finding and checking them, switching torque on, sending and reading positions, making them safe.

mod safe;
mod status;

use super::line::{Answer, Gone, Line, MAX_ANSWER_DELAY_S};
use super::registers::{Register, Registers, WATCHDOG_EXPIRED, WATCHDOG_UNIT_MS};
use crate::travel::{COUNTS_PER_RAD, COUNTS_PER_TURN, CountTravel, Travel};
use crate::{ServoConfig, ServoError, config::SafeState, port};
use ground::clock::MonotonicNs;

/// Tries of each exchange while setting up, on a computer that may be busy; chosen.
const SETUP_TRIES: u32 = 8;
/// Tries of each exchange during a stop, which keep the next servo waiting; chosen.
const STOP_TRIES: u32 = 3;

/// The speed limit set in a servo that needs one, over the greatest rate that the config allows: enough to follow the stream, and no
/// faster should anything go wrong. Chosen.
const SPEED_LIMIT_FACTOR: f64 = 1.5;
/// A servo that did not answer last time is given at least this long to answer \[s\], chosen.
const SILENT_SERVO_MIN_WAIT_S: f64 = 0.002;

/// One servo on the bus.
#[derive(Debug, Clone)]
pub(super) struct Servo {
    pub(super) id: u8,
    pub(super) name: String,
    pub(super) travel: CountTravel,
    pub(super) safe_state: SafeState,
    /// When it answered last.
    pub(super) last_answer: MonotonicNs,
    /// When it was asked last, and whether it did not answer then.
    last_asked: MonotonicNs,
    missing: bool,
}

/// A measured position of a servo, and when it was measured: between `sent` and `received`.
#[derive(Debug, Clone, Copy)]
pub(super) struct PositionReading {
    pub(super) id: u8,
    pub(super) count: i32,
    pub(super) sent: MonotonicNs,
    pub(super) received: MonotonicNs,
    /// The servo reports a hardware error.
    pub(super) alerts: bool,
}

/// All servos of one bus: their line, their registers and what each is configured to.
pub(super) struct Servos {
    line: Line,
    pub(super) registers: &'static Registers,
    pub(super) servos: Vec<Servo>,
    pub(super) port_name: String,
    baud: u32,
    dead_man_ms: u16,
    tries: u32,
    /// Notes for the journal that were not handed on yet.
    pub(super) notes: Vec<String>,
}

impl Servo {
    fn label(&self) -> String {
        format!("servo {} (`{}`)", self.id, self.name)
    }
}

impl Servos {
    /// Opens the port named `port_name`; nothing is sent yet.
    ///
    /// # Errors
    /// [`ServoError::Open`]; [`ServoError::Refused`] for a config without a bus.
    pub(super) fn open(port_name: &str, config: &ServoConfig) -> Result<Self, ServoError> {
        let registers = Registers::of(config.kind).ok_or_else(|| ServoError::Refused {
            request: "opening a bus".into(),
            why: "the config has no servos on a bus".into(),
        })?;
        let port = port::open(port_name, config.baud)?;
        let now = MonotonicNs::now();
        let servos = config.channels.iter().filter_map(|channel| match &channel.travel {
            Travel::Counts(travel) => Some(Servo {
                id: channel.id,
                name: channel.name.clone(),
                travel: travel.clone(),
                safe_state: channel.safe_state,
                last_answer: now,
                last_asked: now,
                missing: false,
            }),
            Travel::Pulses(_) => None,
        });
        Ok(Self {
            line: Line::new(port, registers.protocol),
            registers,
            servos: servos.collect(),
            port_name: port_name.into(),
            baud: config.baud,
            dead_man_ms: config.dead_man_ms,
            tries: SETUP_TRIES,
            notes: Vec::new(),
        })
    }

    /// Checks each servo: it answers, is in position mode, reports no hardware error, and its own limits allow the config's. What an
    /// earlier session left behind is ended, with a note. Nothing moves, but a servo may lose its torque.
    ///
    /// # Errors
    /// [`ServoError::Handshake`] and [`ServoError::Fault`], naming the servo and what to do; [`ServoError::Lost`].
    pub(super) fn check(&mut self) -> Result<(), ServoError> {
        for servo in self.servos.clone() {
            self.check_servo(&servo)?;
        }
        Ok(())
    }

    fn check_servo(&mut self, servo: &Servo) -> Result<(), ServoError> {
        let (id, label, registers) = (servo.id, servo.label(), self.registers);
        let handshake =
            |bus: &Self, why: String| Err(ServoError::Handshake { port: bus.port_name.clone(), why });
        if self.try_get(id, registers.model)?.is_none() {
            let (baud, factory, damaged) = (self.baud, registers.factory_baud, self.line.damaged);
            return handshake(
                self,
                format!(
                    "{label} does not answer at {baud} bit/s ({damaged} damaged packets): check supply, wiring, its ID, and baud \
                     (from the factory {factory})"
                ),
            );
        }
        self.check_hardware(id)?;
        let (mode, wanted) = registers.mode;
        let found = self.byte(id, mode)?;
        if found != wanted {
            return handshake(
                self,
                format!(
                    "{label} is in mode {found} (register {}), wanted {wanted}, for positions: set it with its maker's program",
                    mode.address
                ),
            );
        }
        let limits = registers.limits.map(|limit| self.get(id, limit).map(|bytes| little_endian(&bytes)));
        let [least, greatest] = limits;
        let (least, greatest) = (least?, greatest?);
        let (min, max) = (servo.travel.min_count, servo.travel.max_count);
        // Both 0: without limits.
        if (least, greatest) != (0, 0) && (u32::from(min) < least || u32::from(max) > greatest) {
            return handshake(
                self,
                format!(
                    "{label} itself goes from {least} to {greatest} counts only, the config from {min} to {max}: change min_count and \
                     max_count, or its own limits with its maker's program"
                ),
            );
        }
        self.end_earlier_session(servo)
    }

    fn end_earlier_session(&mut self, servo: &Servo) -> Result<(), ServoError> {
        let (id, label) = (servo.id, servo.label());
        if self.byte(id, self.registers.torque)? != 0 {
            if servo.safe_state == SafeState::Detach {
                self.set(id, self.registers.torque, &[0])?;
                self.notes.push(format!("{label} still had torque from an earlier session; switched off"));
            } else {
                self.notes
                    .push(format!("{label} still has torque from an earlier session, and stays where it is"));
            }
        }
        let Some(watchdog) = self.registers.watchdog else { return Ok(()) };
        match self.byte(id, watchdog)? {
            0 => Ok(()),
            WATCHDOG_EXPIRED => {
                self.notes.push(format!(
                    "{label} had been stopped by its watchdog: a host had fallen silent; cleared"
                ));
                self.set(id, watchdog, &[0])
            }
            _ => self.set(id, watchdog, &[0]),
        }
    }

    /// Switches torque on for all servos, each where it stands, and sets their watchdogs. Returns ID and position \[counts\] of each.
    ///
    /// # Errors
    /// [`ServoError`]; the caller makes safe what has got torque already.
    pub(super) fn engage(&mut self) -> Result<Vec<(u8, u16)>, ServoError> {
        let mut positions = Vec::new();
        for servo in self.servos.clone() {
            positions.push((servo.id, self.engage_one(&servo)?));
        }
        if let Some(watchdog) = self.registers.watchdog {
            let units = self.dead_man_ms.div_ceil(WATCHDOG_UNIT_MS).clamp(1, 127) as u8;
            for servo in self.servos.clone() {
                self.set(servo.id, watchdog, &[units])?;
                let read = self.byte(servo.id, watchdog)?;
                if read != units {
                    return Err(ServoError::Handshake {
                        port: self.port_name.clone(),
                        why: format!(
                            "{}: its watchdog was set to {units} · {WATCHDOG_UNIT_MS} ms and reads {read}: update its firmware",
                            servo.label()
                        ),
                    });
                }
            }
        }
        Ok(positions)
    }

    fn engage_one(&mut self, servo: &Servo) -> Result<u16, ServoError> {
        let (id, registers) = (servo.id, self.registers);
        self.check_hardware(id)?;
        let position = Register {
            address: registers.feedback.address + registers.position_at as u16,
            length: registers.goal.length,
        };
        let bytes = self.get(id, position)?;
        let found = registers.position(&bytes).unwrap_or(i32::MAX);
        let range = servo.travel.min_count..=servo.travel.max_count;
        // To hold it there would break its limits, and any other goal would make it jump.
        let count = u16::try_from(found).ok().filter(|count| range.contains(count)).ok_or_else(|| {
            let (min, max) = range.clone().into_inner();
            ServoError::Refused {
                request: "giving torque".into(),
                why: format!(
                    "{} stands at {found} counts, outside its limits {min} to {max} of {COUNTS_PER_TURN}: turn it back by hand, without \
                     torque, or change the limits",
                    servo.label()
                ),
            }
        })?;
        for profile in registers.profile {
            self.set(id, *profile, &vec![0; usize::from(profile.length)])?;
        }
        if let Some(speed) = registers.speed {
            let counts_per_s = SPEED_LIMIT_FACTOR * servo.travel.max_rate_rad_per_s.get() * COUNTS_PER_RAD;
            let counts_per_s = counts_per_s.clamp(1.0, f64::from(i16::MAX)) as u16;
            self.set(id, speed, &counts_per_s.to_le_bytes())?;
        }
        self.set(id, registers.goal, &registers.encode_position(count))?;
        self.set(id, registers.torque, &[1])?;
        if self.byte(id, registers.torque)? != 1 {
            self.check_hardware(id)?;
            return Err(ServoError::Fault { reason: format!("{} takes no torque", servo.label()) });
        }
        Ok(count)
    }

    /// Sends all of them their goals at once: ID and position \[counts\].
    pub(super) fn send_goals(&mut self, goals: &[(u8, u16)]) -> Result<(), Gone> {
        let goal = self.registers.goal;
        let data: Vec<_> =
            goals.iter().map(|&(id, count)| (id, self.registers.encode_position(count))).collect();
        let packet = self.line.protocol().sync_write(goal.address, goal.length, &data);
        self.line.send_unanswered(&packet)
    }

    /// Reads the positions of all of them, until `until` at most. Servos that did not answer last time are asked one by one: behind a gap
    /// in the order of answers it is unknown which one is missing.
    pub(super) fn read_positions(&mut self, until: MonotonicNs) -> Result<Vec<PositionReading>, Gone> {
        let register = self.registers.feedback;
        let protocol = self.line.protocol();
        // The one asked longest ago comes first: after an unanswered question the line is quiet and the others are not asked.
        let mut silent: Vec<&Servo> = self.servos.iter().filter(|servo| servo.missing).collect();
        silent.sort_by_key(|servo| servo.last_asked);
        let silent: Vec<u8> = silent.into_iter().map(|servo| servo.id).collect();
        let together: Vec<u8> =
            self.servos.iter().map(|servo| servo.id).filter(|id| !silent.contains(id)).collect();
        let length = usize::from(register.length);
        let mut asked = together.clone();
        let mut answers = Vec::new();
        let question = match together[..] {
            [] => None,
            [id] => Some(protocol.read(id, register.address, register.length)),
            _ => Some(protocol.sync_read(&together, register.address, register.length)),
        };
        if let Some(question) = question {
            match self.line.exchange(&question, &together, length, until)? {
                Some(received) => answers.extend(received),
                None => return Ok(Vec::new()),
            }
        }
        for id in silent {
            // Each is asked, however late it is: a servo must answer within the dead-man time.
            let until = until.max(MonotonicNs::now().plus_seconds(SILENT_SERVO_MIN_WAIT_S));
            let question = protocol.read(id, register.address, register.length);
            match self.line.exchange(&question, &[id], length, until)? {
                Some(received) => answers.extend(received),
                None => break,
            }
            asked.push(id);
        }
        Ok(self.record_answers(&asked, answers.into_iter().flatten()))
    }

    fn record_answers(
        &mut self,
        asked: &[u8],
        answers: impl Iterator<Item = Answer>,
    ) -> Vec<PositionReading> {
        let now = MonotonicNs::now();
        for servo in self.servos.iter_mut().filter(|servo| asked.contains(&servo.id)) {
            (servo.last_asked, servo.missing) = (now, true);
        }
        let mut readings = Vec::new();
        for Answer { status, sent, received } in answers {
            let position = status.data.get(self.registers.position_at..);
            let Some(count) = position.and_then(|bytes| self.registers.position(bytes)) else { continue };
            for servo in self.servos.iter_mut().filter(|servo| servo.id == status.id) {
                (servo.missing, servo.last_answer) = (false, received);
            }
            let alerts = self.registers.alerts(status.error);
            readings.push(PositionReading { id: status.id, count, sent, received, alerts });
        }
        readings
    }

    /// Reads the hardware error of the servo with the ID `id`; one that is set is a fault.
    pub(super) fn check_hardware(&mut self, id: u8) -> Result<(), ServoError> {
        match self.byte(id, self.registers.hardware_error)? {
            0 => Ok(()),
            bits => Err(ServoError::Fault {
                reason: format!(
                    "{}: {}; remove the cause, then switch its supply off and on",
                    self.label(id),
                    self.registers.hardware_error_text(bits)
                ),
            }),
        }
    }

    fn label(&self, id: u8) -> String {
        self.servos.iter().find(|servo| servo.id == id).map_or(format!("servo {id}"), Servo::label)
    }

    pub(super) fn lost(&self, why: String) -> ServoError {
        ServoError::Lost { port: self.port_name.clone(), why }
    }

    /// Reads `register` of a servo; `None` when it does not answer.
    fn try_get(&mut self, id: u8, register: Register) -> Result<Option<Vec<u8>>, ServoError> {
        let packet = self.line.protocol().read(id, register.address, register.length);
        for _ in 0..self.tries {
            let answer = self.line.ask(&packet, usize::from(register.length), MAX_ANSWER_DELAY_S);
            if let Some(Answer { status, received, .. }) = answer.map_err(|Gone(why)| self.lost(why))? {
                for servo in self.servos.iter_mut().filter(|servo| servo.id == id) {
                    servo.last_answer = received;
                }
                return Ok(Some(status.data));
            }
        }
        Ok(None)
    }

    fn get(&mut self, id: u8, register: Register) -> Result<Vec<u8>, ServoError> {
        match self.try_get(id, register)? {
            Some(bytes) => Ok(bytes),
            None => Err(self.lost(format!(
                "{} does not say what is in its register {}, asked {} times; check cable and supply",
                self.label(id),
                register.address,
                self.tries
            ))),
        }
    }

    fn byte(&mut self, id: u8, register: Register) -> Result<u8, ServoError> {
        Ok(self.get(id, register)?.first().copied().unwrap_or(0))
    }

    fn set(&mut self, id: u8, register: Register, data: &[u8]) -> Result<(), ServoError> {
        let packet = self.line.protocol().write(id, register.address, data);
        for _ in 0..self.tries {
            let answer = self.line.ask(&packet, 0, MAX_ANSWER_DELAY_S).map_err(|Gone(why)| self.lost(why))?;
            if let Some(Answer { status, .. }) = answer {
                return match self.registers.refusal(status.error) {
                    None => Ok(()),
                    Some(why) => Err(ServoError::Refused {
                        request: format!(
                            "writing {data:?} to register {} of {}",
                            register.address,
                            self.label(id)
                        ),
                        why: why.into(),
                    }),
                };
            }
        }
        Err(self.lost(format!(
            "{} does not confirm its register {}, written {} times; check cable and supply",
            self.label(id),
            register.address,
            self.tries
        )))
    }
}

/// An unsigned number of up to 4 bytes, little-endian.
fn little_endian(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |number, &byte| (number << 8) | u32::from(byte))
}
