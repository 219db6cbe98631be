//! Cameras: one trait, and real, mock and replayed ones behind it.

pub mod config;
pub mod decode;
pub mod folder;
pub mod mock;
pub mod recorded;
pub mod socket;
pub mod v4l;
pub mod wire;

pub use config::{CameraConfig, CameraKind};

use std::path::Path;
use std::time::Duration;

use crate::clock::MonotonicNs;
use crate::tank::Tank;
use mock::CameraFault;

/// Opens the camera that `config` describes; relative paths in it start at `folder`. A mock camera looks at `tank`
/// and plays `faults`.
///
/// # Errors
/// [`CameraError::Refused`] naming what is missing or what the camera refuses.
pub fn open(
    config: &CameraConfig,
    folder: &Path,
    tank: Option<&Tank>,
    faults: &[CameraFault],
) -> Result<Box<dyn Camera>, CameraError> {
    let refused = |what: &str| CameraError::Refused { camera: "[camera]".into(), what: what.into() };
    Ok(match config.kind {
        CameraKind::V4l => Box::new(v4l::V4lCamera::open(config)?),
        CameraKind::Mock => {
            let tank = tank.ok_or_else(|| refused("`kind = \"mock\"` needs a table [tank] to look at"))?;
            let scene = Box::new(tank.scene(config));
            Box::new(mock::MockCamera::new(config, scene, tank.stamp_truth(), faults.to_vec())?)
        }
        CameraKind::Socket => {
            let tank = config.tank.as_ref().map(|tank| folder.join(tank));
            Box::new(socket::SocketCamera::open(&CameraConfig { tank, ..config.clone() })?)
        }
        CameraKind::Folder => {
            return Err(refused("a run needs a camera: set `kind` to v4l, mock or socket"));
        }
    })
}

/// A source of images. It lives on a thread of its own; every call returns within its timeout.
pub trait Camera: Send {
    /// What the camera is and how it was set up, as read back from it.
    fn info(&self) -> &CameraInfo;

    /// Begins to deliver images.
    ///
    /// # Errors
    /// [`CameraError`] naming the camera and what it refused.
    fn start(&mut self) -> Result<(), CameraError>;

    /// The next image, in order of exposure.
    ///
    /// # Errors
    /// [`CameraError::Stalled`] when none came within `timeout`; the other kinds end the stream.
    fn next_image(&mut self, timeout: Duration) -> Result<CameraImage, CameraError>;

    /// Ends the stream. Never fails: there is nothing left to do about it.
    fn stop(&mut self);
}

/// How an image's bytes are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Encoding {
    /// 8-bit grey, row after row without padding.
    Grey,
    /// Y U Y V, 2 bytes a pixel.
    Yuyv,
    /// A JPEG file, as the camera sent it.
    Jpeg,
    /// A PNG file.
    Png,
}

/// What a camera said about itself.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CameraInfo {
    /// Driver and device, for people.
    pub name: String,
    /// Image width \[px\].
    pub width_px: u32,
    /// Image height \[px\].
    pub height_px: u32,
    /// Images per second the camera promised.
    pub fps: f64,
    /// Layout of the bytes.
    pub encoding: Encoding,
    /// Seconds to add to a raw stamp to get mid-exposure.
    pub mid_exposure_offset_s: f64,
}

/// One image as received, with its stamp.
#[derive(Debug, Clone)]
pub struct CameraImage {
    /// The camera's own count; a gap means images were lost.
    pub sequence: u32,
    /// The camera's stamp on the host's clock, untouched.
    pub stamp: MonotonicNs,
    /// Mid-exposure: `stamp` plus [`CameraInfo::mid_exposure_offset_s`].
    pub mid_exposure: MonotonicNs,
    /// The driver marked the image as damaged.
    pub damaged: bool,
    /// Image width \[px\].
    pub width_px: u32,
    /// Image height \[px\].
    pub height_px: u32,
    /// Layout of `data`.
    pub encoding: Encoding,
    /// The bytes.
    pub data: Vec<u8>,
}

/// What went wrong with a camera.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// No image within the time allowed.
    #[error("camera {camera}: no image for {waited_ms} ms; check its cable and that nothing else uses it")]
    Stalled {
        /// Which camera.
        camera: String,
        /// How long was waited.
        waited_ms: u64,
    },
    /// The device went away.
    #[error("camera {camera}: unplugged or gone")]
    Gone {
        /// Which camera.
        camera: String,
    },
    /// A recording has no more images.
    #[error("end of the recording")]
    End,
    /// The device refused something, with what was asked, what it answered and what to do.
    #[error("camera {camera}: {what}")]
    Refused {
        /// Which camera.
        camera: String,
        /// Asked, answered, remedy.
        what: String,
    },
}
