//! The two tables a run consists of: `trajectory.csv` (where the keypoints were) and `servo.csv` (what the
//! servos were told).
//!
//! Numbers are written with as many digits as reading them back exactly takes. Reading is strict: a cell that
//! is no finite number, a row out of order or a column nobody knows is refused with file, line and column.

mod command;
mod trajectory;

use std::path::{Path, PathBuf};

use crate::names::not_there;

pub use command::{parse_command, read_command, write_command};
pub use trajectory::{parse_trajectory, read_trajectory, trajectory_text, write_trajectory};

/// Why a table was refused or could not be written.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// The file could not be read.
    #[error("reading table {}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file could not be written.
    #[error("writing table {}", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is no CSV.
    #[error("{}: not a table of comma separated values", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where and why.
        source: csv::Error,
    },
    /// The first line is not a header of the wanted form.
    #[error("{}, line 1: {reason}", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// What is wrong and what is wanted.
        reason: String,
    },
    /// A row has another number of cells than the header.
    #[error("{}, line {line}: {got} cells under a header of {expected}; a gap is an empty cell, its comma stays", path.display())]
    Width {
        /// The file.
        path: PathBuf,
        /// Line, counted from 1.
        line: u64,
        /// Cells in the header.
        expected: usize,
        /// Cells in the row.
        got: usize,
    },
    /// A cell does not hold what its column wants.
    #[error("{}, line {line}, column {column}: `{text}` is not {wanted}", path.display())]
    Cell {
        /// The file.
        path: PathBuf,
        /// Line, counted from 1.
        line: u64,
        /// Column title.
        column: String,
        /// What the cell holds.
        text: String,
        /// What it should hold, and what to do about it.
        wanted: &'static str,
    },
    /// Time does not rise from one row to the next.
    #[error("{}, line {line}, column time_s: {time_s} does not come after {before_s} of the row above; sort the rows and drop doubles", path.display())]
    Order {
        /// The file.
        path: PathBuf,
        /// Line, counted from 1.
        line: u64,
        /// Time of this row \[s\].
        time_s: f64,
        /// Time of the row above \[s\].
        before_s: f64,
    },
    /// There is a header and nothing below it.
    #[error("{}: no rows below the header; {wanted}", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
        /// What is needed.
        wanted: &'static str,
    },
}

/// A table as text: its header, and its rows with their line numbers.
struct Rows {
    path: PathBuf,
    header: Vec<String>,
    rows: Vec<(u64, csv::StringRecord)>,
}

impl Rows {
    fn parse(text: &str, path: &Path) -> Result<Self, TableError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let malformed = |source| TableError::Malformed { path: path.into(), source };
        let mut reader =
            csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(text.as_bytes());
        let header: Vec<String> = reader.headers().map_err(malformed)?.iter().map(str::to_owned).collect();
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
        for record in reader.records() {
            let record = record.map_err(malformed)?;
            let line = record.position().map_or(0, csv::Position::line);
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
    std::fs::read_to_string(path)
        .map_err(|source| TableError::Unreadable { path: path.into(), source: not_there(source, path) })
}

fn write_text(path: &Path, text: &str) -> Result<(), TableError> {
    std::fs::write(path, text).map_err(|source| TableError::Unwritable { path: path.into(), source })
}

#[cfg(test)]
mod tests;
