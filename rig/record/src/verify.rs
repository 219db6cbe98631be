//! Verifies that the files of a run folder are as they were written.

use std::path::Path;

use super::RecordError;
use super::folder::{RunFolder, file};
use super::frames;
use super::reader::{End, Item, Recording};
use super::start_stop::{Status, Stop};
use super::sums::{RESULTS, Sum, Sums, is_result};
use ground::clock::MonotonicNs;
use ground::error_chain::with_causes;

/// The state of a run folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum State {
    /// All that was written is there.
    Sound,
    /// It has no `stop.json` that can be read, or its analysis was cut short.
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

/// The result of verifying a run folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Verified {
    /// The state.
    pub state: State,
    /// In sentences without their full stops: what is wrong, else what was looked at.
    pub findings: Vec<String>,
}

/// What can be read of a recording.
struct Readable {
    images: u64,
    /// When the last of it was handed over \[s\].
    until_s: f64,
    /// Whether it has its end.
    is_closed: bool,
    /// What is missing in it.
    shortfall: Option<String>,
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
    let Some(sums) = sums else { return without_sums(&run, stop) };
    let mut findings = Vec::new();
    for (name, sum) in &sums.0 {
        let again = if is_result(name) { "; `rig replay` makes it again, into another folder" } else { "" };
        match Sum::of_file(&run.file(name)) {
            Ok(found) if found == *sum => {}
            Ok(_) if name == file::RECORDING => findings.push(format!(
                "{name} is not what was written: {}; `rig runs recover` makes it whole without what cannot be read",
                readable(&run).say(stop.images)
            )),
            Ok(_) => findings.push(format!("{name} is not what was written{again}")),
            Err(RecordError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
                findings.push(format!("{name} is missing{again}"));
            }
            Err(error) => findings.push(with_causes(&error)),
        }
    }
    let unlisted = |names: &[&str]| -> Vec<String> {
        let unlisted = |name: &&&str| !sums.0.contains_key(**name) && run.file(name).exists();
        names.iter().filter(unlisted).map(|name| (*name).to_owned()).collect()
    };
    let recorded = unlisted(&[file::START, file::STOP, file::JOURNAL, file::RECORDING, &run.start().model]);
    if !recorded.is_empty() {
        findings.push(format!("{} has no line for {}", file::SUMS, recorded.join(", ")));
    }
    if !findings.is_empty() {
        return Verified { state: State::Damaged, findings };
    }
    let results = unlisted(&RESULTS);
    if !results.is_empty() {
        let why =
            format!("{} has no line for {}: the analysis was cut short", file::SUMS, results.join(", "));
        return Verified { state: State::Incomplete, findings: vec![why] };
    }
    Verified { state: State::Sound, findings: vec![format!("{} files", sums.0.len())] }
}

fn incomplete(run: &RunFolder) -> Verified {
    let why = run.unreadable_stop().and_then(|_| run.incomplete());
    let known = frames::read(&run.file(file::FRAMES)).map_or(0, |rows| rows.len() as u64);
    let findings = [readable(run).say(known), "`rig runs recover` completes it".into()];
    Verified { state: State::Incomplete, findings: why.into_iter().chain(findings).collect() }
}

/// Of a run that was made before there were checksums.
fn without_sums(run: &RunFolder, stop: &Stop) -> Verified {
    let readable = readable(run);
    let state = match stop.status {
        _ if readable.images < stop.images => State::Damaged,
        Status::Success if readable.shortfall.is_some() || !readable.is_closed => State::Damaged,
        _ => State::Sound,
    };
    Verified { state, findings: vec![format!("no {}; {}", file::SUMS, readable.say(stop.images))] }
}

fn readable(run: &RunFolder) -> Readable {
    let mut readable = Readable { images: 0, until_s: 0.0, is_closed: false, shortfall: None };
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
                        readable.shortfall = Some(with_causes(&error));
                        break;
                    }
                }
            }
            readable.is_closed = recording.end() == End::Closed;
            readable.shortfall = readable.shortfall.or_else(|| recording.shortfall());
        }
        Err(error) => readable.shortfall = Some(with_causes(&error)),
    }
    readable.until_s = until.map_or(0.0, |at| at.seconds_since(run.origin()).max(0.0));
    readable
}

impl Readable {
    /// `received`: how many images there should be at least.
    fn say(&self, received: u64) -> String {
        let of = if received > self.images { format!("of {received} ") } else { String::new() };
        let summary = format!("{} {of}images, {:.1} s can be read", self.images, self.until_s);
        match &self.shortfall {
            Some(shortfall) => format!("{summary}; {shortfall}"),
            None => summary,
        }
    }
}
