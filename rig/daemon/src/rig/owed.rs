//! What has happened and is to be written: to the journal, to the database. Where the disk is full or the database locked it is kept, in its
//! order, and written when it can be; nothing is decided anew for it.

use serde_json::{Value, json};

use super::Rig;
use app::Failure;
use store::job::{JobId, NewJob};

/// One thing to be written.
#[derive(Debug)]
pub(super) enum Owed {
    /// An entry of the journal: its event and details.
    Line(&'static str, Value),
    /// An alert, and its entry in the journal.
    Alert { kind: &'static str, text: String, job: Option<JobId> },
    /// A job that follows from another.
    Job(Box<NewJob>),
}

impl Owed {
    pub(super) fn alert(kind: &'static str, text: String, job: Option<JobId>) -> Self {
        Self::Alert { kind, text, job }
    }
}

impl Rig {
    /// Writes what is owed, the oldest first.
    ///
    /// # Errors
    /// Where something cannot be written: it and all after it are owed still.
    pub(super) fn pay(&mut self) -> Result<(), Failure> {
        while let Some(owed) = self.owed.front() {
            let then = match owed {
                Owed::Line(event, details) => {
                    self.write(event, details.clone())?;
                    None
                }
                Owed::Alert { kind, text, job } => {
                    self.alerts.raise(&mut self.store, kind, text, *job).map_err(Failure::internal)?;
                    Some(Owed::Line("alert", json!({ "kind": kind, "text": text, "job": job })))
                }
                Owed::Job(job) => {
                    self.store.add_unlimited(job).map_err(Failure::internal)?;
                    None
                }
            };
            self.owed.pop_front();
            if let Some(then) = then {
                self.owed.push_front(then);
            }
        }
        Ok(())
    }
}
