//! The hold: every stop leaves one, and nothing of the rig may move until a person releases it by name.
//!
//! A hold is stored in files. The program that stops a rig writes them by itself; a program that could move it reads them before it
//! gives a servo power, before each order and fifty times a second while anything has power (`servo::held`). Two files can hold a rig,
//! and either is enough: `hold.json` in its runs folder, which exists from the first run on so that a full disk cannot refuse a stop,
//! and a file next to the lock of its servo's port, which `rig estop` finds without knowing the runs. A file that cannot be read
//! holds too.

use std::path::{Path, PathBuf};

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::claim::port_file;
use crate::in_place;

/// Name of the hold file in the runs folder.
pub const HOLD_FILE: &str = "hold.json";
/// Names and reasons are cut to this many characters, chosen: they fit into the file's fixed size then.
const MAX_TEXT_CHARACTERS: usize = 200;

/// Why a rig is held.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Hold {
    /// When it was stopped, UTC.
    pub since: String,
    /// Who or what stopped it.
    pub by: String,
    /// Why.
    pub why: String,
}

impl Hold {
    /// A hold that begins now.
    pub fn now(by: &str, why: &str) -> Self {
        let cut = |text: &str| text.trim().chars().take(MAX_TEXT_CHARACTERS).collect::<String>();
        Self { since: now(), by: cut(by), why: cut(why) }
    }
}

impl std::fmt::Display for Hold {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "held since {} by {}: {}", self.since, self.by, self.why)
    }
}

fn now() -> String {
    Timestamp::now().strftime("%Y-%m-%dT%H:%M:%SZ").to_string()
}

/// The content of a hold file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Page {
    hold: Option<Hold>,
    /// Who released it last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    released: Option<Released>,
}

/// A release.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Released {
    at: String,
    by: String,
}

/// A hold could not be written.
#[derive(Debug, thiserror::Error)]
#[error("writing {}", path.display())]
pub struct HoldError {
    /// The file.
    path: PathBuf,
    /// What the system said.
    source: std::io::Error,
}

/// The files through which a rig can be held. Reading them takes some microseconds and never waits.
#[derive(Debug, Clone, Default)]
pub struct Latch {
    runs: Option<PathBuf>,
    port: Option<String>,
}

impl Latch {
    /// The latch of the rig whose runs are in `runs_dir` and whose servo is on the port `port`, where it has these.
    pub fn of(runs_dir: Option<&Path>, port: Option<&str>) -> Self {
        Self { runs: runs_dir.map(|folder| folder.join(HOLD_FILE)), port: port.map(str::to_owned) }
    }

    /// Creates the hold file in the runs folder, which must exist.
    ///
    /// # Errors
    /// [`HoldError`].
    pub fn make_room(&self) -> Result<(), HoldError> {
        let Some(path) = &self.runs else { return Ok(()) };
        in_place::make(path, &Page { hold: None, released: None }, 0o664).map_err(at(path))
    }

