//! Whether a run folder is what was written.

use std::path::Path;

use super::RecordError;
use super::folder::{RunFolder, file};
use super::reader::{End, Item, Recording};
use super::start_stop::Status;
use super::sums::{Sum, Sums, is_result};
use crate::clock::MonotonicNs;
use crate::error_chain::with_causes;

/// How a run folder stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum State {
    /// All that was written is there.
    Sound,
    /// It has no `stop.json`: it was cut short.
    Incomplete,
    /// Something that was written is not there, or is not what was written.
    Damaged,
}

impl std::fmt::Display for State {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Sound => "sound",
            Self::Incomplete => "incomplete",
            Self::Damaged => "damaged",
        })
    }
}

/// What was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Verified {
    /// In a word.
    pub state: State,
    /// In sentences without their full stops: what is wrong, else what was looked at.
    pub findings: Vec<String>,
}

/// What a recording gives.
struct Readable {
    images: u64,
    /// When the last of it was handed over \[s\].
    until_s: f64,
    /// Whether it has its end.
    is_closed: bool,
    /// Why it cannot be read on.
    error: Option<String>,
}

/// Looks at the run folder `path`: compares all files with their checksums, or, where it has none, reads the recording by its own.
pub fn verify(path: &Path) -> Verified {
    let damaged =
        |error: &RecordError| Verified { state: State::Damaged, findings: vec![with_causes(error)] };
    let (run, sums) = match RunFolder::open(path).and_then(|run| Ok((run, Sums::read(path)?))) {
        Ok(read) => read,
        Err(error) => return damaged(&error),
    };
    let Some(stop) = run.stop() else { return incomplete(&run) };
    let Some(sums) = sums else { return without_sums(&run, stop.status) };
    let mut findings = Vec::new();
    for (name, sum) in &sums.0 {
        let again = if is_result(name) { "; `rig replay` makes it again, into another folder" } else { "" };
        match Sum::of_file(&run.file(name)) {
            Ok(found) if found == *sum => {}
            Ok(_) if name == file::RECORDING => {
                findings.push(format!("{name} is not what was written: {}", readable(&run).say()));
            }
            Ok(_) => findings.push(format!("{name} is not what was written{again}")),
            Err(RecordError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
                findings.push(format!("{name} is missing{again}"));
            }
            Err(error) => findings.push(with_causes(&error)),
        }
    }
    if findings.is_empty() {
        Verified { state: State::Sound, findings: vec![format!("{} files", sums.0.len())] }
    } else {
        Verified { state: State::Damaged, findings }
    }
}

fn incomplete(run: &RunFolder) -> Verified {
    let readable = readable(run);
    let findings = vec![readable.say(), "`rig runs recover` completes it".into()];
    Verified { state: State::Incomplete, findings }
}

/// Of a run that was made before there were checksums.
fn without_sums(run: &RunFolder, status: Status) -> Verified {
    let readable = readable(run);
    let state = match (&readable.error, status) {
        (None, Status::Success) if readable.is_closed => State::Sound,
        (None, Status::Abort | Status::Fail) => State::Sound,
        _ => State::Damaged,
    };
    Verified { state, findings: vec![format!("no {}; {}", file::SUMS, readable.say())] }
}

fn readable(run: &RunFolder) -> Readable {
    let mut readable = Readable { images: 0, until_s: 0.0, is_closed: false, error: None };
    let mut until: Option<MonotonicNs> = None;
    match Recording::open(&run.file(file::RECORDING)) {
        Ok(mut recording) => {
            for item in recording.by_ref() {
                match item {
                    Ok((at, item)) => {
                        readable.images += u64::from(matches!(item, Item::Image(_)));
                        until = Some(at);
                    }
                    Err(error) => {
                        readable.error = Some(with_causes(&error));
                        break;
                    }
                }
            }
            readable.is_closed = recording.end() == End::Closed;
        }
        Err(error) => readable.error = Some(with_causes(&error)),
    }
    readable.until_s = until.map_or(0.0, |at| at.seconds_since(run.origin()).max(0.0));
    readable
}

impl Readable {
    fn say(&self) -> String {
        let kept = format!("{} images, {:.1} s can be read", self.images, self.until_s);
        match &self.error {
            Some(error) => format!("{kept}; {error}"),
            None if self.is_closed => kept,
            None => format!("{kept}; the recording was cut off"),
        }
    }
}
