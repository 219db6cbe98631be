//! Exclusive claims: one process at a time on a runs folder and on a servo port, and a way to find out which process.

#![allow(clippy::disallowed_methods, reason = "what one process has alone")]

use std::fs::{File, OpenOptions, Permissions, TryLockError};
use std::io::{ErrorKind, Read, Seek, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// A claim, held until dropped or until its process ends, however it ends: the kernel lets go of the lock.
#[derive(Debug)]
pub struct Claim {
    _file: File,
}

/// Why a claim failed.
#[derive(Debug, thiserror::Error)]
pub enum ClaimError {
    /// Another process has it.
    #[error("{what} is in use by process {}; end it first", holder.map_or("?".into(), |pid| pid.to_string()))]
    Held {
        /// What was claimed.
        what: String,
        /// Who has it, where known.
        holder: Option<u32>,
    },
    /// The lock file cannot be used.
    #[error("claiming {what} through {}", path.display())]
    Unusable {
        /// What was claimed.
        what: String,
        /// The lock file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl Claim {
    /// Claims `what` through the lock file at `path`, which is made where missing and never removed: removing it
    /// would let two processes hold locks on two files of one name.
    ///
    /// # Errors
    /// [`ClaimError::Held`] with the holder's process id, or [`ClaimError::Unusable`].
    pub fn take(what: &str, path: &Path) -> Result<Self, ClaimError> {
        Self::take_opened(what, path, open(path))
    }

    /// Claims the servo port `port`, for whoever on this machine may use it: every user's `rig` finds this claim.
    ///
    /// # Errors
    /// As [`Claim::take`].
    pub fn take_port(port: &str) -> Result<Self, ClaimError> {
        let path = port_lock(port);
        Self::take_opened(port, &path, open_for_all(&path))
    }

    fn take_opened(what: &str, path: &Path, file: std::io::Result<File>) -> Result<Self, ClaimError> {
        let unusable = |source| ClaimError::Unusable { what: what.into(), path: path.into(), source };
        let mut file = file.map_err(unusable)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(ClaimError::Held { what: what.into(), holder: read_pid(&mut file) });
            }
            Err(TryLockError::Error(source)) => return Err(unusable(source)),
        }
        file.set_len(0).and_then(|()| write!(file, "{}", std::process::id())).map_err(unusable)?;
        Ok(Self { _file: file })
    }

    /// The process that holds the lock file at `path`, if one does.
    pub fn holder(path: &Path) -> Option<u32> {
        // Another user's file can only be read, one on a network's disk only be locked by who may write.
        let mut file = open_existing(path).or_else(|_| File::open(path)).ok()?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => read_pid(&mut file),
            _ => None,
        }
    }
}

fn open(path: &Path) -> std::io::Result<File> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)
}

fn open_existing(path: &Path) -> std::io::Result<File> {
    OpenOptions::new().read(true).write(true).open(path)
}

/// Opens a lock file that other users open too. An existing one is not opened for creation: in a folder that all may write to, the kernel
/// refuses that for another user's file (`fs.protected_regular`).
fn open_for_all(path: &Path) -> std::io::Result<File> {
    match open_existing(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        opened => return opened,
    }
    match OpenOptions::new().read(true).write(true).create_new(true).open(path) {
        Ok(file) => {
            file.set_permissions(Permissions::from_mode(0o666))?;
            Ok(file)
        }
        Err(error) if error.kind() == ErrorKind::AlreadyExists => open_existing(path),
        refused => refused,
    }
}

/// Whether process `pid` has the file at `path` open: the process id in a lock file that everybody may write to proves nothing. `None`
/// where this process may not look.
pub fn has_open(pid: u32, path: &Path) -> Option<bool> {
    let wanted = path.metadata().ok()?;
    let open_files = std::fs::read_dir(format!("/proc/{pid}/fd")).ok()?;
    let open_files = open_files.filter_map(|entry| entry.ok()?.path().metadata().ok());
    let mut identities = open_files.map(|file| (file.dev(), file.ino()));
    Some(identities.any(|identity| identity == (wanted.dev(), wanted.ino())))
}

fn read_pid(file: &mut File) -> Option<u32> {
    let mut text = String::new();
    file.rewind().ok()?;
    file.read_to_string(&mut text).ok()?;
    text.trim().parse().ok()
}

/// The lock file of a servo port: `rig estop` finds through it the process that it has to stop.
pub fn port_lock(port: &str) -> PathBuf {
    port_file(port, "lock")
}

/// The file of a servo port with this ending: the same for every user of this machine and for a service with a temporary
/// folder of its own, and for every name of the port.
pub fn port_file(port: &str, ending: &str) -> PathBuf {
    let real = std::fs::canonicalize(port).unwrap_or_else(|_| port.into());
    let mut name = real.to_string_lossy().into_owned();
    // the number of a pseudo-terminal is used again, for another board
    if name.starts_with("/dev/pts/")
        && let Ok(node) = real.metadata()
    {
        name += &format!("-{}", node.ctime());
    }
    let name: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    folder_for_all(Path::new("/run/lock")).join(format!("rig{name}.{ending}"))
}

/// `preferred` where everybody may write to it, as Debian has it for locks of devices; else the temporary folder.
fn folder_for_all(preferred: &Path) -> PathBuf {
    let all_write = |folder: std::fs::Metadata| folder.is_dir() && folder.mode() & 0o002 != 0;
    match preferred.metadata().is_ok_and(all_write) {
        true => preferred.into(),
        false => std::env::temp_dir(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn second_claim_is_refused_with_the_holder_and_works_after_the_first_ended() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("runs/.lock");
        assert_eq!(Claim::holder(&path), None);
        let first = Claim::take("runs", &path).expect("free");
        assert_eq!(Claim::holder(&path), Some(std::process::id()));
        let refused = Claim::take("runs", &path).unwrap_err().to_string();
        assert!(refused.contains(&std::process::id().to_string()), "{refused}");
        drop(first);
        assert_eq!(Claim::holder(&path), None);
        Claim::take("runs", &path).expect("free again");
    }

    #[test]
    fn locks_of_ports_lie_where_everybody_writes_and_are_everybodys() {
        let folder = tempfile::tempdir().expect("a folder");
        let mode =
            |mode| std::fs::set_permissions(folder.path(), Permissions::from_mode(mode)).expect("ours");
        mode(0o1777);
        assert_eq!(folder_for_all(folder.path()), folder.path());
        mode(0o755);
        assert_eq!(folder_for_all(folder.path()), std::env::temp_dir());
        assert_eq!(folder_for_all(Path::new("/nowhere")), std::env::temp_dir());

        let path = folder.path().join("rig-port.lock");
        for _ in ["made", "there already"] {
            open_for_all(&path).expect("a lock file");
            assert_eq!(path.metadata().expect("a lock file").mode() & 0o777, 0o666);
        }
    }

    #[test]
    fn who_is_said_to_hold_a_lock_can_be_looked_at() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("lock");
        let claim = Claim::take("a port", &path).expect("free");
        assert_eq!(has_open(std::process::id(), &path), Some(true));
        drop(claim);
        assert_eq!(has_open(std::process::id(), &path), Some(false));
        assert_eq!(has_open(u32::MAX, &path), None);
    }
}
