//! The register addresses of both kinds of servo, and what their errors mean.
//!
//! # Source
//! ROBOTIS e-manual, control table of the X series, e.g. <https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/> (the addresses used
//! here are the same in all of the series but XL-320); Feetech, memory table of the STS series.

use super::packet::Protocol;
use crate::BoardKind;

/// Consecutive registers of a servo, which hold one value.
#[derive(Debug, Clone, Copy)]
pub struct Register {
    /// Address of the first.
    pub address: u16,
    /// Length in bytes.
    pub length: u8,
}

const fn register(address: u16, length: u8) -> Register {
    Register { address, length }
}

/// The register map of one kind of servo.
#[derive(Debug)]
pub struct Registers {
    /// The protocol that it speaks.
    pub protocol: Protocol,
    /// Name for messages.
    pub name: &'static str,
    /// Its baud rate as it comes from the factory \[bit/s\].
    pub factory_baud: u32,
    /// Model number.
    pub model: Register,
    /// Operating mode, and the value for position control.
    pub mode: (Register, u8),
    /// The servo's own least and greatest position \[counts\].
    pub limits: [Register; 2],
    /// 1 for torque on, 0 for off.
    pub torque: Register,
    /// Hardware error, one bit per cause.
    pub hardware_error: Register,
    /// Watchdog, in units of 20 ms: stops the servo when nothing is sent on the bus for so long. `None` where it has none.
    pub watchdog: Option<Register>,
    /// Set to 0 once before a stream: the servo's own speed and acceleration profile, which would change the streamed one.
    pub profile: &'static [Register],
    /// Speed on the way to a goal \[counts/s\], where 0 may mean that it does not move.
    pub speed: Option<Register>,
    /// Goal position \[counts\].
    pub goal: Register,
    /// The registers that are read in each round, among them the position.
    pub feedback: Register,
    /// Offset of the position in `feedback` \[bytes\].
    pub position_at: usize,
    /// Supply \[0.1 V\] and, in the last byte, temperature \[°C\].
    pub supply: Register,
    /// Offset of the temperature in `supply` \[bytes\].
    pub temperature_at: usize,
    error_bits: &'static [(u8, &'static str)],
}

/// What the watchdog register reads once it has acted.
pub const WATCHDOG_EXPIRED: u8 = 0xFF;
/// The watchdog's unit \[ms\].
pub const WATCHDOG_UNIT_MS: u16 = 20;
/// Protocol 2.0: the bit of a status's error that says that the hardware error register is set.
const ALERT_BIT: u8 = 0x80;

/// Dynamixel X series, in protocol 2.0.
pub static DYNAMIXEL: Registers = Registers {
    protocol: Protocol::Dynamixel2,
    name: "Dynamixel",
    factory_baud: 57_600,
    model: register(0, 2),
    mode: (register(11, 1), 3),
    limits: [register(52, 4), register(48, 4)],
    torque: register(64, 1),
    hardware_error: register(70, 1),
    watchdog: Some(register(98, 1)),
    profile: &[register(108, 8)],
    speed: None,
    goal: register(116, 4),
    // Current 126, velocity 128, position 132.
    feedback: register(126, 10),
    position_at: 6,
    supply: register(144, 3),
    temperature_at: 2,
    error_bits: &[
        (0, "input voltage out of its limits"),
        (2, "overheated"),
        (3, "motor encoder failed"),
        (4, "electrical shock, or not enough power"),
        (5, "overload"),
    ],
};

/// Feetech STS series.
pub static FEETECH: Registers = Registers {
    protocol: Protocol::Feetech,
    name: "Feetech STS",
    factory_baud: 1_000_000,
    model: register(3, 2),
    mode: (register(33, 1), 0),
    limits: [register(9, 2), register(11, 2)],
    torque: register(40, 1),
    hardware_error: register(65, 1),
    watchdog: None,
    // Acceleration 41, time 44.
    profile: &[register(41, 1), register(44, 2)],
    speed: Some(register(46, 2)),
    goal: register(42, 2),
    // Position 56, speed 58, load 60, voltage 62, temperature 63, status 65.
    feedback: register(56, 10),
    position_at: 0,
    supply: register(62, 2),
    temperature_at: 1,
    error_bits: &[
        (0, "voltage out of its limits"),
        (1, "magnetic encoder failed"),
        (2, "overheated"),
        (3, "overcurrent"),
        (5, "overload"),
    ],
};

