//! Exclusive claims: one process at a time on a folder of runs and on a servo port, and a way to find out which.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
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
        let unusable = |source| ClaimError::Unusable { what: what.into(), path: path.into(), source };
        let mut file = open(path).map_err(unusable)?;
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
        let mut file = OpenOptions::new().read(true).write(true).open(path).ok()?;
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

fn read_pid(file: &mut File) -> Option<u32> {
    let mut text = String::new();
    file.rewind().ok()?;
    file.read_to_string(&mut text).ok()?;
    text.trim().parse().ok()
}

/// The lock file that stands for a servo port, the same for every user of this machine that shares a temporary
/// folder: `rig estop` finds through it whom to tell.
pub fn port_lock(port: &str) -> PathBuf {
    let real = std::fs::canonicalize(port).unwrap_or_else(|_| port.into());
    let name: String =
        real.to_string_lossy().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    std::env::temp_dir().join(format!("rig{name}.lock"))
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
}
