//! A store for tests of what a queue is used for.

use std::path::Path;

use rusqlite::Connection;

use crate::{FILE, Store, StoreError};

/// One that waits for no disk and no other process.
///
/// # Errors
/// As [`Store::open`].
pub fn open_at_once(runs_dir: &Path) -> Result<Store, StoreError> {
    let path = runs_dir.join(FILE);
    let db = Connection::open(&path).map_err(StoreError::at("opening", &path))?;
    let store = Store::with(db, runs_dir, path)?;
    store.db.pragma_update(None, "synchronous", "OFF").map_err(store.failed("opening"))?;
    store.disable_lock_wait()?;
    Ok(store)
}

/// Empties it.
///
/// # Panics
/// Where that is refused.
pub fn forget_all(store: &Store) {
    batch(store, "DELETE FROM deliveries; DELETE FROM alerts; DELETE FROM jobs");
}

/// Holds the database against all other writers, or lets go of it.
///
/// # Panics
/// Where that is refused.
pub fn hold(store: &Store, hold: bool) {
    batch(store, if hold { "BEGIN IMMEDIATE" } else { "COMMIT" });
}

fn batch(store: &Store, what: &str) {
    store.db.execute_batch(what).unwrap_or_else(|error| panic!("{error}"));
}
