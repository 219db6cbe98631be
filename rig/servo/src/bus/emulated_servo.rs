//! An emulated servo: its registers, its watchdog, and how it turns.

use super::packet::{BROADCAST, Packet, Protocol, Status, instruction};
use super::registers::{DYNAMIXEL, FEETECH, Register, Registers, WATCHDOG_EXPIRED, WATCHDOG_UNIT_MS};
use ground::clock::MonotonicNs;

/// It turns as a critically damped oscillator of this time constant \[s\], chosen: 20 ms behind a goal that moves evenly.
const RESPONSE_TIME_CONSTANT_S: f64 = 0.010;
/// Fastest turn \[counts/s\], chosen: 10 rad/s.
const MAX_SPEED_COUNTS_PER_S: f64 = 6519.0;
/// Distance from its goal \[counts\] and speed \[counts/s\] below which it is at rest, chosen.
const REST_TOLERANCE_COUNTS: f64 = 1e-3;
/// The overload bit of the hardware error, of both makers.
const OVERLOAD_BIT: u8 = 1 << 5;

/// Error numbers with which a servo of protocol 2.0 refuses an instruction; `Registers::refusal` puts them in words.
const REFUSED_RANGE: u8 = 4;
const REFUSED_LENGTH: u8 = 5;
const REFUSED_LIMIT: u8 = 6;
const REFUSED_ACCESS: u8 = 7;
/// The bit of such an error that says that the hardware error register is set.
const ALERT_BIT: u8 = 0x80;

/// One emulated servo: answers packets as its registers say, and turns towards its goal.
#[derive(Debug, Clone)]
pub(super) struct EmulatedServo {
    pub(super) id: u8,
    registers: &'static Registers,
    table: [u8; 256],
    /// Where it is \[counts\], and how fast \[counts/s\].
    position: f64,
    velocity: f64,
    now: MonotonicNs,
    last_instruction: MonotonicNs,
    /// It cannot turn.
    pub(super) blocked: bool,
}

impl EmulatedServo {
    /// At rest at `count`, without torque, at `now`.
    pub(super) fn new(protocol: Protocol, id: u8, count: u16, now: MonotonicNs) -> Self {
        let registers = match protocol {
            Protocol::Dynamixel2 => &DYNAMIXEL,
            Protocol::Feetech => &FEETECH,
        };
        let mut servo = Self {
            id,
            registers,
            table: [0; 256],
            position: f64::from(count),
            velocity: 0.0,
            now,
            last_instruction: now,
            blocked: false,
        };
        servo.power_up();
        servo
    }

    /// As after its supply came on: all registers at their defaults, and no torque.
    pub(super) fn power_up(&mut self) {
        self.table = [0; 256];
        let defaults: &[(u16, &[u8])] = match self.registers.protocol {
            // XM430-W350, firmware 46.
            Protocol::Dynamixel2 => &[
                (0, &[0xFC, 0x03]),
                (6, &[46, self.id]),
                (9, &[250]),
                (11, &[3]),
                (48, &[0xFF, 0x0F, 0, 0, 0, 0, 0, 0]),
                (144, &[120, 0, 31]),
            ],
            // STS3215, firmware 3.10.
            Protocol::Feetech => {
                &[(0, &[3, 10, 0, 9, 3, self.id, 0, 250]), (9, &[0, 0, 0xFF, 0x0F]), (62, &[74, 31])]
            }
        };
        for (address, bytes) in defaults {
            self.put(*address, bytes);
        }
        let here = self.registers.encode_position(self.position.round() as u16);
        self.put(self.registers.goal.address, &here);
        self.velocity = 0.0;
    }

    /// Acts as after a load that is too great: torque off until its supply was switched off and on.
    pub(super) fn overload(&mut self) {
        self.put(self.registers.hardware_error.address, &[OVERLOAD_BIT]);
        self.put(self.registers.torque.address, &[0]);
    }

    fn put(&mut self, address: u16, bytes: &[u8]) {
        let start = usize::from(address);
        if let Some(place) = self.table.get_mut(start..start + bytes.len()) {
            place.copy_from_slice(bytes);
        }
    }

    fn get(&self, register: Register) -> &[u8] {
        let start = usize::from(register.address);
        self.table.get(start..start + usize::from(register.length)).unwrap_or_default()
    }

    fn byte(&self, register: Register) -> u8 {
        self.get(register).first().copied().unwrap_or(0)
    }

    fn has_torque(&self) -> bool {
        self.byte(self.registers.torque) != 0
    }

    fn goal(&self) -> f64 {
        self.registers.position(self.get(self.registers.goal)).map_or(self.position, f64::from)
    }

    /// Its position without rounding \[counts\]; `None` without torque.
    pub(super) fn powered_position(&self) -> Option<f64> {
        self.has_torque().then_some(self.position)
    }

