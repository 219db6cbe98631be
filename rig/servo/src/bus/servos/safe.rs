//! Watching over servos that have torque, and what each does when that ends.

use super::super::line::Gone;
use super::super::registers::{Register, WATCHDOG_EXPIRED};
use super::{STOP_TRIES, Servo, Servos};
use crate::ServoError;
use crate::config::SafeState;
use ground::clock::MonotonicNs;

impl Servos {
    /// The error that names the servos that have not answered for longer than the dead-man time, or than `min_limit_s`, if that is longer.
    pub(in crate::bus) fn silence_error(&self, now: MonotonicNs, min_limit_s: f64) -> Option<ServoError> {
        let limit_s = (f64::from(self.dead_man_ms) * 1e-3).max(min_limit_s);
        let lost: Vec<String> = self
            .servos
            .iter()
            .filter(|servo| now.seconds_since(servo.last_answer) > limit_s)
            .map(|servo| {
                format!("{} for {:.0} ms", servo.label(), now.seconds_since(servo.last_answer) * 1e3)
            })
            .collect();
        (!lost.is_empty()).then(|| ServoError::Lost {
            port: self.port_name.clone(),
            why: format!(
                "no answer from {} ({} damaged packets since opening); check cable and supply",
                lost.join(", "),
                self.line.damaged
            ),
        })
    }

    /// The error where the servo with the ID `id` has lost its torque or its watchdog has acted; none where it does not answer within
    /// `wait_s`.
    pub(in crate::bus) fn engagement_error(
        &mut self,
        id: u8,
        wait_s: f64,
    ) -> Result<Option<ServoError>, Gone> {
        let label = self.label(id);
        let protocol = self.line.protocol();
        let read = |bus: &mut Self, register: Register| {
            let question = protocol.read(id, register.address, register.length);
            let answer = bus.line.ask(&question, usize::from(register.length), wait_s)?;
            Ok::<_, Gone>(answer.and_then(|answer| answer.status.data.first().copied()))
        };
        // Read twice: the first answer may be a late one to another register's question.
        let twice = |bus: &mut Self, register: Register, value: u8| {
            Ok::<_, Gone>(read(bus, register)? == Some(value) && read(bus, register)? == Some(value))
        };
        if twice(self, self.registers.torque, 0)? {
            let bits = read(self, self.registers.hardware_error)?.unwrap_or(0);
            let why = match bits {
                0 => "it restarted: check its supply".to_owned(),
                bits => self.registers.hardware_error_text(bits),
            };
            return Ok(Some(ServoError::Fault { reason: format!("{label} has lost its torque: {why}") }));
        }
        if let Some(watchdog) = self.registers.watchdog
            && twice(self, watchdog, WATCHDOG_EXPIRED)?
        {
            let limit_ms = self.dead_man_ms;
            return Ok(Some(ServoError::Fault {
                reason: format!(
                    "{label}: its watchdog has stopped it, it heard nothing for {limit_ms} ms: relieve this computer, or check the cable"
                ),
            }));
        }
        Ok(None)
    }

    /// Puts each servo in its safe state, but for those that park: their IDs are returned, for the caller to move them. Tries everything;
    /// true when each servo confirmed it.
    pub(in crate::bus) fn make_safe(&mut self) -> (bool, Vec<u8>) {
        self.tries = STOP_TRIES;
        let with = |servos: &[Servo], state| -> Vec<u8> {
            servos.iter().filter(|servo| servo.safe_state == state).map(|servo| servo.id).collect()
        };
        let [limp, hold, park] =
            [SafeState::Detach, SafeState::Hold, SafeState::Park].map(|state| with(&self.servos, state));
        let torque = self.registers.torque;
        let off: Vec<_> = limp.iter().map(|&id| (id, vec![0])).collect();
        if !off.is_empty() {
            // All at once first, then each until it confirms.
            let _ = self.line.send_unanswered(&self.line.protocol().sync_write(
                torque.address,
                torque.length,
                &off,
            ));
        }
        for &id in &hold {
            // Where it is, not where it should have been: what is blocked shall not go on pushing.
            let feedback = self.try_get(id, self.registers.feedback).ok().flatten();
            let position = feedback.as_deref().and_then(|bytes| bytes.get(self.registers.position_at..));
            let count = position.and_then(|bytes| self.registers.position(bytes));
            if let Some(count) = count.and_then(|count| u16::try_from(count).ok()) {
                let _ = self.send_goals(&[(id, count)]);
            }
        }
        let mut all = true;
        for id in limp {
            let off = self.set(id, torque, &[0]).is_ok() && self.byte(id, torque).is_ok_and(|on| on == 0);
            if !off {
                self.notes.push(format!("{} did not confirm that its torque is off", self.label(id)));
            }
            all &= off;
        }
        for &id in hold.iter().chain(&park) {
            let there = self.try_get(id, torque).is_ok_and(|answer| answer.is_some());
            if !there {
                self.notes.push(format!("{} did not answer the stop", self.label(id)));
            }
            all &= there;
        }
        (all, park)
    }

    /// Switches the watchdogs off, so that they find nothing to stop after a session that ended as it should.
    pub(in crate::bus) fn dismiss_watchdogs(&mut self) {
        if let Some(watchdog) = self.registers.watchdog {
            let none: Vec<_> = self.servos.iter().map(|servo| (servo.id, vec![0])).collect();
            let _ = self.line.send_unanswered(&self.line.protocol().sync_write(
                watchdog.address,
                watchdog.length,
                &none,
            ));
        }
    }
}
