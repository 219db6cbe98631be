//! Which model each run was made with, and where it was changed.

use crc::{CRC_64_XZ, Crc};
use serde::{Deserialize, Serialize};
use sim::Cause;
use utoipa::ToSchema;

use super::{Store, StoreError};
use record::below;
use record::folder::RunFolder;

/// The checksum that identifies a model.
const FINGERPRINT: Crc<u64> = Crc::<u64>::new(&CRC_64_XZ);

/// The model that a run was made with, as far as it takes to tell it from another one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct MadeWith {
    /// CRC-64 of its file, in hexadecimal digits.
    pub file: String,
    /// The causes that the config adds to it, by name.
    pub causes: Vec<String>,
}

/// From one run to the next the model was changed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ModelChange {
    /// The first run with the new one.
    pub run: String,
    /// The last run with the old one.
    pub before: String,
    /// What was changed.
    pub what: Vec<String>,
}

impl MadeWith {
    /// That of `run`; none where its file cannot be read.
    pub(super) fn of(run: &RunFolder) -> Option<Self> {
        let file = below::read(run.path(), &[&run.start().model]).ok()?;
        // a config that cannot be read adds no causes
        let config: toml::Table = run.start().config.parse().unwrap_or_default();
        let added_by_config = config.get("cause").and_then(|causes| causes.as_array()).into_iter().flatten();
        let added_by_config = added_by_config.filter_map(|cause| cause.get("name")?.as_str());
        let of_fit = |key: &str| config.get("fit").and_then(|fit| fit.get(key));
        let listed = ["parameters", "fixed"].into_iter().filter_map(|key| of_fit(key)?.as_array()).flatten();
        let believed =
            of_fit("prior").and_then(|prior| prior.as_table()).into_iter().flat_map(toml::Table::keys);
        let parameters = listed.filter_map(|name| name.as_str()).chain(believed.map(String::as_str));
        let named = parameters.filter_map(|name| name.split_once('/')).map(|(cause, _)| cause);
        let mut causes: Vec<String> = added_by_config
            .chain(named.filter(|name| name.parse::<Cause>().is_ok()))
            .map(str::to_owned)
            .collect();
        causes.sort_unstable();
        causes.dedup();
        Some(Self { file: format!("{:016x}", FINGERPRINT.checksum(&file)), causes })
    }

    /// What was changed from this one to `next`, a few words each.
    fn changes_to(&self, next: &Self) -> Vec<String> {
        let file = (self.file != next.file).then(|| "another model file".to_owned());
        let added = next.causes.iter().filter(|cause| !self.causes.contains(cause));
        let removed = self.causes.iter().filter(|cause| !next.causes.contains(cause));
        let added = added.map(|cause| format!("{cause} added"));
        file.into_iter().chain(added).chain(removed.map(|cause| format!("{cause} taken out"))).collect()
    }
}

impl Store {
    /// Where the model was changed from one run to the next, oldest first.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn model_changes(&self) -> Result<Vec<ModelChange>, StoreError> {
        let query = "SELECT id, summary -> '$.model' FROM runs WHERE json_type(summary, '$.model') = 'object' \
                     ORDER BY summary ->> '$.number', id";
        let lines: Vec<(String, String)> = self.rows(query, [], |row| Ok((row.get(0)?, row.get(1)?)))?;
        let read = |(run, text): (String, String)| match serde_json::from_str::<MadeWith>(&text) {
            Ok(model) => Ok((run, model)),
            Err(error) => Err(self.damaged(&error)),
        };
        let models: Vec<(String, MadeWith)> = lines.into_iter().map(read).collect::<Result<_, _>>()?;
        let change = |pair: &[(String, MadeWith)]| {
            let what = pair[0].1.changes_to(&pair[1].1);
            (!what.is_empty()).then(|| ModelChange {
                run: pair[1].0.clone(),
                before: pair[0].0.clone(),
                what,
            })
        };
        Ok(models.windows(2).filter_map(change).collect())
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, SystemTime};

    use super::super::runs::tests::cut_short;
    use super::*;
    use record::folder::file;

    #[test]
    fn changes_of_the_model_are_found_and_lines_of_an_earlier_layout_are_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let long_ago = SystemTime::now() - Duration::from_secs(3600);
        let run = |second: u32, model: &str, config: &str| {
            let id = format!("20261120T1015{second:02}Z-ab12cd");
            let path = cut_short(folder.path(), &id);
            let start = std::fs::read(path.join(file::START)).unwrap();
            let mut start: serde_json::Value = serde_json::from_slice(&start).unwrap();
            start["config"] = config.into();
            std::fs::write(path.join(file::START), start.to_string()).unwrap();
            std::fs::write(path.join(file::MODEL_START), model).unwrap();
            let stop = serde_json::json!({
                "status": "success", "clock": {"monotonic_ns": 8_500_000_000_u64, "utc": "2026-11-20T10:15:06Z"},
                "servo": "acknowledged", "images": 350, "images_lost": 0, "messages_dropped": 0,
            });
            std::fs::write(path.join(file::STOP), stop.to_string()).unwrap();
            std::fs::File::open(&path).unwrap().set_modified(long_ago).unwrap();
            id
        };
        let lag = "[fit]\nparameters = [\"fluidcoef\", \"tether/stiffness\", \"g3/blunt\"]\n";
        let ids = [
            run(1, "<a/>", ""),
            run(2, "<a/>", "[fit]\nparameters = [\"g3/blunt\"]\n"),
            run(3, "<b/>", ""),
            run(4, "<b/>", lag),
            run(5, "<b/>", "[[cause]]\nname = \"hose\"\n"),
        ];
        let mut store = Store::open(folder.path()).unwrap();
        store.refresh(false).unwrap();
        let change = |at: usize, what: &[&str]| ModelChange {
            run: ids[at].clone(),
            before: ids[at - 1].clone(),
            what: what.iter().map(|&word| word.to_owned()).collect(),
        };
        let expected = [
            change(2, &["another model file"]),
            change(3, &["tether added"]),
            change(4, &["hose added", "tether taken out"]),
        ];
        assert_eq!(store.model_changes().unwrap(), expected);

        store
            .change("a test", |db| {
                db.execute("UPDATE runs SET summary = json_remove(summary, '$.model', '$.losses')", [])
            })
            .unwrap();
        assert_eq!(store.model_changes().unwrap(), []);
        drop(store);
        let mut store = Store::open(folder.path()).unwrap();
        assert_eq!(store.refresh(false).unwrap().read, 5);
        assert_eq!(store.model_changes().unwrap(), expected);
        assert_eq!(store.refresh(false).unwrap().read, 0);
    }
}
