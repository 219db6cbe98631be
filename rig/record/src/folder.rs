//! A run's folder: `start.json` is written first and `stop.json` last, each in one step.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::RecordError;
use super::files::{create_folder, is_part, json, read_json, sync_folder, write_json, write_whole};
use super::journal::Journal;
use super::order;
use super::run_id::RunId;
use super::start_stop::{Start, Stop};
use super::sums::{Sum, Sums};
use ground::clock::MonotonicNs;
use ground::error_chain::with_causes;

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
    /// Where the fit began; there where a fit of the first part was done before the rest was filmed.
    pub const WARM_START: &str = "warm-start.json";
    /// Result of the fit.
    pub const FIT: &str = "fit.json";
    /// Result of the diagnosis: what the simulation gets wrong, and why.
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
    /// Record of the recording's deletion.
    pub const RETENTION: &str = "retention.json";
    /// Checksums of all of these.
    pub const SUMS: &str = "SHA256SUMS";
}

/// A run's folder, being written or read.
#[derive(Debug, Clone)]
pub struct RunFolder {
    path: PathBuf,
    start: Start,
    stop: Option<Stop>,
    unreadable_stop: Option<String>,
}

impl RunFolder {
    /// Creates the folder `runs_dir/<start.id>` with its `start.json`, in one step: under another name first, so that there is no
    /// run folder without it. The run gets its number, see [`super::order`].
    ///
    /// # Errors
    /// [`RecordError`] when the folder exists or cannot be written.
    pub fn create(runs_dir: &Path, start: Start) -> Result<Self, RecordError> {
        create_folder(runs_dir)?;
        let start = Start { number: order::next(runs_dir)?, ..start };
        let path = runs_dir.join(start.id.as_str());
        let new = runs_dir.join(format!("{NEW_FOLDER_PREFIX}{}", start.id));
        std::fs::create_dir(&new).map_err(RecordError::io("creating run folder", &new))?;
        write_json(&new.join(file::START), &start)?;
        // a folder with something in it is not replaced
        std::fs::rename(&new, &path).map_err(RecordError::io("creating run folder", &path))?;
        sync_folder(runs_dir)?;
        Ok(Self { path, start, stop: None, unreadable_stop: None })
    }

    /// Opens a run folder for reading. One without a `stop.json` that can be read is incomplete and opens all the same.
    ///
    /// # Errors
    /// [`RecordError`] when it is a file, when there is no readable `start.json`, or a `stop.json` that cannot be read.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        if path.is_file() {
            return Err(RecordError::NoFolder { path: path.into() });
        }
        let start = read_json(&path.join(file::START))?;
        let stop = path.join(file::STOP);
        let (stop, unreadable_stop) = match stop.exists().then(|| read_json(&stop)) {
            Some(Ok(stop)) => (Some(stop), None),
            Some(Err(error)) => (None, Some(with_causes(&error))),
            None => (None, None),
        };
        Ok(Self { path: path.into(), start, stop, unreadable_stop })
    }

    /// Its path.
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

    /// How it ended; none while it runs, when it was cut short, and where that cannot be read.
    pub fn stop(&self) -> Option<&Stop> {
        self.stop.as_ref()
    }

    /// Why its `stop.json`, which is there, cannot be read.
    pub fn unreadable_stop(&self) -> Option<&str> {
        self.unreadable_stop.as_deref()
    }

    /// Why it is incomplete, in a sentence without its full stop.
    pub fn incomplete(&self) -> Option<String> {
        match (&self.stop, &self.unreadable_stop) {
            (Some(_), _) => None,
            (None, Some(error)) => Some(format!("its {} cannot be read ({error})", file::STOP)),
            (None, None) => Some(format!("it was cut short: it has no {}", file::STOP)),
        }
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
        self.end(stop, recording.into_iter().map(|sum| (file::RECORDING.to_owned(), sum)).collect())
    }

    /// As [`Self::finish`], for a run that was recovered, whose files of these names were `made` for it: all others keep the checksums
    /// that they have.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn finish_again(&mut self, stop: Stop, made: &[&str]) -> Result<(), RecordError> {
        // checksums that cannot be read say nothing
        let mut known = Sums::read(&self.path).ok().flatten().unwrap_or_default().0;
        known.retain(|name, _| !made.contains(&name.as_str()));
        self.end(stop, known)
    }

    fn end(&mut self, stop: Stop, mut known: BTreeMap<String, Sum>) -> Result<(), RecordError> {
        let path = self.file(file::STOP);
        let json = json(&path, &stop)?;
        known.insert(file::STOP.into(), Sum::of(&json));
        Sums::of_folder(&self.path, Sums(known))?.write(&self.path)?;
        write_whole(&path, &json)?;
        (self.stop, self.unreadable_stop) = (Some(stop), None);
        Ok(())
    }
}

