//! TOML read strictly: whatever is unknown, of a wrong type, not finite or out of range is refused with
//! file, line and caret, and a misspelt key with the nearest known one.

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer, Serialize};

use crate::names::{nearest, read_text};

/// Why a TOML document was refused.
#[derive(Debug, thiserror::Error)]
pub enum StrictError {
    /// The file could not be read.
    #[error("reading {}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is not a document of the required form.
    #[error("{}: {message}", path.display())]
    Refused {
        /// The file the text came from.
        path: PathBuf,
        /// Line, caret and reason.
        message: String,
    },
}

/// Reads the TOML file at `path`.
///
/// # Errors
/// [`StrictError`], naming the file, and the line when the content is at fault.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, StrictError> {
    let text = read_text(path).map_err(|source| StrictError::Unreadable { path: path.into(), source })?;
    parse(&text, path)
}

/// Reads TOML `text`; errors speak of it as `path`.
///
/// # Errors
/// [`StrictError::Refused`] with line, caret and reason.
pub fn parse<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T, StrictError> {
    toml::from_str(text).map_err(|error| {
        let mut message = error.to_string().trim_end().to_owned();
        if let Some(key) = nearest_key(error.message()) {
            message.push_str(&format!("\ndid you mean `{key}`?"));
        }
        StrictError::Refused { path: path.into(), message }
    })
}

/// serde names the unknown key first and then the known ones, each in backticks.
fn nearest_key(message: &str) -> Option<&str> {
    if !message.starts_with("unknown ") {
        return None;
    }
    let mut names = message.split('`').skip(1).step_by(2);
    let unknown = names.next()?;
    nearest(unknown, names)
}

macro_rules! ranged {
    ($(#[$doc:meta])* $name:ident, $x:ident => $holds:expr, $wanted:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize)]
        #[serde(transparent)]
        pub struct $name(f64);

        impl $name {
            /// The number, when it is in range.
            pub const fn new(value: f64) -> Option<Self> {
                let $x = value;
                if value.is_finite() && $holds { Some(Self(value)) } else { None }
            }

            /// A constant known to be in range; out of range it does not compile where a constant is wanted.
            pub const fn literal(value: f64) -> Self {
                match Self::new(value) {
                    Some(number) => number,
                    None => panic!(concat!("must be ", $wanted)),
                }
            }

            /// The plain number.
            pub const fn get(self) -> f64 {
                self.0
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let value = f64::deserialize(deserializer)?;
                Self::new(value).ok_or_else(|| D::Error::custom(format!(concat!("{:?} must be ", $wanted), value)))
            }
        }
    };
}

ranged!(
    /// Any number but NaN and the infinities.
    Finite, _x => true, "finite"
);
ranged!(
    /// A finite number above zero.
    Positive, x => x > 0.0, "finite and above 0"
);
ranged!(
    /// A finite number, zero or above.
    NonNegative, x => x >= 0.0, "finite and not below 0"
);
ranged!(
    /// A share between 0 and 1, both included.
    Share, x => x >= 0.0 && x <= 1.0, "between 0 and 1"
);
ranged!(
    /// A time that something waits \[s\], at most a year.
    Seconds, x => x >= 0.0 && x <= MAX_WAIT_S, "between 0 and 31622400 s, a year"
);
ranged!(
    /// A time that something waits \[s\], above zero and at most a year.
    PositiveSeconds, x => x > 0.0 && x <= MAX_WAIT_S, "above 0 and at most 31622400 s, a year"
);

/// The longest time that may be waited for \[s\], chosen: a year.
const MAX_WAIT_S: f64 = 366.0 * 86_400.0;

/// `seconds` as a duration: none below zero, at most a year, whatever the number.
pub fn duration(seconds: f64) -> Duration {
    // NaN is not above zero
    let seconds = if seconds > 0.0 { seconds.min(MAX_WAIT_S) } else { 0.0 };
    Duration::try_from_secs_f64(seconds).unwrap_or_default()
}

impl Seconds {
    /// As a duration.
    pub fn duration(self) -> Duration {
        duration(self.0)
    }
}

impl PositiveSeconds {
    /// As a duration.
    pub fn duration(self) -> Duration {
        duration(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only ever parsed")]
    struct Document {
        amplitude_rad: Finite,
        period_s: Positive,
    }

    fn refusal(text: &str) -> String {
        parse::<Document>(text, Path::new("a.toml")).unwrap_err().to_string()
    }

    #[test]
    fn misspelt_key_is_refused_with_line_caret_and_nearest_key() {
        let message = refusal("period_s = 1\namplitud_rad = 0.5\n");
        assert!(message.contains("a.toml") && message.contains("line 2"), "{message}");
        assert!(message.contains("^^^^") && message.contains("did you mean `amplitude_rad`?"), "{message}");
    }

    #[test]
    fn numbers_out_of_range_are_refused_with_their_line() {
        for text in
            ["amplitude_rad = nan\nperiod_s = 1", "amplitude_rad = 1\nperiod_s = 0", "period_s = -inf"]
        {
            let message = refusal(text);
            assert!(message.contains("must be finite") && message.contains('^'), "{message}");
        }
        assert!(refusal("period_s = \"1 s\"").contains("invalid type"));
    }

    #[test]
    fn any_number_of_seconds_is_a_duration_and_what_is_waited_for_is_at_most_a_year() {
        for (seconds, wanted) in
            [(0.25, 0.25), (-1.0, 0.0), (f64::NAN, 0.0), (f64::NEG_INFINITY, 0.0), (5e-324, 0.0)]
        {
            assert_eq!(duration(seconds).as_secs_f64(), wanted, "{seconds}");
        }
        for seconds in [1e9, f64::MAX, f64::INFINITY] {
            assert_eq!(duration(seconds).as_secs_f64(), MAX_WAIT_S);
            assert_eq!((Seconds::new(seconds), PositiveSeconds::new(seconds)), (None, None));
        }
        assert_eq!(Seconds::literal(MAX_WAIT_S).duration().as_secs(), 31_622_400);
        assert_eq!((Seconds::new(0.0).map(Seconds::get), PositiveSeconds::new(0.0)), (Some(0.0), None));
    }
}
