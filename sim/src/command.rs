//! Commanded actuator angles over time.

/// The commands of the servos: one column per actuator, linear between rows, constant outside them. Of two rows at one time the first ends what was
/// before, the second begins what comes: commands that are held until the next are such rows ([`Command::held`]).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Command {
    /// Actuator names, in column order.
    pub actuators: Vec<String>,
    /// Row times \[s\], rising; no more than two are alike.
    pub time_s: Vec<f64>,
    /// Commanded angles \[rad\], row-major, shape (rows, actuators); of motors forces, torques, currents or duty cycles, as they take them. No number
    /// where nothing is commanded: the drive is idle from that row to the next.
    pub angle_rad: Vec<f64>,
}

impl Command {
    /// The same rows, each of which holds until the next.
    pub fn held(self) -> Self {
        let width = self.actuators.len();
        let mut held = Self { actuators: self.actuators, ..Self::default() };
        for (row, (&time_s, angles)) in
            self.time_s.iter().zip(self.angle_rad.chunks(width.max(1))).enumerate()
        {
            if row > 0 {
                held.time_s.push(time_s);
                held.angle_rad.extend_from_within(held.angle_rad.len() - width..);
            }
            held.time_s.push(time_s);
            held.angle_rad.extend_from_slice(angles);
        }
        held
    }

    /// The rows of which each holds until the next, where these are such commands.
    pub fn steps(&self) -> Option<Self> {
        let width = self.actuators.len();
        let angles = |row: usize| &self.angle_rad[row * width..(row + 1) * width];
        let rows = self.time_s.len();
        let alike = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
        let is_pair =
            |row: &usize| self.time_s[row + 1] == self.time_s[*row] && alike(angles(row - 1), angles(*row));
        let is_held = rows > 1 && rows % 2 == 1 && (1..rows).step_by(2).all(|row| is_pair(&row));
        is_held.then(|| Self {
            actuators: self.actuators.clone(),
            time_s: self.time_s.iter().copied().step_by(2).collect(),
            angle_rad: (0..rows).step_by(2).flat_map(angles).copied().collect(),
        })
    }

    /// What the actuator in column `column` is told at `time_s`; 0 when there are no rows, no number where it is idle.
    pub fn at(&self, column: usize, time_s: f64) -> f64 {
        let width = self.actuators.len();
        let value = |row: usize| self.angle_rad[row * width + column];
        match self.time_s.partition_point(|&t| t <= time_s) {
            _ if self.time_s.is_empty() => 0.0,
            0 => value(0),
            next if next == self.time_s.len() => value(next - 1),
            next => {
                // one that is idle from the next row on goes nowhere until then
                if value(next).is_nan() {
                    return value(next - 1);
                }
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
    fn held_rows_jump_and_come_back_as_they_were() {
        let rows = Command {
            actuators: vec!["a".into(), "b".into()],
            time_s: vec![0.0, 1.0, 3.0],
            angle_rad: vec![0.1, 1.0, 0.2, f64::NAN, 0.3, 3.0],
        };
        let held = rows.clone().held();
        assert_eq!([-1.0, 0.5, 1.0, 2.9, 3.0, 9.0].map(|t| held.at(0, t)), [0.1, 0.1, 0.2, 0.2, 0.3, 0.3]);
        assert!(held.at(1, 0.9) == 1.0 && held.at(1, 1.0).is_nan() && held.at(1, 3.0) == 3.0);
        assert_eq!(held.first_motion_s(), Some(1.0));
        let back = held.steps().unwrap();
        assert_eq!(back.time_s, rows.time_s);
        assert_eq!(back.angle_rad[..3], rows.angle_rad[..3]);
        assert_eq!(rows.steps(), None);
    }

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
