//! Where a sequence of images comes from: a camera that films, a recorded run, a folder of pictures, a single one or a video file. Each gives
//! images with their times, in order of time, or says why not; all but a camera can be read again, behind [`ImageSource`].
//!
//! [`film`] goes the other way, pictures to a video file.
//!
//! Another kind of source is a file with its `impl ImageSource` and a line of [`open`].

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

mod error;
pub mod film;
pub mod folder;
pub mod live;
mod numbers;
pub mod recording;
mod repeats;
mod trimmed;
mod video;

pub use camera::source::{FolderError, ImageSource, Images, SourceError, TimedImage};
pub use error::FilmError;
pub use trimmed::{Trimmed, Window};

use std::path::Path;

use folder::Folder;
use record::folder::{RunFolder, file};
use recording::RecordedImages;
use video::Video;

/// The source that `path` is: a run folder, a recording, a folder of pictures, a single picture, or a video file. `fps` is for pictures without times of their own.
///
/// # Errors
/// [`SourceError`].
pub fn open(path: &Path, fps: Option<f64>) -> Result<Box<dyn ImageSource>, SourceError> {
    if path.join(file::START).is_file() {
        let run = RunFolder::open(path).map_err(recording::failed)?;
        Ok(Box::new(RecordedImages::of_run(&run)))
    } else if path.extension().is_some_and(|ending| ending == "mcap") {
        Ok(Box::new(RecordedImages::of_file(path)))
    } else if path.is_dir() {
        Ok(Box::new(Folder::open(path, fps)?))
    } else if path.is_file() && folder::is_picture(path) {
        Ok(Box::new(Folder::of_one(path)))
    } else if path.is_file() {
        Ok(Box::new(Video::open(path)?))
    } else {
        Err(SourceError::Nothing { path: path.into() })
    }
}

/// The source that `path` is, as for [`open`], where it does not matter when its pictures were taken.
///
/// # Errors
/// [`SourceError`].
pub fn open_untimed(path: &Path) -> Result<Box<dyn ImageSource>, SourceError> {
    if path.is_dir() && !path.join(file::START).is_file() {
        Ok(Box::new(Folder::untimed(path)?))
    } else {
        open(path, None)
    }
}

#[cfg(test)]
mod tests {
    use image::GrayImage;

    use super::*;

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
