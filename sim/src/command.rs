//! Commanded actuator angles over time.

/// The commands of the servos: one column per actuator, linear between rows, constant outside them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Command {
    /// Actuator names, in column order.
    pub actuators: Vec<String>,
    /// Row times \[s\], strictly rising.
    pub time_s: Vec<f64>,
    /// Commanded angles \[rad\], row-major, shape (rows, actuators).
    pub angle_rad: Vec<f64>,
}

impl Command {
    /// Commanded angle \[rad\] of the actuator in column `column` at `time_s`; 0 when there are no rows.
    pub fn at(&self, column: usize, time_s: f64) -> f64 {
        let width = self.actuators.len();
        let value = |row: usize| self.angle_rad[row * width + column];
        match self.time_s.partition_point(|&t| t <= time_s) {
            _ if self.time_s.is_empty() => 0.0,
            0 => value(0),
            next if next == self.time_s.len() => value(next - 1),
            next => {
                let (before, after) = (self.time_s[next - 1], self.time_s[next]);
                let share = (time_s - before) / (after - before);
                value(next - 1) + share * (value(next) - value(next - 1))
            }
        }
    }

    /// The last time \[s\] before any actuator moves: the end of the leading rows that all agree.
    /// `None` when nothing ever moves.
    pub fn first_motion_s(&self) -> Option<f64> {
        let width = self.actuators.len();
        let moved = (1..self.time_s.len())
            .find(|&row| (0..width).any(|c| self.angle_rad[row * width + c] != self.angle_rad[c]))?;
        Some(self.time_s[moved - 1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angle_is_linear_between_rows_and_constant_outside() {
        let command = Command {
            actuators: vec!["servo".into()],
            time_s: vec![1.0, 2.0, 3.0],
            angle_rad: vec![0.5, 0.5, 1.5],
        };
        let at = |t| command.at(0, t);
        assert_eq!([at(0.0), at(1.5), at(2.5), at(9.0)], [0.5, 0.5, 1.0, 1.5]);
        assert_eq!(command.first_motion_s(), Some(2.0));
    }
}