    /// Turns on until `until`.
    pub(super) fn turn(&mut self, until: MonotonicNs) {
        self.watch(until);
        let dt_s = until.seconds_since(self.now).max(0.0);
        self.now = until;
        let behind = self.position - self.goal();
        if !self.has_torque()
            || self.blocked
            || behind.abs() < REST_TOLERANCE_COUNTS && self.velocity.abs() < REST_TOLERANCE_COUNTS
        {
            self.velocity = 0.0;
            return;
        }
        // x(t) = (a + b t) exp(-t / T) is exact between goals.
        let rate = 1.0 / RESPONSE_TIME_CONSTANT_S;
        let b = self.velocity + rate * behind;
        let decay = (-rate * dt_s).exp();
        let after = (behind + b * dt_s) * decay;
        let fastest = self.fastest();
        let most = fastest * dt_s;
        let moved = (after - behind).clamp(-most, most);
        self.velocity =
            if moved == after - behind { b * decay - rate * after } else { fastest.copysign(moved) };
        self.position += moved;
    }

    /// Its greatest speed \[counts/s\]: what it can do, or where it has a speed register what that says; 0 there is standstill.
    fn fastest(&self) -> f64 {
        self.registers.speed.map_or(MAX_SPEED_COUNTS_PER_S, |speed| {
            let bytes = self.get(speed);
            let counts_per_s = bytes.iter().rev().fold(0u16, |n, &byte| (n << 8) | u16::from(byte));
            f64::from(counts_per_s).min(MAX_SPEED_COUNTS_PER_S)
        })
    }

    /// The watchdog: a servo with torque that receives nothing for longer than it allows stays where it is.
    fn watch(&mut self, now: MonotonicNs) {
        let Some(watchdog) = self.registers.watchdog else { return };
        let units = self.byte(watchdog);
        let limit_s = f64::from(units) * f64::from(WATCHDOG_UNIT_MS) * 1e-3;
        if self.has_torque()
            && (1..=127).contains(&units)
            && now.seconds_since(self.last_instruction) > limit_s
        {
            self.put(watchdog.address, &[WATCHDOG_EXPIRED]);
            let here = self.registers.encode_position(self.position.round() as u16);
            self.put(self.registers.goal.address, &here);
        }
    }

    /// Takes in an instruction to any servo, and answers one that asks this servo.
    pub(super) fn handle(&mut self, packet: &Packet, now: MonotonicNs) -> Option<Status> {
        self.turn(now);
        let for_me = packet.id == self.id;
        if !for_me && packet.id != BROADCAST {
            return None;
        }
        self.last_instruction = now;
        let (address_bytes, length_bytes) = match self.registers.protocol {
            Protocol::Dynamixel2 => (2, 2),
            Protocol::Feetech => (1, 1),
        };
        let parameters = &packet.parameters[..];
        let number = |bytes: &[u8]| bytes.iter().rev().fold(0u16, |n, &byte| (n << 8) | u16::from(byte));
        let address = number(parameters.get(..address_bytes).unwrap_or_default());
        let rest = parameters.get(address_bytes..).unwrap_or_default();
        match packet.code {
            instruction::PING => {
                let data = match self.registers.protocol {
                    Protocol::Dynamixel2 => {
                        self.table[..2].iter().chain(&self.table[6..7]).copied().collect()
                    }
                    Protocol::Feetech => Vec::new(),
                };
                Some(self.answer(0, data))
            }
            instruction::READ if for_me => Some(self.read(address, number(rest))),
            instruction::WRITE => {
                let error = self.write(address, rest);
                for_me.then(|| self.answer(error, Vec::new()))
            }
            instruction::SYNC_READ => {
                let (length, ids) = rest.split_at_checked(length_bytes)?;
                ids.contains(&self.id).then(|| self.read(address, number(length)))
            }
            instruction::SYNC_WRITE => {
                let (length, each) = rest.split_at_checked(length_bytes)?;
                let mut each = each.chunks_exact(usize::from(number(length)) + 1);
                if let Some(entry) = each.find(|entry| entry[0] == self.id) {
                    self.write(address, &entry[1..]);
                }
                None
            }
            _ => for_me.then(|| self.answer(2, Vec::new())),
        }
    }

    fn answer(&self, error: u8, data: Vec<u8>) -> Status {
        let wrong = self.byte(self.registers.hardware_error);
        let error = match self.registers.protocol {
            Protocol::Dynamixel2 if wrong != 0 => error | ALERT_BIT,
            Protocol::Dynamixel2 => error,
            // It has no way to say that it refuses.
            Protocol::Feetech => wrong,
        };
        Status { id: self.id, error, data }
    }

    fn read(&mut self, address: u16, length: u16) -> Status {
        let feedback = self.registers.feedback;
        let at = feedback.address + self.registers.position_at as u16;
        let count = self.position.round() as i32;
        match self.registers.protocol {
            Protocol::Dynamixel2 => self.put(at, &count.to_le_bytes()),
            Protocol::Feetech => {
                let magnitude = count.unsigned_abs() as u16 & 0x7FFF;
                let raw = if count < 0 { magnitude | 0x8000 } else { magnitude };
                self.put(at, &raw.to_le_bytes());
            }
        }
        let start = usize::from(address);
        match self.table.get(start..start + usize::from(length)) {
            Some(bytes) => self.answer(0, bytes.to_vec()),
            None => self.answer(REFUSED_ACCESS, Vec::new()),
        }
    }

