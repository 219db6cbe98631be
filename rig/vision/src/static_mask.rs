//! The static mask: a picture that is white where the mechanism never is, whatever is seen there.

use std::path::Path;

use super::config::picture;
use super::{Mask, VisionError};

/// From here on a grey level is white.
const LEAST_WHITE_GREY: u8 = 128;

/// Reads the mask at `path` in `folder` for images of `size`, width and height \[px\].
pub(super) fn read(folder: &Path, path: &Path, size: (u32, u32)) -> Result<Mask, VisionError> {
    let picture = picture("static_mask", folder, path, size)?.grey;
    let mut mask = Mask::empty(0, 0, size.0 as usize, size.1 as usize);
    mask.bits.iter_mut().zip(picture.as_raw()).for_each(|(bit, grey)| *bit = *grey >= LEAST_WHITE_GREY);
    Ok(mask)
}
