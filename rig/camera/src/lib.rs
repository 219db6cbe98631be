//! Cameras: one trait, and a real one, a mock, one in another process and a recorded one behind it.
//!
//! Another kind is a file and a line of the list in `kinds`. The trait's tests in the mock say what is expected of one: images in order of
//! exposure, stamps on CLOCK_MONOTONIC, every call back within its timeout.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

pub mod calibration;
pub mod config;
pub mod coverage;
pub mod decode;
#[doc(hidden)]
pub mod fixtures;
mod kinds;
pub mod mock;
pub mod replay;
pub mod socket;
pub mod source;
pub mod v4l;
pub mod wire;

pub use config::CameraConfig;
pub use kinds::{CameraKind, Opening, open};

use std::time::Duration;

use ground::clock::MonotonicNs;

/// Buffers for images that wait for the program, chosen: at 120 images a second it may be held up for 90 ms, at 30 for 0.4 s.
const IMAGE_BUFFERS: u32 = 12;

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

    /// Ends the stream. Never fails, since nothing could be done about a failure.
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

impl Encoding {
    /// Bytes of a picture of `pixels` pixels; for compressed encodings an upper bound.
    pub fn bytes(self, pixels: u64) -> u64 {
        match self {
            Self::Grey | Self::Jpeg | Self::Png => pixels,
            Self::Yuyv => 2 * pixels,
        }
    }
}

/// A camera's description of itself.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CameraInfo {
    /// Driver and device, as named in messages.
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

impl CameraInfo {
    /// Bytes that it sends per second; for compressed encodings an upper bound.
    pub fn bytes_per_s(&self) -> f64 {
        self.encoding.bytes(u64::from(self.width_px) * u64::from(self.height_px)) as f64 * self.fps
    }
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

/// Images the camera counted between two that were received. A count that went back is a restart, not a loss.
pub fn images_lost(before: u32, now: u32) -> u32 {
    let step = now.wrapping_sub(before);
    if step < 1 << 31 { step.saturating_sub(1) } else { 0 }
}

/// Selects the images that can be used by their stamps: each must be later than all before.
#[derive(Debug, Clone, Default)]
pub struct Rising(Option<MonotonicNs>);

impl Rising {
    /// Whether an image exposed at `mid_exposure`, the next received, can be used.
    pub fn takes(&mut self, mid_exposure: MonotonicNs) -> bool {
        let rises = self.0.is_none_or(|latest| mid_exposure > latest);
        if rises {
            self.0 = Some(mid_exposure);
        }
        rises
    }
}

#[cfg(test)]
mod tests {
    use super::{Rising, images_lost};
    use ground::clock::MonotonicNs;

    #[test]
    fn images_stamped_no_later_than_all_before_are_not_used() {
        let mut rising = Rising::default();
        let used = [10, 20, 20, 15, 19, 21].map(|at_ns| rising.takes(MonotonicNs(at_ns)));
        assert_eq!(used, [true, true, false, false, false, true]);
    }

    #[test]
    fn gaps_in_the_count_are_losses_and_restarts_are_not() {
        assert_eq!(images_lost(7, 8), 0);
        assert_eq!(images_lost(7, 11), 3);
        assert_eq!(images_lost(u32::MAX, 1), 1);
        assert_eq!(images_lost(500, 0), 0);
        assert_eq!(images_lost(7, 7), 0);
    }
}
