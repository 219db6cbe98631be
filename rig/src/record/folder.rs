//! A run's folder: `start.json` is written first and `stop.json` last, each in one step.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};

pub use ident::experiment::RunKind;
use rand::RngExt;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::RecordError;
use super::journal::Journal;
use super::sums::{Sum, Sums};
use crate::camera::CameraInfo;
use crate::clock::MonotonicNs;
use crate::servo::{BoardInfo, StopOutcome};

/// Names of the files in a run folder.
pub mod file {
    /// All that was known before the run.
    pub const START: &str = "start.json";
    /// How the run ended.
    pub const STOP: &str = "stop.json";
    /// Events as they happened.
    pub const JOURNAL: &str = "journal.jsonl";
    /// Images, telemetry and commands.
    pub const RECORDING: &str = "recording.mcap";
    /// One row per image.
    pub const FRAMES: &str = "frames.csv";
    /// Commanded and measured angles.
    pub const SERVO: &str = "servo.csv";
    /// Silhouette and keypoints of each image, in the picture.
    pub const EXTRACTION: &str = "extraction.jsonl";
    /// Keypoints over time.
    pub const TRAJECTORY: &str = "trajectory.csv";
    /// What the fit began with; there where a fit of the first part was done before the rest was filmed.
    pub const WARM_START: &str = "warm-start.json";
    /// What was fitted.
    pub const FIT: &str = "fit.json";
    /// What the simulation gets wrong, and why.
    pub const DIAGNOSIS: &str = "diagnosis.json";
    /// The calibrated model.
    pub const MODEL: &str = "model.xml";
    /// How the calibrated model moves: its coordinates at each image.
    pub const SIMULATED: &str = "simulated.csv";
    /// The model as it was before the run.
    pub const MODEL_START: &str = "model-start.xml";
    /// Wall times.
    pub const TIMING: &str = "timing.json";
    /// The report.
    pub const REPORT: &str = "report.html";
    /// Says that the recording was deleted, and which it was.
    pub const RETENTION: &str = "retention.json";
    /// Checksums of all of these.
    pub const SUMS: &str = "SHA256SUMS";
}

/// A run's name, for example `20261120T101503Z-ab12cd`: when it began, and six random characters.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct RunId(String);

impl RunId {
    /// A new name for a run that begins now.
    pub fn now() -> Self {
        const LETTERS: &[u8] = b"abcdefghijklmnopqrstuvwxyz0123456789";
        let mut random = rand::rng();
        let suffix: String =
            (0..6).map(|_| char::from(LETTERS[random.random_range(0..LETTERS.len())])).collect();
        Self(format!("{}-{suffix}", jiff::Timestamp::now().strftime("%Y%m%dT%H%M%SZ")))
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for RunId {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        let shape = |pattern: &str| {
            pattern.len() == name.len()
                && name.bytes().zip(pattern.bytes()).all(|(byte, wanted)| match wanted {
                    b'9' => byte.is_ascii_digit(),
                    b'a' => byte.is_ascii_lowercase() || byte.is_ascii_digit(),
                    other => byte == other,
                })
        };
        if shape("99999999T999999Z-aaaaaa") {
            Ok(Self(name))
        } else {
            Err(format!("run id `{name}` is not of the form 20261120T101503Z-ab12cd"))
        }
    }
}

impl std::str::FromStr for RunId {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        name.to_owned().try_into()
    }
}

impl From<RunId> for String {
    fn from(id: RunId) -> Self {
        id.0
    }
}

impl std::fmt::Display for RunId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// The same instant on both clocks: a later jump of the wall clock shows, and does no harm.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClockPair {
    /// CLOCK_MONOTONIC.
    pub monotonic_ns: MonotonicNs,
    /// Wall clock, RFC 3339.
    pub utc: String,
}

impl ClockPair {
    /// Now.
    pub fn now() -> Self {
        Self { monotonic_ns: MonotonicNs::now(), utc: jiff::Timestamp::now().to_string() }
    }
}

