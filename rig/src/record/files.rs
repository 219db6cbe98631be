//! Files that are there whole or not at all, and are still there after a power cut.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{RecordError, below};

/// Makes the folder `path`, and those above it, where it is missing, and sees that a power cut leaves it there.
///
/// # Errors
/// [`RecordError::Io`].
pub fn create_folder(path: &Path) -> Result<(), RecordError> {
    if path.is_dir() {
        return Ok(());
    }
    create_folder(containing(path))?;
    match std::fs::create_dir(path) {
        // another process has made it
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists && path.is_dir() => {}
        made => made.map_err(RecordError::io("creating folder", path))?,
    }
    sync_folder(containing(path))
}

/// Writes a file in one step: beside its place, forced to the disk, then renamed.
///
/// # Errors
/// [`RecordError::Io`]; the old content is then still there.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), RecordError> {
    let folder = containing(path);
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let part = folder.join(name);
    let write = || -> std::io::Result<()> {
        let mut file = File::create(&part)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&part, path)
    };
    write().map_err(RecordError::io("writing", path))?;
    sync_folder(folder)
}

/// The folder that `path` is in.
pub(super) fn containing(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A new file or another name is on the disk only when its folder is.
pub(super) fn sync_folder(path: &Path) -> Result<(), RecordError> {
    File::open(path)
        .and_then(|folder| folder.sync_all())
        .map_err(RecordError::io("forcing to the disk folder", path))
}

/// Writes `value` as JSON in one step.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), RecordError> {
    write_whole(path, &json(path, value)?)
}

/// `value` as JSON, for the file at `path`.
pub(super) fn json(path: &Path, value: &impl Serialize) -> Result<Vec<u8>, RecordError> {
    let mut json = serde_json::to_vec_pretty(value).map_err(|error| RecordError::damaged(path, error))?;
    json.push(b'\n');
    Ok(json)
}

/// Reads a value from JSON.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, RecordError> {
    let text = below::read_at(path).map_err(RecordError::io("reading", path))?;
    serde_json::from_slice(&text).map_err(|error| RecordError::damaged(path, error))
}
