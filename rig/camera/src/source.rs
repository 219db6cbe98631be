//! The interface of all sources of images.

mod error;

pub use error::{FolderError, SourceError};

use image::GrayImage;

use crate::CameraImage;
use crate::decode::{self, Picture};
use ground::clock::MonotonicNs;

/// An image and when it was exposed.
#[derive(Debug, Clone)]
pub struct TimedImage {
    /// File name, or another name that identifies it.
    pub name: String,
    /// Mid-exposure \[s\].
    pub time_s: f64,
    /// The picture's brightness, or why it could not be read.
    pub grey: Result<GrayImage, String>,
    /// Its colour, Cb and Cr, where it has any.
    pub chroma: Option<[GrayImage; 2]>,
}

impl TimedImage {
    /// An image as received, its time counted from `origin`.
    pub fn of(image: &CameraImage, origin: MonotonicNs) -> Self {
        let picture = match image.damaged {
            true => Err("marked as damaged by the camera".to_owned()),
            false => decode::picture(image).map_err(|error| error.to_string()),
        };
        let time_s = image.mid_exposure.seconds_since(origin);
        Self::new(image.sequence.to_string(), time_s, picture)
    }

    /// An image called `name`, taken at `time_s` \[s\].
    pub fn new(name: String, time_s: f64, picture: Result<Picture, String>) -> Self {
        match picture {
            Ok(Picture { grey, chroma }) => Self { name, time_s, grey: Ok(grey), chroma },
            Err(why) => Self { name, time_s, grey: Err(why), chroma: None },
        }
    }
}

/// Images in order of time, or why there are no more.
pub type Images<'a> = Box<dyn Iterator<Item = Result<TimedImage, SourceError>> + 'a>;

/// A sequence of images that can be read more than once: first for a sample, then for good.
pub trait ImageSource: Send + Sync {
    /// Reads from the beginning.
    ///
    /// # Errors
    /// [`SourceError`] when the sequence as a whole cannot be read. A single damaged image is an image with a
    /// reason instead of a picture.
    fn images(&self) -> Result<Images<'_>, SourceError>;

    /// How many images there are, where that is known beforehand.
    fn len_hint(&self) -> Option<usize>;

    /// What is to be known of a sequence that was read to its end, each as a sentence without its full stop: what is missing, what is doubtful
    /// about its times.
    fn remarks(&self) -> Vec<String> {
        Vec::new()
    }

    /// At most `most` images to learn the empty tank from: spread evenly over the sequence, unless the source knows better ones.
    ///
    /// # Errors
    /// [`SourceError`].
    fn sample(&self, most: usize) -> Result<Vec<TimedImage>, SourceError> {
        even_sample(self, most)
    }
}

/// Images at hand, in order of time.
impl ImageSource for [TimedImage] {
    fn images(&self) -> Result<Images<'_>, SourceError> {
        Ok(Box::new(self.iter().cloned().map(Ok)))
    }

    fn len_hint(&self) -> Option<usize> {
        Some(self.len())
    }
}

/// At most `most` images spread evenly over a sequence, whatever its length: every image until there are too many, then every
/// second of those, and so on.
///
/// # Errors
/// [`SourceError`].
pub fn even_sample(
    source: &(impl ImageSource + ?Sized),
    most: usize,
) -> Result<Vec<TimedImage>, SourceError> {
    let mut selected: Vec<TimedImage> = Vec::new();
    let mut stride = source.len_hint().map_or(1, |len| len.div_ceil(most).max(1));
    for (i, image) in source.images()?.enumerate() {
        if i % stride != 0 {
            continue;
        }
        selected.push(image?);
        if selected.len() > most {
            let mut even = false;
            selected.retain(|_| {
                even = !even;
                even
            });
            stride *= 2;
        }
    }
    Ok(selected)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Counted(usize, bool);

    impl ImageSource for Counted {
        fn images(&self) -> Result<Images<'_>, SourceError> {
            let image = |i| TimedImage {
                name: format!("{i}"),
                time_s: i as f64,
                chroma: None,
                grey: Err(String::new()),
            };
            Ok(Box::new((0..self.0).map(move |i| Ok(image(i)))))
        }

        fn len_hint(&self) -> Option<usize> {
            self.1.then_some(self.0)
        }
    }

    #[test]
    fn sample_is_even_and_spans_the_sequence_known_length_or_not() {
        for known in [true, false] {
            for length in [1, 7, 8, 9, 100, 1000] {
                let sample = Counted(length, known).sample(8).unwrap();
                assert!(
                    (4..=8).contains(&sample.len()) || sample.len() == length,
                    "{length}: {}",
                    sample.len()
                );
                let steps: Vec<f64> = sample.windows(2).map(|p| p[1].time_s - p[0].time_s).collect();
                assert!(steps.windows(2).all(|s| s[0] == s[1]), "{steps:?}");
                assert!(sample.last().unwrap().time_s >= 0.74 * (length - 1) as f64, "{length} {known}");
            }
        }
    }
}
