//! `extraction.jsonl`: what was found in each image, one line an image, to start again from.

use std::path::Path;

use camera::calibration::Plane;
use record::RecordError;
use record::folder::{RunFolder, file};
use record::outputs::OutputFolder;
use vision::record::{ImageRecord, StoredRecord};

/// Writes `records` into `folder`.
pub(super) fn write(folder: &OutputFolder, records: &[ImageRecord]) -> Result<(), RecordError> {
    let file = folder.file(file::EXTRACTION);
    let mut lines = Vec::new();
    for record in records {
        serde_json::to_writer(&mut lines, &StoredRecord::from(record))
            .map_err(|error| RecordError::damaged(file.path(), error))?;
        lines.push(b'\n');
    }
    file.write(&lines)
}

/// Reads the records of `run`, which must be `count`: one for each usable image.
pub(super) fn read(run: &RunFolder, count: usize) -> Result<Vec<StoredRecord>, RecordError> {
    let path = run.file(file::EXTRACTION);
    let records = read_all(&path)?;
    if records.len() != count {
        let why = format!("{} images, the recording has {count}; replay from frames", records.len());
        return Err(RecordError::damaged(&path, why));
    }
    Ok(records)
}

/// What was found in each usable image, as it stands in a folder of results.
///
/// # Errors
/// [`RecordError`].
pub fn found(folder: &Path, plane: &Plane) -> Result<Vec<ImageRecord>, RecordError> {
    let records = read_all(&folder.join(file::EXTRACTION))?;
    Ok(records.iter().map(|record| record.record(plane)).collect())
}

/// The records in the file at `path`.
///
/// # Errors
/// [`RecordError`].
pub fn read_all(path: &Path) -> Result<Vec<StoredRecord>, RecordError> {
    let text = std::fs::read_to_string(path).map_err(RecordError::io("reading", path))?;
    let record = |(line, text): (usize, &str)| {
        let damaged =
            |error: serde_json::Error| RecordError::damaged(path, format!("line {}: {error}", line + 1));
        serde_json::from_str(text).map_err(damaged)
    };
    text.lines().enumerate().map(record).collect()
}
