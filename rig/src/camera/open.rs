//! Which camera a config names.

use std::path::Path;

use super::config::{CameraConfig, CameraKind};
use super::mock::{CameraFault, MockCamera, Scene, StampTruth};
use super::socket::SocketCamera;
use super::v4l::V4lCamera;
use super::{Camera, CameraError};

/// Opens the camera that `config` describes; relative paths in it start at `folder`. A mock camera looks at `mock`'s scene,
/// stamps its images as truly as it says, and plays its faults.
///
/// # Errors
/// [`CameraError::Refused`] naming what is missing or what the camera refuses.
pub fn open(
    config: &CameraConfig,
    folder: &Path,
    mock: Option<(Box<dyn Scene>, StampTruth, Vec<CameraFault>)>,
) -> Result<Box<dyn Camera>, CameraError> {
    let refused = |what: &str| CameraError::Refused { camera: "[camera]".into(), what: what.into() };
    Ok(match config.kind {
        CameraKind::V4l => Box::new(V4lCamera::open(config)?),
        CameraKind::Mock => {
            let needs = "`kind = \"mock\"` needs a tank to look at: add [mock] tank = \"...\"";
            let (scene, truth, faults) = mock.ok_or_else(|| refused(needs))?;
            Box::new(MockCamera::new(config, scene, truth, faults)?)
        }
        CameraKind::Socket => {
            let tank = config.tank.as_ref().map(|tank| folder.join(tank));
            Box::new(SocketCamera::open(&CameraConfig { tank, ..config.clone() })?)
        }
        CameraKind::Folder => {
            return Err(refused("a run needs a camera: set `kind` to v4l, mock or socket"));
        }
    })
}
