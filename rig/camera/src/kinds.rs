//! The kinds of camera that a config can name.
//!
//! Another one is a file with its `impl Camera`, and a line of the list at the end that says how it is opened.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::config::CameraConfig;
use super::mock::{CameraFault, MockCamera, Scene, StampTruth};
use super::replay::{Film, ReplayCamera};
use super::socket::SocketCamera;
use super::v4l::V4lCamera;
use super::{Camera, CameraError};

/// What a camera is opened with.
pub struct Opening<'a> {
    /// The `[camera]` table.
    pub config: &'a CameraConfig,
    /// Relative paths in it start here.
    pub folder: &'a Path,
    /// The scene of a mock camera, the errors of its stamps, and its faults.
    pub mock: Option<(Box<dyn Scene>, StampTruth, Vec<CameraFault>)>,
    /// The images of a recorded run, for `replay`.
    pub film: Option<Film>,
}

macro_rules! cameras {
    ($($(#[$attribute:meta])* $kind:ident => |$opening:pat_param| $open:expr,)*) => {
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
            Ok(match opening.config.kind {
                $(CameraKind::$kind => {
                    let $opening = opening;
                    Box::new($open?)
                })*
            })
        }
    };
}

fn refused<T>(what: &str) -> Result<T, CameraError> {
    Err(CameraError::Refused { camera: "[camera]".into(), what: what.into() })
}

cameras! {
    /// A folder of images, for `rig extract`; no camera.
    #[default]
    Folder => |_| refused::<ReplayCamera>("a run needs a camera: set `kind` to v4l, mock, socket or replay"),
    /// A Video4Linux2 camera.
    V4l => |opening| V4lCamera::open(opening.config),
    /// The simulated tank of this process.
    Mock => |opening| match opening.mock {
        Some((scene, truth, faults)) => MockCamera::new(opening.config, scene, truth, faults),
        None => refused("`kind = \"mock\"` needs a tank to look at: add [mock] tank = \"...\""),
    },
    /// The simulated tank of a `rig mock-camera` process.
    Socket => |opening| SocketCamera::open(opening.config, opening.folder),
    /// The images of a recorded run, each as long after the run's start as it came then.
    Replay => |opening| match opening.film {
        Some(film) => Ok(ReplayCamera::new(film)),
        None => refused("`kind = \"replay\"` needs a recorded run with a camera: add [replay] run = \"...\""),
    },
}
