//! The token of a runs folder: who can read it may move the rig.

use std::fs::OpenOptions;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use rand::RngExt;

use crate::record::RecordError;

/// Its file, in the folder of run folders.
const FILE: &str = ".token";
/// As many random bytes as nobody can try.
const BYTES: usize = 32;

/// See the module.
pub(in crate::daemon) struct Token(String);

impl Token {
    /// That of the folder `runs_dir`; made where there is none.
    ///
    /// # Errors
    /// [`RecordError::Io`].
    pub(in crate::daemon) fn of(runs_dir: &Path) -> Result<Self, RecordError> {
        let path = runs_dir.join(FILE);
        let made = OpenOptions::new().write(true).create_new(true).mode(0o600).open(&path);
        match made {
            Ok(mut file) => {
                let mut bytes = [0; BYTES];
                rand::rng().fill(&mut bytes);
                let token = URL_SAFE_NO_PAD.encode(bytes);
                let write = file.write_all(token.as_bytes()).and_then(|()| file.sync_all());
                write.map_err(RecordError::io("writing the token", &path))?;
                Ok(Self(token))
            }
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                let mut token = String::new();
                let read = std::fs::File::open(&path).and_then(|mut file| file.read_to_string(&mut token));
                read.map_err(RecordError::io("reading the token", &path))?;
                match token.trim().len() >= BYTES {
                    true => Ok(Self(token.trim().into())),
                    false => Err(RecordError::damaged(
                        &path,
                        "too short for a token; delete it, a new one is made",
                    )),
                }
            }
            Err(error) => Err(RecordError::io("making the token", &path)(error)),
        }
    }

    /// Whether `said` is it. Takes as long for any guess of its length.
    pub(super) fn is(&self, said: &str) -> bool {
        let (said, own) = (said.as_bytes(), self.0.as_bytes());
        said.len() == own.len() && said.iter().zip(own).fold(0, |different, (a, b)| different | (a ^ b)) == 0
    }

    /// For the address that is told to the user.
    pub(in crate::daemon) fn text(&self) -> &str {
        &self.0
    }
}