    fn write(&mut self, address: u16, data: &[u8]) -> u8 {
        if self.registers.protocol == Protocol::Dynamixel2 {
            let goal = self.registers.goal;
            if data.is_empty() {
                return REFUSED_LENGTH;
            }
            // Registers above the goal are read-only here; those below the torque register are in permanent memory, locked while torque
            // is on.
            if address > goal.address || address < self.registers.torque.address && self.has_torque() {
                return REFUSED_ACCESS;
            }
            if address == goal.address {
                let limits = self.registers.limits.map(|limit| self.registers.position(self.get(limit)));
                let [Some(least), Some(greatest)] = limits else { return REFUSED_LENGTH };
                let Some(wanted) = self.registers.position(data) else { return REFUSED_LENGTH };
                if self.registers.watchdog.is_some_and(|w| self.byte(w) == WATCHDOG_EXPIRED) {
                    return REFUSED_RANGE;
                }
                if !(least..=greatest).contains(&wanted) {
                    return REFUSED_LIMIT;
                }
            }
            if address == self.registers.torque.address
                && data[0] != 0
                && self.byte(self.registers.hardware_error) != 0
            {
                return REFUSED_ACCESS;
            }
        }
        self.put(address, data);
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: f64) -> MonotonicNs {
        MonotonicNs(1_000_000_000).plus_seconds(ms * 1e-3)
    }

    fn write(servo: &mut EmulatedServo, register: Register, data: &[u8], ms: f64) -> u8 {
        let packet = servo.registers.protocol.write(servo.id, register.address, data);
        servo.handle(&packet, at(ms)).unwrap().error
    }

    fn turned(servo: &mut EmulatedServo, from_ms: u32, to_ms: u32) -> f64 {
        (from_ms..=to_ms).for_each(|ms| servo.turn(at(f64::from(ms))));
        servo.position
    }

    fn ready() -> EmulatedServo {
        let mut servo = EmulatedServo::new(Protocol::Dynamixel2, 1, 2048, at(0.0));
        assert_eq!(write(&mut servo, DYNAMIXEL.torque, &[1], 0.0), 0);
        servo
    }

    #[test]
    fn step_is_that_of_a_critically_damped_oscillator_and_big_ones_keep_to_the_rate() {
        let mut servo = ready();
        write(&mut servo, DYNAMIXEL.goal, &2058u32.to_le_bytes(), 0.0);
        let after = turned(&mut servo, 1, 20) - 2048.0;
        assert!((after - 10.0 * (1.0 - 3.0 * (-2.0f64).exp())).abs() < 1e-9, "{after}");
        write(&mut servo, DYNAMIXEL.goal, &4000u32.to_le_bytes(), 20.0);
        let before = servo.position;
        let fast = turned(&mut servo, 21, 120) - before;
        assert!(fast < 0.1 * MAX_SPEED_COUNTS_PER_S + 1e-9 && fast > 0.08 * MAX_SPEED_COUNTS_PER_S, "{fast}");
        let last = turned(&mut servo, 121, 600);
        assert!((last - 4000.0).abs() < 0.01, "{last}");
    }

    #[test]
    fn watchdog_stops_the_servo_with_torque_and_locks_its_goal_until_cleared() {
        let mut servo = ready();
        let watchdog = DYNAMIXEL.watchdog.unwrap();
        assert_eq!(write(&mut servo, watchdog, &[3], 0.0), 0);
        write(&mut servo, DYNAMIXEL.goal, &2448u32.to_le_bytes(), 0.0);
        turned(&mut servo, 1, 59);
        assert_eq!(servo.byte(watchdog), 3);
        turned(&mut servo, 60, 61);
        assert_eq!(servo.byte(watchdog), WATCHDOG_EXPIRED);
        let stopped = turned(&mut servo, 62, 300);
        assert!(stopped < 2448.0 && servo.powered_position().is_some(), "{stopped}");
        assert_eq!(write(&mut servo, DYNAMIXEL.goal, &2448u32.to_le_bytes(), 301.0), REFUSED_RANGE);
        assert_eq!(write(&mut servo, watchdog, &[0], 302.0), 0);
        assert_eq!(write(&mut servo, DYNAMIXEL.goal, &2448u32.to_le_bytes(), 303.0), 0);
    }

    #[test]
    fn what_a_servo_must_refuse_it_refuses_with_the_makers_number() {
        let mut servo = ready();
        assert_eq!(write(&mut servo, DYNAMIXEL.mode.0, &[1], 0.0), REFUSED_ACCESS, "locked by torque");
        assert_eq!(write(&mut servo, DYNAMIXEL.goal, &5000u32.to_le_bytes(), 0.0), REFUSED_LIMIT);
        assert_eq!(write(&mut servo, DYNAMIXEL.feedback, &[0], 0.0), REFUSED_ACCESS);
        servo.overload();
        assert!(servo.powered_position().is_none());
        assert_eq!(write(&mut servo, DYNAMIXEL.torque, &[1], 0.0), ALERT_BIT | REFUSED_ACCESS);
    }
}