/// `start.json`: all that was known before the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// The run's name.
    pub id: RunId,
    /// How it moves.
    pub kind: RunKind,
    /// The model's file in this folder.
    pub model: String,
    /// In driven runs the actuated joint follows `servo.csv` exactly.
    pub prescribed: bool,
    /// The run's time origin.
    pub clock: ClockPair,
    /// Version of this program.
    pub version: String,
    /// The servo board, where one takes part.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub board: Option<BoardInfo>,
    /// The camera, as set up.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub camera: Option<CameraInfo>,
    /// The whole configuration as TOML text.
    pub config: String,
    /// What else is known: calibration, water, weights.
    #[serde(flatten)]
    pub details: BTreeMap<String, Value>,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// As planned.
    Success,
    /// The user, or a signal, ended it.
    Abort,
    /// A fault ended it.
    Fail,
}

/// `stop.json`: how the run ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stop {
    /// In a word.
    pub status: Status,
    /// Why, unless it went as planned.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub reason: Option<String>,
    /// When.
    pub clock: ClockPair,
    /// How the servo was stopped.
    pub servo: StopOutcome,
    /// Images received.
    pub images: u64,
    /// Images that the camera counted and never handed over.
    pub images_lost: u64,
    /// Images received that the driver marked as damaged or that were not whole; none is looked at.
    #[serde(default)]
    pub images_damaged: u64,
    /// Images received whose bytes are those of the one before; several in a row while something moves end a run.
    #[serde(default)]
    pub images_repeated: u64,
    /// Images received whose stamp is not later than all before; none is looked at.
    #[serde(default)]
    pub images_stale: u64,
    /// Messages that did not fit into the recording's queue.
    pub messages_dropped: u64,
    /// Which of the images received, counted from 0, the empty tank was learned from while filming; absent where the motion
    /// was too short for that.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub learn_from: Option<Range<u64>>,
    /// Written afterwards, for a run that had ended without a word.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub recovered: Option<Recovered>,
}

/// What was left of a run that had ended without a word.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Recovered {
    /// When it was looked at, RFC 3339.
    pub at_utc: String,
    /// Bytes of the recording that cannot be read; they stay in it.
    pub unreadable_bytes: u64,
}

/// A run's folder, being written or read.
#[derive(Debug, Clone)]
pub struct RunFolder {
    path: PathBuf,
    start: Start,
    stop: Option<Stop>,
}

impl RunFolder {
    /// Creates the folder `runs_dir/<start.id>` with its `start.json`, in one step: under another name first, so that there is no
    /// run folder without it.
    ///
    /// # Errors
    /// [`RecordError`] when the folder exists or cannot be written.
    pub fn create(runs_dir: &Path, start: Start) -> Result<Self, RecordError> {
        create_folder(runs_dir)?;
        let path = runs_dir.join(start.id.as_str());
        let new = runs_dir.join(format!("{NEW}{}", start.id));
        std::fs::create_dir(&new).map_err(RecordError::io("creating run folder", &new))?;
        write_json(&new.join(file::START), &start)?;
        // a folder with something in it is not replaced
        std::fs::rename(&new, &path).map_err(RecordError::io("creating run folder", &path))?;
        sync_folder(runs_dir)?;
        Ok(Self { path, start, stop: None })
    }

    /// Opens a run folder for reading. One without `stop.json` is incomplete and opens all the same.
    ///
    /// # Errors
    /// [`RecordError`] when there is no readable `start.json`, or a `stop.json` that cannot be read.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let start = read_json(&path.join(file::START))?;
        let stop = path.join(file::STOP);
        let stop = if stop.exists() { Some(read_json(&stop)?) } else { None };
        Ok(Self { path: path.into(), start, stop })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The path of one of its files, by a name of [`mod@file`].
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// All that was known before the run.
    pub fn start(&self) -> &Start {
        &self.start
    }

    /// How it ended; none while it runs and when it was cut short.
    pub fn stop(&self) -> Option<&Stop> {
        self.stop.as_ref()
    }

