//! `frames.csv` of a run folder: one row per image, with its stamps and what became of it.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::files::write_whole;
use super::{RecordError, below};

/// One image of the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameRow {
    /// The camera's count.
    pub sequence: u32,
    /// Mid-exposure, since the run's start \[s\].
    pub time_s: f64,
    /// The camera's raw stamp on CLOCK_MONOTONIC \[ns\].
    pub stamp_ns: u64,
    /// The driver marked the image as damaged.
    pub damaged: bool,
    /// Images that the camera counted but never handed over just before this one.
    pub lost_before: u32,
    /// `ok`, or how the image was rejected.
    pub status: String,
    /// Why it was rejected; empty when it was not.
    pub reason: String,
}

/// Writes the rows to `path`.
///
/// # Errors
/// [`RecordError`].
pub fn write(path: &Path, rows: &[FrameRow]) -> Result<(), RecordError> {
    write_whole(path, &table(rows).map_err(|error| RecordError::damaged(path, error))?)
}

/// The rows as the file has them.
///
/// # Errors
/// What the writer says.
pub fn table(rows: &[FrameRow]) -> Result<Vec<u8>, csv::Error> {
    let mut table = csv::Writer::from_writer(Vec::new());
    for row in rows {
        table.serialize(row)?;
    }
    table.into_inner().map_err(|error| error.into_error().into())
}

/// Reads the rows at `path`.
///
/// # Errors
/// [`RecordError`] naming the line.
pub fn read(path: &Path) -> Result<Vec<FrameRow>, RecordError> {
    let file = below::at(path).map_err(RecordError::io("reading", path))?;
    csv::Reader::from_reader(file)
        .deserialize()
        .collect::<Result<_, _>>()
        .map_err(|error| RecordError::damaged(path, error))
}

/// How many rows there are at `path`; none where there is no such file.
pub fn count(path: &Path) -> Option<u64> {
    let text = std::fs::read(path).ok()?;
    let lines = text.iter().filter(|&&byte| byte == b'\n').count() as u64;
    Some(lines.saturating_sub(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_survive_the_round_trip() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frames.csv");
        let row = FrameRow {
            sequence: 3,
            time_s: 0.1 + 0.2,
            stamp_ns: u64::MAX,
            damaged: true,
            lost_before: 2,
            status: "rejected".into(),
            reason: "two components, \"equal\" in size".into(),
        };
        write(&path, std::slice::from_ref(&row)).unwrap();
        assert_eq!((read(&path).unwrap(), count(&path)), (vec![row], Some(1)));
    }
}
