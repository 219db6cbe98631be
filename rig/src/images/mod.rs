//! Where a sequence of images comes from: a recorded run, a folder of pictures or a video file, each behind [`ImageSource`].

mod error;
pub mod folder;
pub mod recording;
mod source;
mod video;

pub use error::{FolderError, SourceError};
pub use source::{ImageSource, TimedImage};

use std::path::Path;

use crate::record::folder::{RunFolder, file};
use folder::Folder;
use recording::RecordedImages;
use video::Video;

/// The source that `path` is: a run folder, a recording, a folder of pictures, or a video file. `fps` is for pictures without times of their own.
///
/// # Errors
/// [`SourceError`].
pub fn open(path: &Path, fps: Option<f64>) -> Result<Box<dyn ImageSource>, SourceError> {
    if path.join(file::START).is_file() {
        let run = RunFolder::open(path)?;
        Ok(Box::new(RecordedImages::new(&run.file(file::RECORDING), Some(run.origin()))))
    } else if path.extension().is_some_and(|ending| ending == "mcap") {
        Ok(Box::new(RecordedImages::new(path, None)))
    } else if path.is_dir() {
        Ok(Box::new(Folder::open(path, fps)?))
    } else if path.is_file() {
        Ok(Box::new(Video::open(path)?))
    } else {
        Err(SourceError::Nothing { path: path.into() })
    }
}

/// At most `most` images spread evenly over the sequence, whatever its length: every image until there are too
/// many, then every second of those, and so on.
///
/// # Errors
/// [`SourceError`].
pub fn sample(source: &dyn ImageSource, most: usize) -> Result<Vec<TimedImage>, SourceError> {
    let mut kept: Vec<TimedImage> = Vec::new();
    let mut stride = source.len_hint().map_or(1, |len| len.div_ceil(most).max(1));
    for (i, image) in source.images()?.enumerate() {
        if i % stride != 0 {
            continue;
        }
        kept.push(image?);
        if kept.len() > most {
            let mut even = false;
            kept.retain(|_| {
                even = !even;
                even
            });
            stride *= 2;
        }
    }
    Ok(kept)
}

#[cfg(test)]
mod tests {
    use image::GrayImage;

    use super::*;

    struct Counted(usize, bool);

    impl ImageSource for Counted {
        fn images(
            &self,
        ) -> Result<Box<dyn Iterator<Item = Result<TimedImage, SourceError>> + '_>, SourceError> {
            let image = |i| TimedImage { name: format!("{i}"), time_s: i as f64, grey: Err(String::new()) };
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
                let kept = sample(&Counted(length, known), 8).unwrap();
                assert!((4..=8).contains(&kept.len()) || kept.len() == length, "{length}: {}", kept.len());
                let steps: Vec<f64> = kept.windows(2).map(|p| p[1].time_s - p[0].time_s).collect();
                assert!(steps.windows(2).all(|s| s[0] == s[1]), "{steps:?}");
                assert!(kept.last().unwrap().time_s >= 0.74 * (length - 1) as f64, "{length} {known}");
            }
        }
    }

    #[test]
    fn damaged_picture_keeps_its_row_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        GrayImage::new(4, 3).save(folder.path().join("a.png")).unwrap();
        std::fs::write(folder.path().join("b.png"), b"\x89PNG\r\n\x1a\nnonsense").unwrap();
        let source = open(folder.path(), Some(10.0)).unwrap();
        let images: Vec<TimedImage> = source.images().unwrap().map(Result::unwrap).collect();
        assert!(images[0].grey.is_ok() && images[1].grey.as_ref().is_err_and(|why| !why.is_empty()));
    }
}
