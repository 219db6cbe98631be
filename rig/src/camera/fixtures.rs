//! Cameras and images for tests.

use super::{CameraImage, CameraInfo, Encoding};
use crate::clock::MonotonicNs;

/// A grey camera of this width and height \[px\], 100 images a second, which stamps them in the middle of their exposure.
pub(crate) fn info((width_px, height_px): (u32, u32)) -> CameraInfo {
    CameraInfo {
        name: "test".into(),
        width_px,
        height_px,
        fps: 100.0,
        encoding: Encoding::Grey,
        mid_exposure_offset_s: 0.0,
    }
}

/// An image of it, exposed at `at`: as grey all over as the lowest byte of `sequence` says.
pub(crate) fn image(sequence: u32, at: MonotonicNs, (width_px, height_px): (u32, u32)) -> CameraImage {
    CameraImage {
        sequence,
        stamp: at,
        mid_exposure: at,
        damaged: false,
        width_px,
        height_px,
        encoding: Encoding::Grey,
        data: vec![sequence as u8; (width_px * height_px) as usize],
    }
}