    /// A port's file by the name that the port has now: a board that was plugged in again may have another one.
    fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.runs.clone().into_iter().chain(self.port.as_deref().map(|port| port_file(port, "hold")))
    }

    /// The hold, where the rig is held.
    pub fn held(&self) -> Option<Hold> {
        self.files().find_map(|path| match in_place::read::<Page>(&path) {
            Ok(page) => page?.hold,
            Err(error) => {
                Some(Hold::now("a file that cannot be read", &format!("{}: {error}", path.display())))
            }
        })
    }

    /// Holds the rig, at each of its places that is not held yet.
    ///
    /// # Errors
    /// [`HoldError`] of a file that could not be written; the others are written all the same.
    pub fn hold(&self, hold: &Hold) -> Result<(), HoldError> {
        let page = Page { hold: Some(hold.clone()), released: None };
        let mut failed = None;
        for path in self.files() {
            if matches!(in_place::read::<Page>(&path), Ok(Some(Page { hold: Some(_), .. }))) {
                continue;
            }
            // every user may release the file of a port: a release lets nobody open the port who may not
            let mode = if self.runs.as_ref() == Some(&path) { 0o664 } else { 0o666 };
            let written = in_place::write(&path, &page).or_else(|error| match error.kind() {
                std::io::ErrorKind::NotFound => {
                    in_place::make(&path, &page, mode).and_then(|()| in_place::write(&path, &page))
                }
                _ => Err(error),
            });
            if let Err(error) = written.and_then(|file| file.sync_data()).map_err(at(&path)) {
                failed.get_or_insert(error);
            }
        }
        failed.map_or(Ok(()), Err)
    }

    /// Ends the hold, in the name of `by`; returns the hold that it ended.
    ///
    /// # Errors
    /// [`HoldError`]: the rig is still held.
    pub fn release(&self, by: &str) -> Result<Option<Hold>, HoldError> {
        let held = self.held();
        let released = Some(Released { at: now(), by: Hold::now(by, "").by });
        for path in self.files() {
            match in_place::write(&path, &Page { hold: None, released: released.clone() }) {
                Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(at(&path)(error)),
                Err(_) => {}
                Ok(file) => file.sync_data().map_err(at(&path))?,
            }
        }
        Ok(held)
    }

    /// When it was released last, UTC, and by whom, where that is known.
    pub fn released(&self) -> Option<(String, String)> {
        let page: Page = self.files().find_map(|path| in_place::read(&path).ok().flatten())?;
        page.released.map(|released| (released.at, released.by))
    }
}

fn at(path: &Path) -> impl FnOnce(std::io::Error) -> HoldError + use<'_> {
    |source| HoldError { path: path.into(), source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hold_is_seen_by_others_stays_as_it_was_first_and_ends_by_a_name() {
        let folder = tempfile::tempdir().unwrap();
        let (mine, theirs) = (Latch::of(Some(folder.path()), None), Latch::of(Some(folder.path()), None));
        mine.make_room().unwrap();
        assert_eq!(theirs.held(), None);
        mine.hold(&Hold::now("the page", "a hand is in the tank")).unwrap();
        theirs.hold(&Hold::now("somebody else", "later")).unwrap();
        let held = theirs.held().unwrap();
        assert_eq!((held.by.as_str(), held.why.as_str()), ("the page", "a hand is in the tank"));
        assert_eq!(theirs.release("Ada").unwrap(), Some(held));
        assert_eq!((mine.held(), mine.released().unwrap().1.as_str()), (None, "Ada"));
        assert_eq!(mine.release("Ada").unwrap(), None);
    }

    #[test]
    fn hold_of_a_board_that_was_plugged_in_again_ends_where_the_board_is_now() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for board in ["first", "second"] {
            std::fs::write(at(board), "").unwrap();
        }
        std::os::unix::fs::symlink(at("first"), at("port")).unwrap();
        let port = at("port");
        let daemon = Latch::of(Some(folder.path()), port.to_str());
        daemon.hold(&Hold::now("the page", "a hand is in the tank")).unwrap();
        std::fs::remove_file(&port).unwrap();
        std::os::unix::fs::symlink(at("second"), &port).unwrap();
        assert!(Latch::of(Some(folder.path()), port.to_str()).release("Ada").unwrap().is_some());
        assert_eq!(daemon.held(), None);
        let _ = std::fs::remove_file(port_file(at("first").to_str().unwrap(), "hold"));
    }

    #[test]
    fn what_cannot_be_read_holds_and_what_is_not_there_does_not() {
        let folder = tempfile::tempdir().unwrap();
        let latch = Latch::of(Some(folder.path()), None);
        assert_eq!(latch.held(), None);
        std::fs::write(folder.path().join(HOLD_FILE), "{\"hold\":{\"since\":").unwrap();
        assert!(latch.held().unwrap().why.contains(HOLD_FILE));
        latch.release("Ada").unwrap();
        assert_eq!(latch.held(), None);
        assert_eq!(Latch::default().held(), None);
    }

    #[test]
    fn any_name_and_reason_finds_room() {
        let folder = tempfile::tempdir().unwrap();
        let latch = Latch::of(Some(folder.path()), None);
        let long = "\u{1}é".repeat(5000);
        latch.hold(&Hold::now(&long, &long)).unwrap();
        assert_eq!(latch.held().unwrap().why.chars().count(), MAX_TEXT_CHARACTERS);
    }
}