    /// The run's time origin.
    pub fn origin(&self) -> MonotonicNs {
        self.start.clock.monotonic_ns
    }

    /// Opens the journal for writing.
    ///
    /// # Errors
    /// [`RecordError::Io`].
    pub fn journal(&self) -> Result<Journal, RecordError> {
        Journal::open(&self.file(file::JOURNAL), self.origin())
    }

    /// Writes `bytes` to the file `name`, in one step: it is there whole or not at all.
    ///
    /// # Errors
    /// [`RecordError::Io`].
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), RecordError> {
        write_whole(&self.file(name), bytes)
    }

    /// Writes the checksums of all files there are, and then `stop.json`: the run is over. The recording is not read where its sum
    /// is known.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn finish(&mut self, stop: Stop, recording: Option<Sum>) -> Result<(), RecordError> {
        let path = self.file(file::STOP);
        let json = json(&path, &stop)?;
        let known = [(file::STOP, Some(Sum::of(&json))), (file::RECORDING, recording)];
        let known = known.into_iter().filter_map(|(name, sum)| Some((name.to_owned(), sum?))).collect();
        Sums::of_folder(&self.path, Sums(known))?.write(&self.path)?;
        write_whole(&path, &json)?;
        self.stop = Some(stop);
        Ok(())
    }
}

/// Run folders that are being made are called so, with their ids behind.
const NEW: &str = ".new-";

/// Removes what is left of run folders whose making was cut short: nothing was recorded in them.
///
/// # Errors
/// [`RecordError::Io`] when `runs_dir` cannot be read.
pub fn remove_unmade(runs_dir: &Path) -> Result<(), RecordError> {
    let io = || RecordError::io("reading runs folder", runs_dir);
    for entry in std::fs::read_dir(runs_dir).map_err(io())? {
        let entry = entry.map_err(io())?;
        let name = entry.file_name().into_string().unwrap_or_default();
        if name.strip_prefix(NEW).is_some_and(|id| RunId::try_from(id.to_owned()).is_ok()) {
            for part in [file::START.to_owned(), format!("{}.part", file::START)] {
                // what is not there needs no removing, and what cannot be removed harms nobody
                let _ = std::fs::remove_file(entry.path().join(part));
            }
            let _ = std::fs::remove_dir(entry.path());
        }
    }
    Ok(())
}

/// Makes the folder `path`, and those above it, where it is missing, and sees that a power cut leaves it there.
///
/// # Errors
/// [`RecordError::Io`].
pub fn create_folder(path: &Path) -> Result<(), RecordError> {
    if path.is_dir() {
        return Ok(());
    }
    create_folder(containing(path))?;
    match std::fs::create_dir(path) {
        // another process has made it
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists && path.is_dir() => {}
        made => made.map_err(RecordError::io("creating folder", path))?,
    }
    sync_folder(containing(path))
}

/// One run of a runs folder.
#[derive(Debug)]
pub struct Listed {
    /// Its name.
    pub id: RunId,
    /// The run, or why it cannot be opened.
    pub folder: Result<RunFolder, RecordError>,
}

/// The run folders in `runs_dir`, oldest first.
///
/// # Errors
/// [`RecordError::Io`] when `runs_dir` cannot be read.
pub fn list(runs_dir: &Path) -> Result<Vec<Listed>, RecordError> {
    let io = || RecordError::io("reading runs folder", runs_dir);
    let mut runs = Vec::new();
    for entry in std::fs::read_dir(runs_dir).map_err(io())? {
        let entry = entry.map_err(io())?;
        let name = entry.file_name().into_string().unwrap_or_default();
        if let Ok(id) = RunId::try_from(name) {
            runs.push(Listed { id, folder: RunFolder::open(&entry.path()) });
        }
    }
    runs.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(runs)
}

