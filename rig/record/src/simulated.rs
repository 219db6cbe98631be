//! `simulated.csv`: `time_s,q0,q1,...`, the coordinates of the calibrated model at each image's time.

use std::fmt::Write as _;
use std::path::Path;

use super::RecordError;

/// The motion of a model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Simulated {
    /// Instants \[s\], shape (N).
    pub time_s: Vec<f64>,
    /// Coordinates, row-major, shape (N, nq), as in `sim::State`.
    pub qpos: Vec<f64>,
}

/// Coordinates are rounded to one part in this of a radian or a metre, chosen.
const COORDINATE_STEPS_PER_UNIT: f64 = 1e9;

impl Simulated {
    /// The table as text.
    pub fn text(&self) -> String {
        let nq = self.qpos.len() / self.time_s.len().max(1);
        let mut text = String::from("time_s");
        for index in 0..nq {
            let _ = write!(text, ",q{index}");
        }
        for (row, time_s) in self.time_s.iter().enumerate() {
            let _ = write!(text, "\n{time_s}");
            for value in &self.qpos[row * nq..(row + 1) * nq] {
                let _ = write!(
                    text,
                    ",{}",
                    (value * COORDINATE_STEPS_PER_UNIT).round() / COORDINATE_STEPS_PER_UNIT
                );
            }
        }
        text.push('\n');
        text
    }

    /// Reads the table at `path`, of a model with `nq` coordinates.
    ///
    /// # Errors
    /// [`RecordError`] where it cannot be read or is of another model.
    pub fn read(path: &Path, nq: usize) -> Result<Self, RecordError> {
        let text = std::fs::read_to_string(path).map_err(RecordError::io("reading", path))?;
        let mut simulated = Self::default();
        for (number, line) in text.lines().enumerate().skip(1) {
            let cells: Vec<f64> = line.split(',').map_while(|cell| cell.parse().ok()).collect();
            let wanted = line.split(',').count();
            let [time_s, qpos @ ..] = &cells[..] else {
                return Err(RecordError::damaged(path, format!("line {}: no time", number + 1)));
            };
            if cells.len() != wanted || qpos.len() != nq {
                let why =
                    format!("line {}: `time_s` and {nq} coordinates are wanted, as numbers", number + 1);
                return Err(RecordError::damaged(path, why));
            }
            simulated.time_s.push(*time_s);
            simulated.qpos.extend(qpos);
        }
        Ok(simulated)
    }

    /// The coordinates at the image of `time_s`, shape (nq), where it is one of the table's.
    pub fn at(&self, time_s: f64) -> Option<&[f64]> {
        let row = row_at(&self.time_s, time_s)?;
        let nq = self.qpos.len() / self.time_s.len();
        self.qpos.get(row * nq..(row + 1) * nq)
    }
}

/// The row of the rising `times_s` that is of the image at `time_s`.
pub fn row_at(times_s: &[f64], time_s: f64) -> Option<usize> {
    /// Times in tables are rounded: they count as equal within this \[s\], chosen.
    const TIME_TOLERANCE_S: f64 = 1e-6;
    let row = times_s.partition_point(|&t| t < time_s - TIME_TOLERANCE_S);
    times_s.get(row).filter(|&&t| (t - time_s).abs() <= TIME_TOLERANCE_S).map(|_| row)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_comes_back_from_its_table_and_another_models_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("simulated.csv");
        let moved = Simulated { time_s: vec![0.01, 0.02], qpos: vec![0.5, -1.25, 0.0, 3e-9] };
        std::fs::write(&path, moved.text()).unwrap();
        assert_eq!(Simulated::read(&path, 2).unwrap(), moved);
        assert_eq!(moved.at(0.02 + 1e-7), Some(&[0.0, 3e-9][..]));
        assert_eq!(moved.at(0.015), None);
        assert!(Simulated::read(&path, 3).unwrap_err().to_string().contains("line 2"));
        std::fs::write(&path, "time_s,q0\n0.1,x\n").unwrap();
        assert!(Simulated::read(&path, 1).is_err());
    }
}
