//! How runs are called.

use rand::RngExt;
use serde::{Deserialize, Serialize};

/// A run's name, for example `20261120T101503Z-ab12cd`: when it began, and six random characters.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct RunId(String);

impl RunId {
    /// A new name for a run that begins now.
    pub fn now() -> Self {
        const LETTERS: &[u8] = b"abcdefghijklmnopqrstuvwxyz0123456789";
        let mut random = rand::rng();
        let suffix: String =
            (0..6).map(|_| char::from(LETTERS[random.random_range(0..LETTERS.len())])).collect();
        Self(format!("{}-{suffix}", jiff::Timestamp::now().strftime("%Y%m%dT%H%M%SZ")))
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for RunId {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        let shape = |pattern: &str| {
            pattern.len() == name.len()
                && name.bytes().zip(pattern.bytes()).all(|(byte, wanted)| match wanted {
                    b'9' => byte.is_ascii_digit(),
                    b'a' => byte.is_ascii_lowercase() || byte.is_ascii_digit(),
                    other => byte == other,
                })
        };
        if shape("99999999T999999Z-aaaaaa") {
            Ok(Self(name))
        } else {
            Err(format!("run id `{name}` is not of the form 20261120T101503Z-ab12cd"))
        }
    }
}

impl std::str::FromStr for RunId {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        name.to_owned().try_into()
    }
}

impl From<RunId> for String {
    fn from(id: RunId) -> Self {
        id.0
    }
}

impl std::fmt::Display for RunId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_lead_elsewhere_are_no_run_ids() {
        assert!(RunId::try_from(RunId::now().as_str().to_owned()).is_ok());
        for name in
            ["../../etc", "20261120T101503Z-AB12CD", "20261120T101503Z-ab12c", "20261120T101503Z-ab/2cd", ""]
        {
            assert!(RunId::try_from(name.to_owned()).is_err(), "{name}");
        }
    }
}
