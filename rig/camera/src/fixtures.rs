//! Cameras, images and the chunks of recordings, for tests.

use super::{CameraImage, CameraInfo, Encoding};
use ground::clock::MonotonicNs;

/// A grey camera of this width and height \[px\], 100 images a second, which stamps them in the middle of their exposure.
pub fn info((width_px, height_px): (u32, u32)) -> CameraInfo {
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
pub fn image(sequence: u32, at: MonotonicNs, (width_px, height_px): (u32, u32)) -> CameraImage {
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

/// Where the messages of each chunk of a recording stand in its file, compressed.
pub fn chunks(file: &[u8]) -> Vec<std::ops::Range<usize>> {
    const MAGIC_BYTES: usize = 8;
    const CHUNK: u8 = 6;
    let number = |at: usize, bytes: usize| {
        file[at..at + bytes].iter().rev().fold(0, |number, &byte| number << 8 | usize::from(byte))
    };
    let (mut at, mut chunks) = (MAGIC_BYTES, Vec::new());
    // A record is a letter, its length, and so many bytes.
    while at + 9 <= file.len() {
        let (body, length) = (at + 9, number(at + 1, 8));
        if file[at] == CHUNK {
            // two times, uncompressed length, checksum; the compression's name; the length of what follows
            let name_bytes = number(body + 28, 4);
            chunks.push(body + 32 + name_bytes + 8..body + length);
        }
        at = body + length;
    }
    chunks
}
