//! The tables a run consists of: `trajectory.csv` (where the keypoints were), `servo.csv` (what the
//! servos were told) and, where the base moves, `base.csv` (where it was).
//!
//! Numbers are written with as many digits as reading them back exactly takes. Reading is strict: a cell that
//! is no finite number, a row out of order or a column nobody knows is refused with file, line and column.

mod base;
mod command;
mod error;
mod trajectory;

use std::path::{Path, PathBuf};

use ground::{names, spreadsheet};

pub use base::{parse_base, read_base, write_base};
pub use command::{
    MeasuredAngles, PUSHES, ServoTable, parse_servo, read_command, read_servo, servo_text, write_command,
    write_servo,
};
pub use error::TableError;
pub use trajectory::{parse_trajectory, read_trajectory, trajectory_text, write_trajectory};

/// A table as text: its header, and its rows with their line numbers.
struct Rows {
    path: PathBuf,
    header: Vec<String>,
    rows: Vec<spreadsheet::Row>,
}

impl Rows {
    fn parse(text: &str, path: &Path) -> Result<Self, TableError> {
        let all = spreadsheet::rows(text);
        let mut all = all.map_err(|source| TableError::Malformed { path: path.into(), source })?.into_iter();
        let header: Vec<String> =
            all.next().iter().flat_map(|(_, header)| header.iter()).map(str::to_owned).collect();
        let refuse = |reason: String| Err(TableError::Header { path: path.into(), reason });
        if header.first().map(String::as_str) != Some("time_s") {
            let found = header.first().map_or("", String::as_str);
            return refuse(format!("the first column is `{found}`; it must be `time_s`, in seconds"));
        }
        if let Some((at, title)) = header.iter().enumerate().find(|(at, title)| header[..*at].contains(title))
        {
            return refuse(format!("column {} repeats `{title}`; rename or remove one", at + 1));
        }
        let mut rows = Vec::new();
        for (line, record) in all {
            if record.len() != header.len() {
                let (expected, got) = (header.len(), record.len());
                return Err(TableError::Width { path: path.into(), line, expected, got });
            }
            rows.push((line, record));
        }
        Ok(Self { path: path.into(), header, rows })
    }

    /// Row times \[s\]: finite and strictly rising.
    fn times(&self) -> Result<Vec<f64>, TableError> {
        let mut times: Vec<f64> = Vec::with_capacity(self.rows.len());
        for row in 0..self.rows.len() {
            let time_s = self.number(row, 0, "a finite number of seconds")?;
            if let Some(&before_s) = times.last().filter(|&&before_s| time_s <= before_s) {
                return Err(TableError::Order {
                    path: self.path.clone(),
                    line: self.rows[row].0,
                    time_s,
                    before_s,
                });
            }
            times.push(time_s);
        }
        Ok(times)
    }

    fn number(&self, row: usize, column: usize, wanted: &'static str) -> Result<f64, TableError> {
        let parsed = self.rows[row].1[column].parse::<f64>().ok().filter(|value| value.is_finite());
        parsed.ok_or_else(|| self.cell(row, column, wanted))
    }

    /// An empty cell is NaN.
    fn number_or_gap(&self, row: usize, column: usize, wanted: &'static str) -> Result<f64, TableError> {
        if self.rows[row].1[column].is_empty() { Ok(f64::NAN) } else { self.number(row, column, wanted) }
    }

    fn cell(&self, row: usize, column: usize, wanted: &'static str) -> TableError {
        let (line, record) = &self.rows[row];
        TableError::Cell {
            path: self.path.clone(),
            line: *line,
            column: self.header[column].clone(),
            text: record[column].to_owned(),
            wanted,
        }
    }
}

fn read_text(path: &Path) -> Result<String, TableError> {
    names::read_text(path).map_err(|source| TableError::Unreadable { path: path.into(), source })
}

fn write_text(path: &Path, text: &str) -> Result<(), TableError> {
    std::fs::write(path, text).map_err(|source| TableError::Unwritable { path: path.into(), source })
}

#[cfg(test)]
mod tests;
