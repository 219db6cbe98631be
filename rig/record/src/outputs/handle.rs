//! What [`Outputs`](super::Outputs) hands out.

use std::path::{Path, PathBuf};

use serde::Serialize;
use wildmatch::WildMatch;

use crate::RecordError;
use crate::files::{Part, containing, create_folder, json, write_whole};
use crate::folder::RunFolder;

/// A file that a command may write. It is there whole or as it was before.
#[derive(Debug, Clone)]
pub struct OutputFile {
    path: PathBuf,
    place: PathBuf,
}

impl OutputFile {
    pub(super) fn new(path: &Path, place: PathBuf) -> Self {
        Self { path: path.into(), place }
    }

    /// Where it will be, as it was given.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where it will be, without links and dots.
    pub fn place(&self) -> &Path {
        &self.place
    }

    /// Writes it.
    ///
    /// # Errors
    /// [`RecordError::Io`]; what was there before still is.
    pub fn write(&self, bytes: &[u8]) -> Result<(), RecordError> {
        create_folder(containing(&self.place))?;
        write_whole(&self.place, bytes)
    }

    /// Begins to write it, for what is written piece by piece or by another program.
    ///
    /// # Errors
    /// [`RecordError::Io`].
    pub fn begin(&self) -> Result<Part, RecordError> {
        create_folder(containing(&self.place))?;
        Part::begin(&self.place)
    }

    /// Removes what an earlier command has left there: this one has nothing to write.
    pub fn remove(&self) {
        // what is not there needs no removing
        let _ = std::fs::remove_file(&self.place);
    }
}

/// A folder in which a command may write files of certain names.
#[derive(Debug, Clone)]
pub struct OutputFolder {
    path: PathBuf,
    place: PathBuf,
    names: Vec<WildMatch>,
}

impl OutputFolder {
    pub(super) fn new(path: &Path, place: PathBuf, names: Vec<WildMatch>) -> Self {
        Self { path: path.into(), place, names }
    }

    /// The folder of `run` itself, for its own results.
    pub fn of_run(run: &RunFolder) -> Self {
        Self::new(run.path(), run.path().into(), vec![WildMatch::new("*")])
    }

    /// Where it is, as it was given.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Makes it, where it is not there.
    ///
    /// # Errors
    /// [`RecordError::Io`].
    pub fn create(&self) -> Result<(), RecordError> {
        create_folder(&self.place)
    }

    /// The file `name` in it.
    pub fn file(&self, name: &str) -> OutputFile {
        self.assert_asked_for(name);
        OutputFile { path: self.path.join(name), place: self.place.join(name) }
    }

    /// The folder `name` in it, for files of all names.
    pub fn folder(&self, name: &str) -> Self {
        self.assert_asked_for(name);
        Self { path: self.path.join(name), place: self.place.join(name), names: vec![WildMatch::new("*")] }
    }

    /// Writes the file `name` in it.
    ///
    /// # Errors
    /// [`RecordError::Io`]; what was there before still is.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), RecordError> {
        self.file(name).write(bytes)
    }

    /// Writes `value` as JSON to the file `name` in it.
    ///
    /// # Errors
    /// [`RecordError`]; what was there before still is.
    pub fn write_json(&self, name: &str, value: &impl Serialize) -> Result<(), RecordError> {
        let file = self.file(name);
        file.write(&json(file.path(), value)?)
    }

    fn assert_asked_for(&self, name: &str) {
        let names = &self.names;
        assert!(
            names.iter().any(|one| one.matches(name)),
            "{name} was not asked for, of {}",
            self.path.display()
        );
    }
}
