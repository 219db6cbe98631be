//! Outcomes of a long series of cases, a line each as they come, so that a series goes on where it stopped.

use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use serde::Serialize;
use serde::de::DeserializeOwned;

/// A file of outcomes that several threads add to.
#[derive(Debug)]
pub struct Journal<T>(Mutex<(File, Vec<T>)>);

impl<T: Serialize + DeserializeOwned> Journal<T> {
    /// Goes on with the file at `path`; also what it holds.
    ///
    /// # Errors
    /// Where it can be neither read nor made.
    pub fn open(path: &Path) -> std::io::Result<(Self, Vec<T>)> {
        let before = if path.exists() { std::fs::read_to_string(path)? } else { String::new() };
        // A line that was cut off by an interruption is a case to do again.
        let done = before.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        let file = OpenOptions::new().create(true).append(true).open(path)?;
        Ok((Self(Mutex::new((file, Vec::new()))), done))
    }

    /// Adds `outcome`.
    ///
    /// # Panics
    /// Where it cannot be written.
    pub fn add(&self, outcome: T) {
        let line = serde_json::to_string(&outcome).expect("an outcome is JSON");
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        writeln!(held.0, "{line}").expect("the journal can be written");
        held.1.push(outcome);
    }

    /// All that was added since it was opened.
    pub fn added(self) -> Vec<T> {
        self.0.into_inner().unwrap_or_else(PoisonError::into_inner).1
    }
}