/// Prefix of the names of run folders that are being made; the run's id follows it.
const NEW_FOLDER_PREFIX: &str = ".new-";

/// Removes what is left of run folders whose making was cut short: nothing was recorded in them.
///
/// # Errors
/// [`RecordError::Io`] when `runs_dir` cannot be read.
pub fn remove_unmade(runs_dir: &Path) -> Result<(), RecordError> {
    let io = || RecordError::io("reading runs folder", runs_dir);
    for entry in std::fs::read_dir(runs_dir).map_err(io())? {
        let entry = entry.map_err(io())?;
        let name = entry.file_name().into_string().unwrap_or_default();
        if name.strip_prefix(NEW_FOLDER_PREFIX).is_some_and(|id| RunId::try_from(id.to_owned()).is_ok()) {
            for begun in std::fs::read_dir(entry.path()).into_iter().flatten().flatten() {
                if begun.file_name().to_str().is_some_and(|name| name == file::START || is_part(name)) {
                    // what cannot be removed harms nobody
                    let _ = std::fs::remove_file(begun.path());
                }
            }
            let _ = std::fs::remove_dir(entry.path());
        }
    }
    Ok(())
}

/// One run of a runs folder.
#[derive(Debug)]
pub struct Listed {
    /// Its name.
    pub id: RunId,
    /// The run, or why it cannot be opened.
    pub folder: Result<RunFolder, RecordError>,
}

/// The run folders in `runs_dir`, oldest first as [`super::order`] has it; those that cannot be opened come before all others.
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
    runs.sort_by_cached_key(|run| {
        (run.folder.as_ref().map_or(0, |folder| folder.start().number), run.id.clone())
    });
    Ok(runs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;
    use crate::start_stop::Status;

    fn start() -> Start {
        Start {
            config: "[camera]\nfps = 100.0\n".into(),
            details: BTreeMap::from([("water".into(), serde_json::json!({"temperature_c": 22.0}))]),
            ..fixtures::start("20261120T101503Z-ab12cd")
        }
    }

    #[test]
    fn run_without_stop_is_incomplete_and_opens() {
        let dir = tempfile::tempdir().unwrap();
        let start = start();
        let mut run = RunFolder::create(dir.path(), start.clone()).unwrap();
        let read = RunFolder::open(run.path()).unwrap();
        assert_eq!(read.start(), &Start { number: 1, ..start });
        assert!(read.stop().is_none());

        let stop = Stop {
            status: Status::Fail,
            reason: Some("camera gone".into()),
            images: 12,
            images_lost: 1,
            images_damaged: 2,
            images_repeated: 3,
            images_stale: 4,
            ..fixtures::stop()
        };
        run.finish(stop.clone(), None).unwrap();
        assert_eq!(RunFolder::open(run.path()).unwrap().stop(), Some(&stop));
        let names: Vec<_> = std::fs::read_dir(run.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        assert!(names.iter().all(|name| !is_part(name)), "{names:?}");
    }

    #[test]
    fn second_run_of_the_same_name_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let start = start();
        RunFolder::create(dir.path(), start.clone()).unwrap();
        assert!(matches!(RunFolder::create(dir.path(), start), Err(RecordError::Io { .. })));
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
