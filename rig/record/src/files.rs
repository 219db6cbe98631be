//! Files that are written whole or not at all, and that survive a power cut.

use std::ffi::OsString;
use std::fs::{File, Permissions};
use std::io::{Seek, SeekFrom, Write};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use tempfile::TempPath;

use super::{RecordError, below};

/// Creates the folder `path` and those above it where they are missing, and forces them to the disk.
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

/// Prefix of the names of files that are not whole yet; their final name follows it.
const PART_FILE_PREFIX: &str = ".part-";

/// Whether a file of this name was left by a program that was killed while it wrote it.
pub(super) fn is_part(name: &str) -> bool {
    name.starts_with(PART_FILE_PREFIX)
}

/// A file that is being written, under another name in the same folder; it takes its own name in one step when it is whole. Dropped before
/// that, it leaves nothing behind, and the file that had its name stays.
#[derive(Debug)]
pub struct Part {
    file: File,
    path: TempPath,
    to: PathBuf,
}

impl Part {
    /// Begins a file that is to be at `to`, whose folder exists.
    ///
    /// # Errors
    /// [`RecordError::Io`].
    pub fn begin(to: &Path) -> Result<Self, RecordError> {
        let mut ending = OsString::from("-");
        ending.push(to.file_name().unwrap_or_default());
        let made = tempfile::Builder::new()
            .prefix(PART_FILE_PREFIX)
            .suffix(&ending)
            // as any new file, of which the umask takes its share
            .permissions(Permissions::from_mode(0o666))
            .tempfile_in(containing(to));
        let (file, path) = made.map_err(RecordError::io("writing", to))?.into_parts();
        Ok(Self { file, path, to: to.into() })
    }

    /// Its path while it is not whole, for another program to write it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Finishes it: forces it to the disk and gives it its name.
    ///
    /// # Errors
    /// [`RecordError::Io`]; what was under its name is then still there.
    pub fn finish(self) -> Result<(), RecordError> {
        let Self { file, path, to } = self;
        file.sync_all()
            .and_then(|()| std::fs::rename(&path, &to))
            .map_err(RecordError::io("writing", &to))?;
        // there is nothing under its other name any more that would have to be removed
        let _ = path.keep();
        sync_folder(containing(&to))
    }
}

impl Write for Part {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Part {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.file.seek(to)
    }
}

/// Writes a file in one step: under another name, forced to the disk, then renamed.
///
/// # Errors
/// [`RecordError::Io`]; the old content is then still there.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), RecordError> {
    let mut part = Part::begin(path)?;
    part.write_all(bytes).map_err(RecordError::io("writing", path))?;
    part.finish()
}

/// The folder that `path` is in.
pub fn containing(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Forces a folder to the disk: only then are new files and new names in it on the disk.
pub(super) fn sync_folder(path: &Path) -> Result<(), RecordError> {
    File::open(path)
        .and_then(|folder| folder.sync_all())
        .map_err(RecordError::io("forcing to the disk folder", path))
}

/// Writes `value` as JSON in one step.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), RecordError> {
    write_whole(path, &json(path, value)?)
}

/// `value` as JSON, for the file at `path`.
pub fn json(path: &Path, value: &impl Serialize) -> Result<Vec<u8>, RecordError> {
    let mut json = serde_json::to_vec_pretty(value).map_err(|error| RecordError::damaged(path, error))?;
    json.push(b'\n');
    Ok(json)
}

/// Reads a value from JSON.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, RecordError> {
    let text = below::read_at(path).map_err(RecordError::io("reading", path))?;
    serde_json::from_slice(&text).map_err(|error| RecordError::damaged(path, error))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let name =
            |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
        std::fs::read_dir(folder).unwrap().map(name).collect()
    }

    #[test]
    fn a_file_that_is_not_whole_leaves_what_was_there_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        std::fs::write(&path, "before").unwrap();
        let mut part = Part::begin(&path).unwrap();
        part.write_all(b"half").unwrap();
        let part_name = part.path().file_name().unwrap().to_str().unwrap().to_owned();
        assert!(is_part(&part_name) && part_name.ends_with("-t.csv"), "{part_name}");
        drop(part);
        assert_eq!(
            (std::fs::read_to_string(&path).unwrap().as_str(), names(folder.path()).len()),
            ("before", 1)
        );
        write_whole(&path, b"whole").unwrap();
        assert_eq!(
            (std::fs::read_to_string(&path).unwrap().as_str(), names(folder.path()).len()),
            ("whole", 1)
        );
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
        std::fs::write(folder.path().join("any"), "").unwrap();
        assert_eq!(mode(&path), mode(&folder.path().join("any")), "as any new file");
    }

    #[test]
    fn two_who_write_the_same_file_leave_one_of_both_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        let [mut one, mut other] = [(); 2].map(|()| Part::begin(&path).unwrap());
        for _ in 0..3 {
            one.write_all(b"1").unwrap();
            other.write_all(b"2").unwrap();
        }
        one.finish().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "111");
        other.finish().unwrap();
        assert_eq!(
            (std::fs::read_to_string(&path).unwrap().as_str(), names(folder.path()).len()),
            ("222", 1)
        );
    }
}
