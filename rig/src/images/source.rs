//! What every source of images gives.

use image::GrayImage;

use super::error::SourceError;

/// An image and when it was exposed.
#[derive(Debug, Clone)]
pub struct TimedImage {
    /// File name, or whatever else tells it from the others.
    pub name: String,
    /// Mid-exposure \[s\].
    pub time_s: f64,
    /// The picture, or why it could not be read.
    pub grey: Result<GrayImage, String>,
}

/// A sequence of images that can be read more than once: first for a sample, then for good.
pub trait ImageSource {
    /// Reads from the beginning.
    ///
    /// # Errors
    /// [`SourceError`] when the sequence as a whole cannot be read. A single damaged image is an image with a
    /// reason instead of a picture.
    fn images(&self) -> Result<Box<dyn Iterator<Item = Result<TimedImage, SourceError>> + '_>, SourceError>;

    /// How many images there are, where that is known beforehand.
    fn len_hint(&self) -> Option<usize>;
}
