//! The servos on a bus: found and checked, given torque, told and asked, and made safe.

mod safe;
mod status;

use super::line::{Answer, Gone, LATEST_ANSWER_S, Line};
use super::registers::{Register, Registers, WATCHDOG_EXPIRED, WATCHDOG_UNIT_MS};
use crate::travel::{COUNTS_PER_RAD, COUNTS_PER_TURN, CountTravel, Travel};
use crate::{ServoConfig, ServoError, config::SafeState, port};
use ground::clock::MonotonicNs;

/// Tries at setting up, on a computer that may be busy.
const SETUP_TRIES: u32 = 8;
/// Tries at a stop, which the next servo waits for.
const STOP_TRIES: u32 = 3;

/// Where a servo needs a speed, it is this much faster than it may be told to turn: to follow, and no faster should anything go wrong.
const SPEED_MARGIN: f64 = 1.5;
/// One that was silent is waited for so long at least \[s\].
const LEAST_WAIT_S: f64 = 0.002;

/// One servo on the bus.
#[derive(Debug, Clone)]
pub(super) struct Servo {
    pub(super) id: u8,
    pub(super) name: String,
    pub(super) travel: CountTravel,
    pub(super) safe_state: SafeState,
    /// When it was heard last.
    pub(super) heard: MonotonicNs,
    /// When it was asked last, and that it did not answer then.
    asked: MonotonicNs,
    missing: bool,
}

/// Where a servo stood.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stood {
    pub(super) id: u8,
    pub(super) count: i32,
    pub(super) sent: MonotonicNs,
    pub(super) received: MonotonicNs,
    /// It says that something is wrong with it.
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
    /// For the journal.
    pub(super) notes: Vec<String>,
}

impl Servo {
    fn called(&self) -> String {
        format!("servo {} (`{}`)", self.id, self.name)
    }
}

impl Servos {
    /// Opens the port named `port_name`; nothing is said yet.
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
                heard: now,
                asked: now,
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

    /// Looks at each servo: that it is there, that it goes where it is told, that nothing is wrong with it, and that its own limits
    /// allow the config's. What an earlier session left behind is ended, with a note. Nothing moves but what goes limp.
    ///
    /// # Errors
    /// [`ServoError::Handshake`] and [`ServoError::Fault`], naming the servo and what to do; [`ServoError::Lost`].
    pub(super) fn look(&mut self) -> Result<(), ServoError> {
        for servo in self.servos.clone() {
            self.look_at(&servo)?;
        }
        Ok(())
    }

    fn look_at(&mut self, servo: &Servo) -> Result<(), ServoError> {
        let (id, called, registers) = (servo.id, servo.called(), self.registers);
        let handshake =
            |bus: &Self, why: String| Err(ServoError::Handshake { port: bus.port_name.clone(), why });
        if self.try_get(id, registers.model)?.is_none() {
            let (baud, factory, damaged) = (self.baud, registers.factory_baud, self.line.damaged);
            return handshake(
                self,
                format!(
                    "{called} does not answer at {baud} bit/s ({damaged} damaged packets): check supply, wiring, its ID, and baud \
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
                    "{called} is in mode {found} (register {}), wanted {wanted}, for positions: set it with its maker's program",
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
                    "{called} itself goes from {least} to {greatest} counts only, the config from {min} to {max}: change min_count and \
                     max_count, or its own limits with its maker's program"
                ),
            );
        }
        self.end_earlier_session(servo)
    }

    fn end_earlier_session(&mut self, servo: &Servo) -> Result<(), ServoError> {
        let (id, called) = (servo.id, servo.called());
        if self.byte(id, self.registers.torque)? != 0 {
            if servo.safe_state == SafeState::Detach {
                self.set(id, self.registers.torque, &[0])?;
                self.notes.push(format!("{called} still had torque from an earlier session; switched off"));
            } else {
                self.notes.push(format!(
                    "{called} still has torque from an earlier session, and stays where it is"
                ));
            }
        }
        let Some(watchdog) = self.registers.watchdog else { return Ok(()) };
        match self.byte(id, watchdog)? {
            0 => Ok(()),
            WATCHDOG_EXPIRED => {
                self.notes.push(format!(
                    "{called} had been stopped by its watchdog: a host had fallen silent; cleared"
                ));
                self.set(id, watchdog, &[0])
            }
            _ => self.set(id, watchdog, &[0]),
        }
    }

