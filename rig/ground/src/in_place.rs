//! Small JSON documents in files of a fixed size that are rewritten in place: once created, a full disk cannot prevent the next
//! write, and a reader needs no lock.

#![allow(clippy::disallowed_methods, reason = "what a full disk must not refuse")]

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Result};
use std::os::unix::fs::{FileExt, OpenOptionsExt, PermissionsExt};
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

/// The size of such a file: a page of memory, a block of most disks.
const PAGE_BYTES: usize = 4096;

/// Follows no link and waits for no pipe: every user may be able to write to the folder.
fn options() -> OpenOptions {
    let flags = rustix::fs::OFlags::NOFOLLOW | rustix::fs::OFlags::NONBLOCK;
    let mut options = OpenOptions::new();
    options.read(true).custom_flags(flags.bits().cast_signed());
    options
}

/// Creates the file at `path` with `document` in it and the permissions `mode`, forced to the disk; leaves an existing one alone.
///
/// # Errors
/// What the system says.
pub fn make(path: &Path, document: &impl Serialize, mode: u32) -> Result<()> {
    let file = match options().write(true).create_new(true).open(path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => return Ok(()),
        file => file?,
    };
    // set after creation, so that the process's umask does not change it
    file.set_permissions(std::fs::Permissions::from_mode(mode))?;
    put(&file, document)?;
    file.sync_all()
}

/// Rewrites the file at `path`, which must exist.
///
/// # Errors
/// What the system says.
pub fn write(path: &Path, document: &impl Serialize) -> Result<File> {
    // not created: in a folder of everybody's the kernel refuses that for a file of another user's (`fs.protected_regular`)
    let file = options().write(true).open(path)?;
    put(&file, document)?;
    Ok(file)
}

fn put(file: &File, document: &impl Serialize) -> Result<()> {
    let mut page = serde_json::to_vec(document)?;
    if page.len() >= PAGE_BYTES {
        return Err(std::io::Error::new(
            ErrorKind::InvalidInput,
            format!("{} bytes, and {PAGE_BYTES} are the most", page.len()),
        ));
    }
    page.resize(PAGE_BYTES - 1, b' ');
    page.push(b'\n');
    file.write_all_at(&page, 0)
}

/// The document in the file at `path`; `None` where there is no file, or an empty one.
///
/// # Errors
/// What the system says; [`ErrorKind::InvalidData`] for what is no such document.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    let file = match options().open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        file => file?,
    };
    let mut text = Vec::with_capacity(PAGE_BYTES);
    file.take(2 * PAGE_BYTES as u64).read_to_end(&mut text)?;
    match text.trim_ascii() {
        [] => Ok(None),
        text => serde_json::from_slice(text)
            .map(Some)
            .map_err(|error| std::io::Error::new(ErrorKind::InvalidData, error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn document_is_rewritten_where_it_lies_and_keeps_its_size() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state.json");
        assert_eq!(read::<String>(&path).unwrap(), None);
        make(&path, &"first", 0o644).unwrap();
        make(&path, &"not again", 0o644).unwrap();
        assert_eq!(read::<String>(&path).unwrap().as_deref(), Some("first"));
        let inode = |path: &Path| std::os::unix::fs::MetadataExt::ino(&path.metadata().unwrap());
        let before = inode(&path);
        write(&path, &"second, and longer").unwrap();
        assert_eq!(read::<String>(&path).unwrap().as_deref(), Some("second, and longer"));
        assert_eq!((inode(&path), path.metadata().unwrap().len()), (before, PAGE_BYTES as u64));
        assert!(write(&path, &"x".repeat(PAGE_BYTES)).is_err());
        assert!(write(&folder.path().join("none"), &"").is_err());
    }

    #[test]
    fn what_is_no_document_is_an_error_and_nothing_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hold.json");
        std::fs::write(&path, "{\"half").unwrap();
        assert!(read::<String>(&path).is_err());
        std::fs::write(&path, "").unwrap();
        assert_eq!(read::<String>(&path).unwrap(), None);
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&path, &link).unwrap();
        assert!(read::<String>(&link).is_err() && write(&link, &"").is_err());
        let pipe = folder.path().join("pipe");
        rustix::fs::mknodat(
            rustix::fs::CWD,
            &pipe,
            rustix::fs::FileType::Fifo,
            rustix::fs::Mode::from_raw_mode(0o644),
            0,
        )
        .unwrap();
        assert!(read::<String>(&pipe).unwrap_or(None).is_none());
    }
}