impl Registers {
    /// The register map for a kind of bus; `None` for a board.
    pub fn of(kind: BoardKind) -> Option<&'static Self> {
        match kind {
            BoardKind::Dynamixel => Some(&DYNAMIXEL),
            BoardKind::Feetech => Some(&FEETECH),
            _ => None,
        }
    }

    /// A position as it is written \[counts\].
    pub fn encode_position(&self, count: u16) -> Vec<u8> {
        match self.protocol {
            Protocol::Dynamixel2 => u32::from(count).to_le_bytes().to_vec(),
            Protocol::Feetech => count.to_le_bytes().to_vec(),
        }
    }

    /// A position out of registers that begin with it \[counts\]; none where they are too few.
    pub fn position(&self, bytes: &[u8]) -> Option<i32> {
        Some(match self.protocol {
            Protocol::Dynamixel2 => i32::from_le_bytes(bytes.get(..4)?.try_into().ok()?),
            Protocol::Feetech => {
                // Magnitude, and bit 15 for its sign.
                let raw = u16::from_le_bytes(bytes.get(..2)?.try_into().ok()?);
                let magnitude = i32::from(raw & 0x7FFF);
                if raw & 0x8000 == 0 { magnitude } else { -magnitude }
            }
        })
    }

    /// Whether a status's error says that something is wrong with the servo itself.
    pub fn alerts(&self, error: u8) -> bool {
        match self.protocol {
            Protocol::Dynamixel2 => error & ALERT_BIT != 0,
            Protocol::Feetech => error != 0,
        }
    }

    /// Why an instruction was refused, in words; `None` if it was not.
    pub fn refusal(&self, error: u8) -> Option<&'static str> {
        if self.protocol == Protocol::Feetech {
            return None;
        }
        Some(match error & !ALERT_BIT {
            0 => return None,
            1 => "could not be carried out",
            2 => "instruction unknown to it",
            3 => "its checksum was wrong",
            4 => "value out of range",
            5 => "too few bytes for this register",
            6 => "value beyond the servo's own limit",
            7 => "register is read-only now: is torque on, or has its watchdog acted?",
            _ => "unknown error",
        })
    }

    /// What the hardware error says, in words.
    pub fn hardware_error_text(&self, bits: u8) -> String {
        let named = self.error_bits.iter().filter(|(bit, _)| bits & (1 << bit) != 0).map(|(_, text)| *text);
        let text = named.collect::<Vec<_>>().join(", ");
        if text.is_empty() { format!("hardware error {bits:#04x}") } else { text }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_signed_in_each_maker_s_way() {
        assert_eq!(DYNAMIXEL.position(&DYNAMIXEL.encode_position(2079)), Some(2079));
        assert_eq!(DYNAMIXEL.position(&[0xFF; 4]), Some(-1));
        assert_eq!(FEETECH.position(&[0x18, 0x05]), Some(1304));
        assert_eq!(FEETECH.position(&[0x05, 0x80]), Some(-5));
        assert_eq!(FEETECH.position(&[0x05]), None);
    }

    #[test]
    fn errors_are_put_in_words() {
        assert_eq!(DYNAMIXEL.hardware_error_text(0b10_0001), "input voltage out of its limits, overload");
        assert_eq!(FEETECH.hardware_error_text(0b10_0000), "overload");
        assert_eq!(DYNAMIXEL.hardware_error_text(0x80), "hardware error 0x80");
        assert!(DYNAMIXEL.alerts(0x80) && !DYNAMIXEL.alerts(0x07) && FEETECH.alerts(0x20));
        assert_eq!(DYNAMIXEL.refusal(0x86), Some("value beyond the servo's own limit"));
        assert_eq!((DYNAMIXEL.refusal(0x80), FEETECH.refusal(0x20)), (None, None));
    }
}
