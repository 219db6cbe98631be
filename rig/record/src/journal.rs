//! `journal.jsonl`: what happened in a run, one JSON object a line, each on its way to the disk before the call returns.

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::files::{containing, sync_folder};
use super::{RecordError, below};
use ground::clock::MonotonicNs;

/// One line of the journal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Seconds since the run's start.
    pub at_s: f64,
    /// What happened, in kebab case.
    pub event: String,
    /// Further details of the event.
    #[serde(flatten)]
    pub details: Map<String, Value>,
}

/// Writes a run's journal from any thread.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    origin: MonotonicNs,
    file: Mutex<File>,
}

impl Journal {
    /// Opens the journal at `path` for appending; times count from `origin`. A last line that a crash has cut off is taken away:
    /// what is appended to it could not be read.
    ///
    /// # Errors
    /// [`RecordError::Io`].
    pub fn open(path: &Path, origin: MonotonicNs) -> Result<Self, RecordError> {
        let open = || -> std::io::Result<File> {
            let mut file = File::options().create(true).read(true).append(true).open(path)?;
            let mut text = Vec::new();
            file.read_to_end(&mut text)?;
            let whole = whole_lines(&text).len();
            if whole < text.len() {
                file.set_len(whole as u64)?;
            }
            Ok(file)
        };
        let file = open().map_err(RecordError::io("opening journal", path))?;
        sync_folder(containing(path))?;
        Ok(Self { path: path.into(), origin, file: Mutex::new(file) })
    }

    /// Writes one event; `details` serialises to a JSON object (or to nothing, with `()`).
    ///
    /// # Errors
    /// [`RecordError`] when the disk refuses it.
    pub fn write(&self, event: &str, details: impl Serialize) -> Result<(), RecordError> {
        let details = match serde_json::to_value(details) {
            Ok(Value::Object(details)) => details,
            Ok(Value::Null) => Map::new(),
            Ok(other) => Map::from_iter([("detail".to_owned(), other)]),
            Err(error) => return Err(RecordError::damaged(&self.path, error)),
        };
        let at_s = MonotonicNs::now().seconds_since(self.origin);
        let entry = Entry { at_s, event: event.into(), details };
        let mut line = serde_json::to_vec(&entry).map_err(|error| RecordError::damaged(&self.path, error))?;
        line.push(b'\n');
        // One write call: a line is there whole or, cut off by a crash, is the last one.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(&line).map_err(RecordError::io("writing journal", &self.path))
    }

    /// Forces everything written to the disk.
    ///
    /// # Errors
    /// [`RecordError::Io`].
    pub fn sync(&self) -> Result<(), RecordError> {
        let file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.sync_data().map_err(RecordError::io("forcing to the disk journal", &self.path))
    }
}

/// Reads a journal; a last line without its end is left out.
///
/// # Errors
/// [`RecordError`] when the file cannot be read or a whole line is not an entry.
pub fn read(path: &Path) -> Result<Vec<Entry>, RecordError> {
    let text = below::read_at(path).map_err(RecordError::io("reading journal", path))?;
    whole_lines(&text)
        .split(|&byte| byte == b'\n')
        .filter(|line| !line.is_empty())
        .enumerate()
        .map(|(index, line)| {
            serde_json::from_slice(line)
                .map_err(|error| RecordError::damaged(path, format!("line {}: {error}", index + 1)))
        })
        .collect()
}

/// All whole lines: everything up to the last line's end.
fn whole_lines(text: &[u8]) -> &[u8] {
    text.iter().rposition(|&byte| byte == b'\n').map_or(&text[..0], |end| &text[..=end])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn journal_cut_at_any_byte_keeps_every_whole_line() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        let journal = Journal::open(&path, MonotonicNs::now()).unwrap();
        journal.write("armed", serde_json::json!({"boot_id": 7})).unwrap();
        journal.write("finished", ()).unwrap();
        journal.sync().unwrap();

        let text = std::fs::read(&path).unwrap();
        let first_line = text.iter().position(|&byte| byte == b'\n').unwrap() + 1;
        for cut in 0..=text.len() {
            std::fs::write(&path, &text[..cut]).unwrap();
            let expected = usize::from(cut >= first_line) + usize::from(cut == text.len());
            assert_eq!(read(&path).unwrap().len(), expected, "cut at {cut}");
        }
        let entries = read(&path).unwrap();
        assert_eq!(entries[0].event, "armed");
        assert_eq!(entries[0].details["boot_id"], 7);
        assert!(entries[1].at_s >= entries[0].at_s);
    }

    #[test]
    fn journal_that_a_crash_has_cut_in_a_line_goes_on_behind_the_last_whole_one() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        Journal::open(&path, MonotonicNs::now()).unwrap().write("first", ()).unwrap();
        let text = std::fs::read(&path).unwrap();
        for cut in 0..=text.len() {
            std::fs::write(&path, [&text, &text[..cut]].concat()).unwrap();
            Journal::open(&path, MonotonicNs::now()).unwrap().write("next", ()).unwrap();
            let events: Vec<_> = read(&path).unwrap().into_iter().map(|entry| entry.event).collect();
            let expected =
                if cut == text.len() { &["first", "first", "next"][..] } else { &["first", "next"] };
            assert_eq!(events, expected, "cut at {cut}");
        }
    }

    #[test]
    fn damaged_line_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("journal.jsonl");
        std::fs::write(&path, "{\"at_s\":0.0,\"event\":\"a\"}\nnonsense\n").unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("line 2"));
    }
}
