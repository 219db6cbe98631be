//! Why a table was refused.

use std::path::PathBuf;

/// Why a table was refused or could not be written.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// The file could not be read.
    #[error("reading table {}", path.display())]
    Unreadable {
        /// Path of the file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file could not be written.
    #[error("writing table {}", path.display())]
    Unwritable {
        /// Path of the file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is no CSV.
    #[error("{}: not a table of comma separated values", path.display())]
    Malformed {
        /// Path of the file.
        path: PathBuf,
        /// Where and why.
        source: csv::Error,
    },
    /// The first line is not a header of the wanted form.
    #[error("{}, line 1: {reason}", path.display())]
    Header {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong and what is wanted.
        reason: String,
    },
    /// A row has another number of cells than the header.
    #[error("{}, line {line}: {got} cells under a header of {expected}; a gap is an empty cell, its comma stays", path.display())]
    Width {
        /// Path of the file.
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
        /// Path of the file.
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
        /// Path of the file.
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
        /// Path of the file.
        path: PathBuf,
        /// What is needed.
        wanted: &'static str,
    },
}