/// Writes a file in one step: beside its place, forced to the disk, then renamed.
///
/// # Errors
/// [`RecordError::Io`]; the old content is then still there.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), RecordError> {
    let folder = containing(path);
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let part = folder.join(name);
    let write = || -> std::io::Result<()> {
        let mut file = File::create(&part)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&part, path)
    };
    write().map_err(RecordError::io("writing", path))?;
    sync_folder(folder)
}

/// The folder that `path` is in.
pub(super) fn containing(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A new file or another name is on the disk only when its folder is.
pub(super) fn sync_folder(path: &Path) -> Result<(), RecordError> {
    File::open(path)
        .and_then(|folder| folder.sync_all())
        .map_err(RecordError::io("forcing to the disk folder", path))
}

/// Writes `value` as JSON in one step.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), RecordError> {
    write_whole(path, &json(path, value)?)
}

/// `value` as JSON, for the file at `path`.
fn json(path: &Path, value: &impl Serialize) -> Result<Vec<u8>, RecordError> {
    let mut json = serde_json::to_vec_pretty(value).map_err(|error| RecordError::damaged(path, error))?;
    json.push(b'\n');
    Ok(json)
}

/// Reads a value from JSON.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, RecordError> {
    let text = std::fs::read(path).map_err(RecordError::io("reading", path))?;
    serde_json::from_slice(&text).map_err(|error| RecordError::damaged(path, error))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn start() -> Start {
        Start {
            id: RunId::now(),
            kind: RunKind::Drop,
            model: file::MODEL_START.into(),
            prescribed: false,
            clock: ClockPair::now(),
            version: "0.1.0".into(),
            board: None,
            camera: None,
            config: "[camera]\nfps = 100.0\n".into(),
            details: BTreeMap::from([("water".into(), serde_json::json!({"temperature_c": 22.0}))]),
        }
    }

    #[test]
    fn run_without_stop_is_incomplete_and_opens() {
        let dir = tempfile::tempdir().unwrap();
        let start = start();
        let mut run = RunFolder::create(dir.path(), start.clone()).unwrap();
        let read = RunFolder::open(run.path()).unwrap();
        assert_eq!(read.start(), &start);
        assert!(read.stop().is_none());

        let stop = Stop {
            status: Status::Fail,
            reason: Some("camera gone".into()),
            clock: ClockPair::now(),
            servo: StopOutcome::Acknowledged,
            images: 12,
            images_lost: 1,
            images_damaged: 2,
            images_repeated: 3,
            images_stale: 4,
            messages_dropped: 0,
            learn_from: None,
            recovered: None,
        };
        run.finish(stop.clone(), None).unwrap();
        assert_eq!(RunFolder::open(run.path()).unwrap().stop(), Some(&stop));
        let names: Vec<_> = std::fs::read_dir(run.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        assert!(names.iter().all(|name| !name.ends_with(".part")), "{names:?}");
    }

    #[test]
    fn second_run_of_the_same_name_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let start = start();
        RunFolder::create(dir.path(), start.clone()).unwrap();
        assert!(matches!(RunFolder::create(dir.path(), start), Err(RecordError::Io { .. })));
    }

    #[test]
    fn names_that_lead_elsewhere_are_no_run_ids() {
        assert!(RunId::try_from(RunId::now().as_str().to_owned()).is_ok());
        for name in
            ["../../etc", "20261120T101503Z-AB12CD", "20261120T101503Z-ab12c", "20261120T101503Z-ab/2cd", ""]
        {
            assert!(RunId::try_from(name.to_owned()).is_err(), "{name}");
        }
    }

    #[test]
    fn list_shows_runs_in_order_and_says_what_it_cannot_open() {
        let dir = tempfile::tempdir().unwrap();
        let run = RunFolder::create(dir.path(), start()).unwrap();
        std::fs::create_dir(dir.path().join("20200101T000000Z-aaaaaa")).unwrap();
        std::fs::create_dir(dir.path().join("notes")).unwrap();
        let runs = list(dir.path()).unwrap();
        assert_eq!(runs.len(), 2);
        assert!(runs[0].folder.is_err());
        assert_eq!(runs[1].id, run.start().id);
    }
}