    /// Gives torque to all servos, each where it stands, and sets their watchdogs. Where each stands \[counts\].
    ///
    /// # Errors
    /// [`ServoError`]; the caller makes safe what has got torque already.
    pub(super) fn engage(&mut self) -> Result<Vec<(u8, u16)>, ServoError> {
        let mut stand = Vec::new();
        for servo in self.servos.clone() {
            stand.push((servo.id, self.engage_one(&servo)?));
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
                            servo.called()
                        ),
                    });
                }
            }
        }
        Ok(stand)
    }

    fn engage_one(&mut self, servo: &Servo) -> Result<u16, ServoError> {
        let (id, registers) = (servo.id, self.registers);
        self.check_hardware(id)?;
        let position = Register {
            address: registers.feedback.address + registers.position_at as u16,
            length: registers.goal.length,
        };
        let bytes = self.get(id, position)?;
        let stands = registers.position(&bytes).unwrap_or(i32::MAX);
        let range = servo.travel.min_count..=servo.travel.max_count;
        // Told to stay there it would be told to leave its limits, told anything else it would jump.
        let count = u16::try_from(stands).ok().filter(|count| range.contains(count)).ok_or_else(|| {
            let (min, max) = range.clone().into_inner();
            ServoError::Refused {
                request: "giving torque".into(),
                why: format!(
                    "{} stands at {stands} counts, outside its limits {min} to {max} of {COUNTS_PER_TURN}: turn it back by hand, without \
                     torque, or change the limits",
                    servo.called()
                ),
            }
        })?;
        for profile in registers.profile {
            self.set(id, *profile, &vec![0; usize::from(profile.length)])?;
        }
        if let Some(speed) = registers.speed {
            let counts_per_s = SPEED_MARGIN * servo.travel.max_rate_rad_per_s.get() * COUNTS_PER_RAD;
            let counts_per_s = counts_per_s.clamp(1.0, f64::from(i16::MAX)) as u16;
            self.set(id, speed, &counts_per_s.to_le_bytes())?;
        }
        self.set(id, registers.goal, &registers.encode_position(count))?;
        self.set(id, registers.torque, &[1])?;
        if self.byte(id, registers.torque)? != 1 {
            self.check_hardware(id)?;
            return Err(ServoError::Fault { reason: format!("{} takes no torque", servo.called()) });
        }
        Ok(count)
    }

    /// Tells all of them at once where to be.
    pub(super) fn tell(&mut self, goals: &[(u8, u16)]) -> Result<(), Gone> {
        let goal = self.registers.goal;
        let data: Vec<_> =
            goals.iter().map(|&(id, count)| (id, self.registers.encode_position(count))).collect();
        let packet = self.line.protocol().sync_write(goal.address, goal.length, &data);
        self.line.tell(&packet)
    }

    /// Asks all of them where they stand, until `until` at most. After a silence the silent ones are asked one by one: behind a gap
    /// in the order of answers nobody can tell who is missing.
    pub(super) fn ask(&mut self, until: MonotonicNs) -> Result<Vec<Stood>, Gone> {
        let register = self.registers.feedback;
        let protocol = self.line.protocol();
        // In turn: behind one that is gone the line is quiet, and the others are not asked.
        let mut silent: Vec<&Servo> = self.servos.iter().filter(|servo| servo.missing).collect();
        silent.sort_by_key(|servo| servo.asked);
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
                Some(heard) => answers.extend(heard),
                None => return Ok(Vec::new()),
            }
        }
        for id in silent {
            // Each has its chance, however late it is: a servo must be heard within the dead-man's time.
            let until = until.max(MonotonicNs::now().plus_seconds(LEAST_WAIT_S));
            let question = protocol.read(id, register.address, register.length);
            match self.line.exchange(&question, &[id], length, until)? {
                Some(heard) => answers.extend(heard),
                None => break,
            }
            asked.push(id);
        }
        Ok(self.heard(&asked, answers.into_iter().flatten()))
    }

    fn heard(&mut self, asked: &[u8], answers: impl Iterator<Item = Answer>) -> Vec<Stood> {
        let now = MonotonicNs::now();
        for servo in self.servos.iter_mut().filter(|servo| asked.contains(&servo.id)) {
            (servo.asked, servo.missing) = (now, true);
        }
        let mut stood = Vec::new();
        for Answer { status, sent, received } in answers {
            let position = status.data.get(self.registers.position_at..);
            let Some(count) = position.and_then(|bytes| self.registers.position(bytes)) else { continue };
            for servo in self.servos.iter_mut().filter(|servo| servo.id == status.id) {
                (servo.missing, servo.heard) = (false, received);
            }
            let alerts = self.registers.alerts(status.error);
            stood.push(Stood { id: status.id, count, sent, received, alerts });
        }
        stood
    }

    /// What a servo that alerts has to say.
    pub(super) fn check_hardware(&mut self, id: u8) -> Result<(), ServoError> {
        match self.byte(id, self.registers.hardware_error)? {
            0 => Ok(()),
            bits => Err(ServoError::Fault {
                reason: format!(
                    "{}: {}; remove the cause, then switch its supply off and on",
                    self.called(id),
                    self.registers.hardware_error_text(bits)
                ),
            }),
        }
    }

    fn called(&self, id: u8) -> String {
        self.servos.iter().find(|servo| servo.id == id).map_or(format!("servo {id}"), Servo::called)
    }

    pub(super) fn lost(&self, why: String) -> ServoError {
        ServoError::Lost { port: self.port_name.clone(), why }
    }

    /// Registers of a servo; none when it does not answer.
    fn try_get(&mut self, id: u8, register: Register) -> Result<Option<Vec<u8>>, ServoError> {
        let packet = self.line.protocol().read(id, register.address, register.length);
        for _ in 0..self.tries {
            let answer = self.line.ask(&packet, usize::from(register.length), LATEST_ANSWER_S);
            if let Some(Answer { status, received, .. }) = answer.map_err(|Gone(why)| self.lost(why))? {
                for servo in self.servos.iter_mut().filter(|servo| servo.id == id) {
                    servo.heard = received;
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
                self.called(id),
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
            let answer = self.line.ask(&packet, 0, LATEST_ANSWER_S).map_err(|Gone(why)| self.lost(why))?;
            if let Some(Answer { status, .. }) = answer {
                return match self.registers.refusal(status.error) {
                    None => Ok(()),
                    Some(why) => Err(ServoError::Refused {
                        request: format!(
                            "writing {data:?} to register {} of {}",
                            register.address,
                            self.called(id)
                        ),
                        why: why.into(),
                    }),
                };
            }
        }
        Err(self.lost(format!(
            "{} does not confirm its register {}, written {} times; check cable and supply",
            self.called(id),
            register.address,
            self.tries
        )))
    }
}

/// A number of up to 4 bytes, the low one first.
fn little_endian(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |number, &byte| (number << 8) | u32::from(byte))
}
