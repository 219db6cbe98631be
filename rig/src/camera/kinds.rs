//! The kinds of camera that a config can name.
//!
//! Another one is a file with its `impl Camera` and a function that opens it, and a line of the list at the end.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::config::CameraConfig;
use super::mock::{CameraFault, Scene, StampTruth};
use super::replay::Film;
use super::{Camera, CameraError, mock, replay, socket, v4l};

/// What a camera is opened with.
pub struct Opening<'a> {
    /// The `[camera]` table.
    pub config: &'a CameraConfig,
    /// Relative paths in it start here.
    pub folder: &'a Path,
    /// What a mock camera looks at, how truly it stamps its images, and its faults.
    pub mock: Option<(Box<dyn Scene>, StampTruth, Vec<CameraFault>)>,
    /// What a replayed camera shows.
    pub film: Option<Film>,
}

macro_rules! cameras {
    ($($(#[$attribute:meta])* $kind:ident => $open:path,)*) => {
        /// Where images come from.
        #[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(rename_all = "lowercase")]
        pub enum CameraKind {
            $($(#[$attribute])* $kind,)*
        }

        /// Opens the camera that a config names.
        ///
        /// # Errors
        /// [`CameraError::Refused`] naming what is missing or what the camera refuses.
        pub fn open(opening: Opening<'_>) -> Result<Box<dyn Camera>, CameraError> {
            match opening.config.kind {
                $(CameraKind::$kind => $open(opening),)*
            }
        }
    };
}

fn no_camera(_: Opening<'_>) -> Result<Box<dyn Camera>, CameraError> {
    let what = "a run needs a camera: set `kind` to v4l, mock, socket or replay".into();
    Err(CameraError::Refused { camera: "[camera]".into(), what })
}

cameras! {
    /// A folder of images, for `rig extract`; no camera.
    #[default]
    Folder => no_camera,
    /// A Video4Linux2 camera.
    V4l => v4l::open,
    /// The simulated tank of this process.
    Mock => mock::open,
    /// The simulated tank of a `rig mock-camera` process.
    Socket => socket::open,
    /// The images of a recorded run, each as long after the run's start as it came then.
    Replay => replay::open,
}
