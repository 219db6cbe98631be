//! What a rig has to do and what it has done, in one database beside its run folders: the queue of [`job`]s, [`alerts`], and an index
//! of [`runs`] and their [`models`] that is made from their folders and can be made again.
//!
//! SQLite with a write-ahead log: each change is a transaction that is on the disk when its call returns, several processes may
//! look and add at the same time, and one that is killed leaves the last whole transaction behind
//! (<https://www.sqlite.org/wal.html>).

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

pub mod alerts;
#[doc(hidden)]
pub mod fixtures;
pub mod goal;
pub mod job;
mod limits;
pub mod models;
mod queue;
pub mod runs;

use std::path::{Path, PathBuf};
use std::time::Duration;

pub use limits::Limit;
use rusqlite::{Connection, ErrorCode, OpenFlags, Row, Transaction, TransactionBehavior};

use ground::error_chain::with_causes;

/// The database in a runs folder.
pub const FILE: &str = "rig.sqlite";
/// The layout that this version knows; kept as the database's `user_version`.
const LAYOUT: i64 = 3;
/// Time to wait for another process that has locked the database. Chosen.
const LOCK_TIMEOUT: Duration = Duration::from_secs(10);

const TABLES: &str = "
    CREATE TABLE jobs (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        lane TEXT NOT NULL,
        work TEXT NOT NULL,
        priority INTEGER NOT NULL,
        state TEXT NOT NULL,
        cancel TEXT,
        why TEXT,
        retry_of INTEGER REFERENCES jobs (id),
        not_before TEXT,
        added TEXT NOT NULL,
        began TEXT,
        ended TEXT,
        pid INTEGER,
        status TEXT,
        run TEXT,
        out TEXT,
        verdict TEXT,
        error TEXT
    );
    CREATE INDEX jobs_by_state ON jobs (state, lane, priority);
    CREATE TABLE runs (
        id TEXT PRIMARY KEY,
        modified_ns INTEGER NOT NULL,
        summary TEXT NOT NULL
    ) WITHOUT ROWID;
";

/// Coefficients with units and bounds; those of runs that an earlier layout knew are read again.
const COEFFICIENTS: &str = "
    DROP TABLE IF EXISTS coefficients;
    CREATE TABLE coefficients (
        run TEXT NOT NULL REFERENCES runs (id) ON DELETE CASCADE,
        name TEXT NOT NULL,
        unit TEXT NOT NULL,
        value REAL NOT NULL,
        std REAL,
        determined INTEGER NOT NULL,
        lower REAL NOT NULL,
        upper REAL NOT NULL,
        PRIMARY KEY (name, run)
    ) WITHOUT ROWID;
    CREATE INDEX coefficients_by_run ON coefficients (run);
    UPDATE runs SET modified_ns = -1;
";

/// Why the database cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// SQLite refused.
    #[error("{action} {}", path.display())]
    Database {
        /// What was tried.
        action: &'static str,
        /// The database.
        path: PathBuf,
        /// What SQLite said.
        source: rusqlite::Error,
    },
    /// A newer version of this program has changed the database.
    #[error(
        "{} has layout {found}, this version knows up to {LAYOUT}; use the rig that wrote it, or move the file away: `rig runs index` \
         makes the index again, jobs that wait would be lost",
        path.display()
    )]
    Newer {
        /// The database.
        path: PathBuf,
        /// Its layout.
        found: i64,
    },
    /// A row does not hold what it should.
    #[error("{}: {what}", path.display())]
    Damaged {
        /// The database.
        path: PathBuf,
        /// Which row, and what is wrong.
        what: String,
    },
    /// The runs cannot be looked at.
    #[error(transparent)]
    Runs(#[from] record::RecordError),
    /// There is no such job.
    #[error("there is no job {0}; `rig jobs ls` lists them")]
    NoJob(job::JobId),
    /// Too much is asked for.
    #[error(transparent)]
    Limit(#[from] limits::Limit),
    /// The job is over.
    #[error("job {id} is {state} already")]
    Over {
        /// Which.
        id: job::JobId,
        /// How it ended.
        state: job::State,
    },
    /// The job moved the rig, and did what it was to do.
    #[error("job {0} is done: to move the rig again add a job of its own")]
    Done(job::JobId),
    /// Another job was asked for under the same key.
    #[error(
        "job {0} was added with the same key and does something else; give each request a key of its own"
    )]
    SameKey(job::JobId),
    /// The job is not over yet.
    #[error("job {id} is {state}; cancel it first")]
    NotOver {
        /// Which.
        id: job::JobId,
        /// What it does.
        state: job::State,
    },
}

impl StoreError {
    /// Whether the request is at fault, not the database.
    pub fn is_input(&self) -> bool {
        matches!(
            self,
            Self::NoJob(_)
                | Self::Limit(_)
                | Self::Over { .. }
                | Self::NotOver { .. }
                | Self::Newer { .. }
                | Self::Done(_)
                | Self::SameKey(_)
        )
    }
}

