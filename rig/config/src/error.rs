//! Why a config cannot be used.

use std::path::PathBuf;

use ground::strict::StrictError;

use servo::calibration::ServoCalibrationError;

/// Why a config cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The text is at fault.
    #[error(transparent)]
    Strict(#[from] StrictError),
    /// A servo's calibration, or what it says beside the config.
    #[error("{}", path.display())]
    Servo {
        /// The config.
        path: PathBuf,
        /// What.
        source: Box<ServoCalibrationError>,
    },
    /// Its tables contradict each other.
    #[error("{}: {why}", path.display())]
    Contradiction {
        /// The config.
        path: PathBuf,
        /// What, and what to do.
        why: String,
    },
}
