//! Alerts: events that a person should know of, and their delivery to the places of `[alerts]`.

use rusqlite::{OptionalExtension, params};
use serde::Serialize;
use utoipa::ToSchema;

use super::job::JobId;
use super::{Store, StoreError, now, text};

pub(super) const TABLES: &str = "
    CREATE TABLE alerts (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        raised TEXT NOT NULL,
        kind TEXT NOT NULL,
        text TEXT NOT NULL,
        job INTEGER REFERENCES jobs (id)
    );
    CREATE TABLE deliveries (
        alert INTEGER NOT NULL REFERENCES alerts (id),
        place TEXT NOT NULL,
        tries INTEGER NOT NULL DEFAULT 0,
        next TEXT,
        told TEXT,
        trouble TEXT,
        PRIMARY KEY (alert, place)
    ) WITHOUT ROWID;
    CREATE INDEX deliveries_by_time ON deliveries (next) WHERE next IS NOT NULL;
";

/// An event that a person should know of.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Alert {
    /// Its number.
    pub id: i64,
    /// When it was raised, UTC.
    pub raised: String,
    /// `job-failed`, `images-lost`, `recalibration-kept`, `drift`, `campaign-ended`.
    pub kind: String,
    /// What happened.
    pub text: String,
    /// The job it happened in.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub job: Option<i64>,
}

/// An alert that is still to be delivered to a place.
#[derive(Debug, Clone, PartialEq)]
pub struct Delivery {
    /// The alert.
    pub alert: Alert,
    /// The place: a key of `[alerts]`.
    pub place: String,
    /// Number of tries so far.
    pub tries: u32,
}

const COLUMNS: &str = "alerts.id, raised, kind, text, job";

fn read(row: &rusqlite::Row<'_>) -> rusqlite::Result<Alert> {
    Ok(Alert { id: row.get(0)?, raised: row.get(1)?, kind: row.get(2)?, text: row.get(3)?, job: row.get(4)? })
}

impl Store {
    /// Stores an alert, to be delivered to each of `places`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn raise(
        &mut self,
        kind: &str,
        what: &str,
        job: Option<JobId>,
        places: &[&str],
    ) -> Result<(), StoreError> {
        self.change("raising an alert in", |db| {
            db.execute(
                "INSERT INTO alerts (raised, kind, text, job) VALUES (?1, ?2, ?3, ?4)",
                params![now(), kind, what, job.map(|id| id.0)],
            )?;
            let id = db.last_insert_rowid();
            for place in places {
                db.execute(
                    "INSERT INTO deliveries (alert, place, next) VALUES (?1, ?2, ?3)",
                    params![id, place, now()],
                )?;
            }
            Ok(())
        })
    }

    /// The newest alerts, the newest first.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn alerts(&self, most: usize) -> Result<Vec<Alert>, StoreError> {
        let query = format!("SELECT {COLUMNS} FROM alerts ORDER BY id DESC LIMIT ?1");
        self.rows(&query, [i64::try_from(most).unwrap_or(i64::MAX)], read)
    }

    /// The next delivery whose time has come, the oldest alert first.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn due(&self) -> Result<Option<Delivery>, StoreError> {
        let query = format!(
            "SELECT {COLUMNS}, place, tries FROM deliveries JOIN alerts ON alerts.id = alert \
             WHERE next IS NOT NULL AND next <= ?1 ORDER BY alert, place LIMIT 1"
        );
        let read = |row: &rusqlite::Row<'_>| {
            Ok(Delivery { alert: read(row)?, place: row.get(5)?, tries: row.get(6)? })
        };
        self.db.query_row(&query, [now()], read).optional().map_err(self.failed("reading"))
    }

    /// Records the result of a delivery: with `trouble`, its error and the time of the next try, if any; without, it succeeded.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub fn delivered(
        &mut self,
        delivery: &Delivery,
        trouble: Option<(&str, Option<jiff::Timestamp>)>,
    ) -> Result<(), StoreError> {
        let delivered_at = trouble.is_none().then(now);
        let (trouble, next) = trouble.unzip();
        self.change("writing a delivery to", |db| {
            db.execute(
                "UPDATE deliveries SET tries = tries + 1, next = ?3, told = ?4, trouble = ?5 WHERE alert = ?1 AND place = ?2",
                params![delivery.alert.id, delivery.place, next.flatten().map(text), delivered_at, trouble],
            )
            .map(drop)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_place_is_told_once_and_trouble_comes_back_at_its_time() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path()).unwrap();
        store.raise("drift", "g3/blunt has moved", None, &["command", "webhook"]).unwrap();
        let first = store.due().unwrap().unwrap();
        assert_eq!((first.place.as_str(), first.tries), ("command", 0));
        store.delivered(&first, None).unwrap();
        let second = store.due().unwrap().unwrap();
        assert_eq!(second.place, "webhook");
        let later = jiff::Timestamp::now() + jiff::SignedDuration::from_secs(60);
        store.delivered(&second, Some(("nobody listens", Some(later)))).unwrap();
        assert_eq!(store.due().unwrap(), None);
        let past = jiff::Timestamp::now() - jiff::SignedDuration::from_secs(1);
        store.delivered(&second, Some(("nobody listens", Some(past)))).unwrap();
        drop(store);
        let mut store = Store::open(folder.path()).unwrap();
        let again = store.due().unwrap().unwrap();
        assert_eq!(again.tries, 2, "a daemon that is started again goes on");
        store.delivered(&again, Some(("nobody listens", None))).unwrap();
        assert_eq!(store.due().unwrap(), None, "given up");
        assert_eq!(store.alerts(9).unwrap().len(), 1);
    }
}
