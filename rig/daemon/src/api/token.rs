//! The token of a runs folder: who can read it may move the rig.

#![allow(clippy::disallowed_methods, reason = "a secret that is made once")]

use std::io::{ErrorKind, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use rand::RngExt;

use record::{RecordError, below};

/// Its file, in the folder of run folders.
pub(crate) const FILE: &str = ".token";
/// As many random bytes as nobody can try.
const TOKEN_BYTES: usize = 32;
/// Bits of a file's mode that let others than its owner at it.
const OTHER_USERS_MODE_BITS: u32 = 0o077;

/// The secret that a request must show before it may move a rig.
pub(crate) struct Token(String);

impl Token {
    /// The token of the folder `runs_dir`; a new one where there is none, or, with a message to `report`, where others may know the old one.
    ///
    /// # Errors
    /// [`RecordError`] where it cannot be kept from others, or not be written.
    pub(crate) fn of(runs_dir: &Path, mut report: impl FnMut(&str)) -> Result<Self, RecordError> {
        let path = runs_dir.join(FILE);
        let why = match read_private(&path) {
            Ok(Ok(token)) => return Ok(Self(token)),
            Ok(Err(why)) => why,
            Err(error) if error.kind() == ErrorKind::NotFound => return Self::make(&path),
            // a link, a folder, a pipe
            Err(error) if error.kind() == ErrorKind::InvalidInput => error.to_string(),
            Err(error) => return Err(RecordError::io("reading the token", &path)(error)),
        };
        let token = Self::make(&path)?;
        report(&format!("rig: the token in {} was {why}: a new one is there now", path.display()));
        Ok(token)
    }

    /// Puts a new one at `path`, whole or not at all, in the place of what is there.
    fn make(path: &Path) -> Result<Self, RecordError> {
        let mut bytes = [0; TOKEN_BYTES];
        rand::rng().fill(&mut bytes);
        let token = URL_SAFE_NO_PAD.encode(bytes);
        let new = path.with_file_name(format!("{FILE}-{}", std::process::id()));
        let write = || -> std::io::Result<()> {
            // of a process of the same number that was killed here
            let _ = std::fs::remove_file(&new);
            let mut file = std::fs::File::options().write(true).create_new(true).mode(0o600).open(&new)?;
            file.write_all(token.as_bytes())?;
            file.sync_all()?;
            std::fs::rename(&new, path)
        };
        let written = write();
        if written.is_err() {
            let _ = std::fs::remove_file(&new);
        }
        written.map_err(RecordError::io("making the token", path))?;
        match read_private(path).map_err(RecordError::io("reading the token", path))? {
            Ok(token) => Ok(Self(token)),
            Err(why) => {
                let _ = std::fs::remove_file(path);
                let what = format!(
                    "a token that was just made is {why}: the file system keeps no rights; put --runs-dir on one that does, or mount this one \
                     with umask=077"
                );
                Err(RecordError::damaged(path, what))
            }
        }
    }

    /// Whether `guess` is the token, compared in constant time.
    pub(super) fn is(&self, guess: &str) -> bool {
        let (guess, token) = (guess.as_bytes(), self.0.as_bytes());
        guess.len() == token.len()
            && guess.iter().zip(token).fold(0, |different, (a, b)| different | (a ^ b)) == 0
    }

    /// The token as text, only to be shown on the terminal on which the daemon was started.
    pub(crate) fn text(&self) -> &str {
        &self.0
    }
}

/// The token at `path`, or why others than this user may know it.
fn read_private(path: &Path) -> std::io::Result<Result<String, String>> {
    let file = below::at(path)?;
    let about = file.metadata()?;
    let user = rustix::process::geteuid().as_raw();
    if about.uid() != user {
        return Ok(Err(format!("owned by user {}, not by user {user} who serves", about.uid())));
    }
    if about.mode() & OTHER_USERS_MODE_BITS != 0 {
        return Ok(Err(format!("open to others (mode {:03o})", about.mode() & 0o777)));
    }
    let token = std::io::read_to_string(file)?.trim().to_owned();
    Ok(if token.len() < TOKEN_BYTES { Err("too short".into()) } else { Ok(token) })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt, symlink};

    use super::*;

    /// The token of a start, and what is told.
    fn start(runs_dir: &Path) -> (String, Vec<String>) {
        let mut told = Vec::new();
        let token = Token::of(runs_dir, |text| told.push(text.to_owned()));
        (token.unwrap_or_else(|error| panic!("{error}")).text().to_owned(), told)
    }

    #[test]
    fn token_is_made_once_and_kept_to_its_user() {
        let folder = tempfile::tempdir().unwrap();
        let (token, told) = start(folder.path());
        assert_eq!((token.len(), told.len()), (43, 0));
        let path = folder.path().join(FILE);
        assert_eq!(path.metadata().unwrap().mode() & 0o777, 0o600);
        assert_eq!(start(folder.path()), (token, Vec::new()));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside it");
    }

    #[test]
    fn token_that_others_may_know_is_replaced_and_that_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE);
        let secret = folder.path().join("elsewhere");
        let known = "A".repeat(43);
        for (mode, why) in [(0o644, "mode 644"), (0o640, "mode 640"), (0o606, "mode 606")] {
            std::fs::write(&path, &known).unwrap();
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
            let (token, told) = start(folder.path());
            assert!(token != known && told[0].contains(why), "{told:?}");
            assert_eq!(start(folder.path()), (token, Vec::new()));
        }
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&secret, &known).unwrap();
        std::fs::set_permissions(&secret, std::fs::Permissions::from_mode(0o600)).unwrap();
        symlink(&secret, &path).unwrap();
        let (token, told) = start(folder.path());
        assert!(token != known && told[0].contains("a link"), "{told:?}");
        assert_eq!(std::fs::read_to_string(&secret).unwrap(), known, "where the link led is left alone");
        assert!(!path.is_symlink());
        std::fs::write(&path, "short").unwrap();
        assert!(start(folder.path()).1[0].contains("too short"));
    }
}
