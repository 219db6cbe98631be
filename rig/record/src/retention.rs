//! A run whose recording was deleted because its rig's config says so: `retention.json` says which it was, and the checksums are of
//! what is left.

use serde::{Deserialize, Serialize};

use super::RecordError;
use super::files::{read_json, sync_folder, write_json};
use super::folder::{RunFolder, file};
use super::sums::{Sum, Sums};

/// `retention.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Removed {
    /// When, RFC 3339.
    pub at_utc: String,
    /// How long the recording was \[bytes\].
    pub bytes: u64,
    /// Its SHA-256, where it was known.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub sha256: Option<String>,
}

/// Deletes the recording of `run`, which has ended. `retention.json` is written first, so that an interrupted deletion is completed the
/// next time.
///
/// # Errors
/// [`RecordError`].
pub fn remove_recording(run: &RunFolder) -> Result<Removed, RecordError> {
    let (recording, mark) = (run.file(file::RECORDING), run.file(file::RETENTION));
    let mut sums = Sums::read(run.path())?;
    let removed = if mark.exists() {
        read_json(&mark)?
    } else {
        let about = recording.metadata().map_err(RecordError::io("asking the length of", &recording))?;
        let known = sums.as_ref().and_then(|sums| sums.0.get(file::RECORDING));
        let removed = Removed {
            at_utc: jiff::Timestamp::now().to_string(),
            bytes: about.len(),
            sha256: known.map(Sum::to_string),
        };
        write_json(&mark, &removed)?;
        removed
    };
    if let Some(sums) = &mut sums {
        sums.0.remove(file::RECORDING);
        sums.0.insert(file::RETENTION.into(), Sum::of_file(&mark)?);
        sums.write(run.path())?;
    }
    std::fs::remove_file(&recording).map_err(RecordError::io("deleting", &recording))?;
    sync_folder(run.path())?;
    Ok(removed)
}
