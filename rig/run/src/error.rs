//! Why a run could not be filmed.

use std::path::PathBuf;

use camera::CameraError;
use record::RecordError;
use servo::ServoError;
use servo::profile::ProfileError;

/// Why a run could not be filmed.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The camera failed or was refused.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The board failed or was refused.
    #[error(transparent)]
    Servo(#[from] ServoError),
    /// The run's files cannot be written or read.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The profile breaks a limit.
    #[error(transparent)]
    Profile(#[from] ProfileError),
    /// The simulated tank cannot be set up.
    #[error(transparent)]
    Tank(#[from] tank::TankError),
    /// Another process has the port.
    #[error(transparent)]
    Claim(#[from] ground::claim::ClaimError),
    /// The calibration cannot be used; checked before anything moves.
    #[error(transparent)]
    Calibration(#[from] camera::calibration::CalibrationError),
    /// The model that the config names cannot be read.
    #[error("model {}", path.display())]
    Model {
        /// The model's file.
        path: PathBuf,
        /// Why.
        source: sim::MjcfError,
    },
    /// A file named by the config cannot be read.
    #[error("reading {}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl RunError {
    /// Whether a hold is the reason.
    pub fn is_hold(&self) -> bool {
        matches!(self, Self::Servo(ServoError::Held(_)))
    }

    /// Whether the config or a file that it names is at fault, not a device.
    pub fn is_input(&self) -> bool {
        matches!(
            self,
            Self::Profile(_) | Self::Model { .. } | Self::File { .. } | Self::Tank(_) | Self::Calibration(_)
        )
    }
}