/// The database of one runs folder.
#[derive(Debug)]
pub struct Store {
    db: Connection,
    runs_dir: PathBuf,
    path: PathBuf,
    /// Whether the index could not be written and a copy in memory is used: see [`runs`].
    is_in_memory: bool,
}

impl Store {
    /// Opens the database of the runs folder `runs_dir`; makes both where they are missing. One that is damaged is put aside, and
    /// a new one begun: the runs are in their folders.
    ///
    /// # Errors
    /// [`StoreError::Database`] where it cannot be made, read or written, [`StoreError::Newer`].
    pub fn open(runs_dir: &Path) -> Result<Self, StoreError> {
        record::files::create_folder(runs_dir)?;
        let path = runs_dir.join(FILE);
        match Self::open_file(runs_dir, &path) {
            Err(StoreError::Database { source, .. }) if is_damaged(&source) => {
                let aside =
                    put_aside(&path).map_err(record::RecordError::io("putting aside the damaged", &path))?;
                tracing::error!(
                    "{} cannot be read ({source}): kept as {}; the index is made again, jobs that waited in it are lost",
                    path.display(),
                    aside.display()
                );
                Self::open_file(runs_dir, &path)
            }
            other => other,
        }
    }

    fn open_file(runs_dir: &Path, path: &Path) -> Result<Self, StoreError> {
        let db = Connection::open(path).map_err(StoreError::at("opening", path))?;
        let store = Self::with(db, runs_dir, path.into())?;
        let check = store.db.pragma_query_value(None, "quick_check", |row| row.get::<_, String>(0));
        match check.map_err(store.failed("checking"))?.as_str() {
            "ok" => Ok(store),
            found => Err(StoreError::Database {
                action: "checking",
                path: path.into(),
                source: rusqlite::Error::SqliteFailure(
                    rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_CORRUPT),
                    Some(found.into()),
                ),
            }),
        }
    }

    /// The same where it can be made; else one in memory, which is gone when it is dropped: a folder of runs on a medium that
    /// cannot be written, or is full, is still looked at.
    ///
    /// # Errors
    /// As [`Store::open`], but for what is for now only: a lock, a full disk.
    pub fn open_or_memory(runs_dir: &Path) -> Result<Self, StoreError> {
        match Self::open(runs_dir) {
            Err(error) if error.is_temporary() => {
                tracing::warn!("{}: the runs are read from their folders", with_causes(&error));
                let path = PathBuf::from("an index in memory");
                let failed = |source| StoreError::Database { action: "making", path: path.clone(), source };
                let db = Connection::open_in_memory_with_flags(OpenFlags::default()).map_err(failed)?;
                Self::with(db, runs_dir, path.clone())
            }
            other => other,
        }
    }

    fn with(mut db: Connection, runs_dir: &Path, path: PathBuf) -> Result<Self, StoreError> {
        let layout =
            |db: &Connection| db.pragma_query_value(None, "user_version", |row| row.get::<_, i64>(0));
        let mut set_up = || -> rusqlite::Result<i64> {
            db.busy_timeout(LOCK_TIMEOUT)?;
            db.pragma_update(None, "journal_mode", "WAL")?;
            // a transaction that was answered is there after a power cut too
            db.pragma_update(None, "synchronous", "FULL")?;
            db.pragma_update(None, "foreign_keys", true)?;
            // what is only known to this process needs no disk
            db.pragma_update(None, "temp_store", "MEMORY")?;
            // reading needs no lock: an existing database is only read here
            let found = layout(&db)?;
            if found >= LAYOUT {
                return Ok(found);
            }
            let change = db.transaction_with_behavior(TransactionBehavior::Immediate)?;
            let found = layout(&change)?;
            if found < 1 {
                change.execute_batch(TABLES)?;
            }
            if found < 2 {
                change.execute_batch(alerts::TABLES)?;
            }
            if found < LAYOUT {
                change.execute_batch(queue::SLOTS_AND_KEYS)?;
                change.execute_batch(COEFFICIENTS)?;
                change.pragma_update(None, "user_version", LAYOUT)?;
            }
            change.commit()?;
            Ok(found)
        };
        match set_up() {
            Ok(found) if found > LAYOUT => Err(StoreError::Newer { path, found }),
            Ok(_) => Ok(Self { db, runs_dir: runs_dir.into(), path, is_in_memory: false }),
            Err(source) => Err(StoreError::Database { action: "opening", path, source }),
        }
    }

    /// From now on a locked database is not waited for: a call fails at once, and may be repeated.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn disable_lock_wait(&self) -> Result<(), StoreError> {
        self.db.busy_timeout(Duration::ZERO).map_err(self.failed("opening"))
    }

    /// The folder whose runs and jobs these are.
    pub fn runs_dir(&self) -> &Path {
        &self.runs_dir
    }

    /// A number that changes when another process has changed the database.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn version(&self) -> Result<i64, StoreError> {
        self.db.pragma_query_value(None, "data_version", |row| row.get(0)).map_err(self.failed("reading"))
    }

    /// One change: all of it, or nothing.
    fn change<T>(
        &mut self,
        action: &'static str,
        work: impl FnOnce(&Transaction<'_>) -> rusqlite::Result<T>,
    ) -> Result<T, StoreError> {
        let failed = StoreError::at(action, &self.path);
        let whole = || {
            let change = self.db.transaction_with_behavior(TransactionBehavior::Immediate)?;
            let value = work(&change)?;
            change.commit()?;
            Ok(value)
        };
        whole().map_err(failed)
    }

    /// As [`Self::change`], but without waiting for another process that is changing the database.
    fn change_without_waiting<T>(
        &mut self,
        action: &'static str,
        work: impl FnOnce(&Transaction<'_>) -> rusqlite::Result<T>,
    ) -> Result<T, StoreError> {
        self.db.busy_timeout(Duration::ZERO).map_err(self.failed(action))?;
        let changed = self.change(action, work);
        self.db.busy_timeout(LOCK_TIMEOUT).map_err(self.failed(action))?;
        changed
    }

    /// All rows that `query` finds.
    fn rows<T>(
        &self,
        query: &str,
        params: impl rusqlite::Params,
        read: impl FnMut(&Row<'_>) -> rusqlite::Result<T>,
    ) -> Result<Vec<T>, StoreError> {
        let all =
            || -> rusqlite::Result<Vec<T>> { self.db.prepare(query)?.query_map(params, read)?.collect() };
        all().map_err(self.failed("reading"))
    }

    /// The only row that `query` finds.
    fn row<T>(
        &self,
        query: &str,
        params: impl rusqlite::Params,
        read: impl FnOnce(&Row<'_>) -> rusqlite::Result<T>,
    ) -> Result<T, StoreError> {
        self.db.query_row(query, params, read).map_err(self.failed("reading"))
    }

    fn failed(&self, action: &'static str) -> impl FnOnce(rusqlite::Error) -> StoreError + use<> {
        StoreError::at(action, &self.path)
    }
}

impl StoreError {
    /// Whether the database cannot be written for now: it is locked, its disk is full or fails, or writing is not permitted.
    fn is_temporary(&self) -> bool {
        use ErrorCode::{
            CannotOpen, DatabaseBusy, DatabaseLocked, DiskFull, PermissionDenied, ReadOnly, SystemIoFailure,
        };
        let Self::Database { source, .. } = self else { return false };
        matches!(
            source.sqlite_error_code(),
            Some(
                CannotOpen
                    | DatabaseBusy
                    | DatabaseLocked
                    | DiskFull
                    | PermissionDenied
                    | ReadOnly
                    | SystemIoFailure
            )
        )
    }

    fn at(action: &'static str, path: &Path) -> impl FnOnce(rusqlite::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| Self::Database { action, path, source }
    }
}

fn is_damaged(error: &rusqlite::Error) -> bool {
    matches!(error.sqlite_error_code(), Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase))
}

/// Renames a database and what belongs to it; gives its new name.
fn put_aside(path: &Path) -> std::io::Result<PathBuf> {
    let named = |ending: &str| {
        let mut name = path.as_os_str().to_owned();
        name.push(ending);
        PathBuf::from(name)
    };
    let stamp = jiff::Timestamp::now().strftime("-damaged-%Y%m%dT%H%M%S%6fZ").to_string();
    for ending in ["", "-wal", "-shm"] {
        match std::fs::rename(named(ending), named(&format!("{stamp}{ending}"))) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(named(&stamp))
}

/// Now, as the database stores times: UTC with microseconds, so that their texts sort by time.
fn now() -> String {
    text(jiff::Timestamp::now())
}

/// See [`now`].
fn text(time: jiff::Timestamp) -> String {
    time.strftime("%Y-%m-%dT%H:%M:%S.%6fZ").to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damaged_database_is_put_aside_and_a_new_one_begun() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE);
        for (damage, text) in [
            ("garbage", b"no database at all, but long enough to be looked at".to_vec()),
            ("a torn page", {
                drop(Store::open(folder.path()).unwrap());
                let mut bytes = std::fs::read(&path).unwrap();
                bytes[4096..].fill(0xA5);
                bytes
            }),
        ] {
            std::fs::write(&path, &text).unwrap();
            let store = Store::open(folder.path()).unwrap_or_else(|error| panic!("{damage}: {error}"));
            assert_eq!(store.jobs(9).unwrap(), [], "{damage}");
            drop(store);
            let aside = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
            let aside = aside.filter(|path| path.to_string_lossy().contains("-damaged-"));
            assert!(aside.into_iter().any(|path| std::fs::read(path).unwrap() == text), "{damage} is kept");
        }
    }

    #[test]
    fn folder_that_cannot_be_written_is_looked_at_all_the_same() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let closed = folder.path().join("runs");
        std::fs::create_dir(&closed).unwrap();
        std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o555)).unwrap();
        let mut store = Store::open_or_memory(&closed).unwrap();
        assert_eq!(store.refresh(false).unwrap().runs, 0);
    }
}
