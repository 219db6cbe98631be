//! Why a run could not be filmed.

use std::path::PathBuf;

use camera::CameraError;
use record::RecordError;
use servo::ServoError;
use servo::profile::ProfileError;

/// Why a run could not be filmed.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The board.
    #[error(transparent)]
    Servo(#[from] ServoError),
    /// The run's files.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The profile breaks a limit.
    #[error(transparent)]
    Profile(#[from] ProfileError),
    /// The mock tank.
    #[error(transparent)]
    Tank(#[from] tank::TankError),
    /// Another process has the port.
    #[error(transparent)]
    Claim(#[from] ground::claim::ClaimError),
    /// The calibration cannot be used: better known before anything moves.
    #[error(transparent)]
    Calibration(#[from] camera::calibration::CalibrationError),
    /// A file named by the config.
    #[error("reading {}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl RunError {
    /// Nothing may move.
    pub fn is_hold(&self) -> bool {
        matches!(self, Self::Servo(ServoError::Held(_)))
    }

    /// The config or a file it names is at fault, not a device.
    pub fn is_input(&self) -> bool {
        matches!(self, Self::Profile(_) | Self::File { .. } | Self::Tank(_) | Self::Calibration(_))
    }
}
