//! `extraction.jsonl`: what was found in each image, one line an image, to start again from.

use rayon::prelude::*;

use crate::record::RecordError;
use crate::record::folder::{RunFolder, file, write_whole};
use crate::vision::record::{ImageRecord, StoredRecord};

/// Writes the records into `folder`.
pub(super) fn write(folder: &std::path::Path, records: &[ImageRecord]) -> Result<(), RecordError> {
    let path = folder.join(file::EXTRACTION);
    let line = |record| serde_json::to_vec(&StoredRecord::from(record));
    let lines: Result<Vec<Vec<u8>>, serde_json::Error> = records.par_iter().map(line).collect();
    let mut text = lines.map_err(|error| RecordError::damaged(&path, error))?.join(&b'\n');
    text.push(b'\n');
    write_whole(&path, &text)
}

/// Reads the records of `run`, which must be `count`: one for each usable image.
pub(super) fn read(run: &RunFolder, count: usize) -> Result<Vec<StoredRecord>, RecordError> {
    let path = run.file(file::EXTRACTION);
    let text = std::fs::read_to_string(&path).map_err(RecordError::io("reading", &path))?;
    let record = |(line, text): (usize, &str)| {
        let damaged =
            |error: serde_json::Error| RecordError::damaged(&path, format!("line {}: {error}", line + 1));
        serde_json::from_str(text).map_err(damaged)
    };
    let records = text.lines().enumerate().map(record).collect::<Result<Vec<StoredRecord>, _>>()?;
    if records.len() != count {
        let why = format!("{} images, the recording has {count}; replay from frames", records.len());
        return Err(RecordError::damaged(&path, why));
    }
    Ok(records)
}
