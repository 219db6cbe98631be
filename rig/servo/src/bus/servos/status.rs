//! The state of the servos on a bus, as lines of text.

use super::{Servos, little_endian};
use crate::ServoError;

impl Servos {
    /// How each servo is, a line each.
    pub(in crate::bus) fn describe(&mut self) -> Result<Vec<String>, ServoError> {
        let registers = self.registers;
        let mut lines = Vec::new();
        for servo in self.servos.clone() {
            let id = servo.id;
            let Some(model) = self.try_get(id, registers.model)? else {
                lines.push(format!("{}: no answer at {} bit/s", servo.label(), self.baud));
                continue;
            };
            let torque = if self.byte(id, registers.torque)? == 0 { "off" } else { "on" };
            let feedback = self.get(id, registers.feedback)?;
            let count = feedback.get(registers.position_at..).and_then(|bytes| registers.position(bytes));
            let supply = self.get(id, registers.supply)?;
            let voltage = little_endian(&supply[..registers.temperature_at.min(supply.len())]);
            let temperature = supply.get(registers.temperature_at).copied().unwrap_or(0);
            let wrong = match self.byte(id, registers.hardware_error)? {
                0 => String::new(),
                bits => format!(", {}", registers.hardware_error_text(bits)),
            };
            lines.push(format!(
                "{}: model {}, torque {torque}, at {} counts, {:.1} V, {temperature} °C{wrong}",
                servo.label(),
                little_endian(&model),
                count.map_or("?".into(), |count| count.to_string()),
                f64::from(voltage) * 0.1
            ));
        }
        Ok(lines)
    }
}
