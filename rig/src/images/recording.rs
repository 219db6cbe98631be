//! The images of a run folder's `recording.mcap`.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use super::error::SourceError;
use super::source::{ImageSource, TimedImage};
use crate::camera::{CameraImage, decode};
use crate::clock::MonotonicNs;
use crate::record::RecordError;
use crate::record::reader::{Item, Recording};

/// The images of a recording for extraction; they can be read more than once.
#[derive(Debug)]
pub struct RecordedImages {
    path: PathBuf,
    origin: Option<MonotonicNs>,
    /// Whether it was said that the recording is cut off.
    warned: AtomicBool,
}

impl RecordedImages {
    /// The images of the recording at `path`; times count from `origin`, the run's, or from the first image.
    pub fn new(path: &Path, origin: Option<MonotonicNs>) -> Self {
        Self { path: path.into(), origin, warned: AtomicBool::new(false) }
    }
}

impl ImageSource for RecordedImages {
    /// A recording that was cut off gives what it holds, with a warning; a damaged one an error.
    fn images(&self) -> Result<Box<dyn Iterator<Item = Result<TimedImage, SourceError>> + '_>, SourceError> {
        let mut recording = Recording::open(&self.path)?;
        if recording.camera_info().is_none() {
            return Err(RecordError::damaged(&self.path, "holds no camera's images").into());
        }
        let mut origin = self.origin;
        Ok(Box::new(std::iter::from_fn(move || {
            loop {
                match recording.next() {
                    Some(Ok((_, Item::Image(image)))) => {
                        let origin = *origin.get_or_insert(image.mid_exposure);
                        let image = timed(&image, origin);
                        return Some(Ok(TimedImage { name: format!("image {}", image.name), ..image }));
                    }
                    Some(Ok(_)) => {}
                    Some(Err(error)) => return Some(Err(error.into())),
                    None => {
                        if !self.warned.swap(true, Ordering::Relaxed) {
                            recording.warn_if_cut_off();
                        }
                        return None;
                    }
                }
            }
        })))
    }

    fn len_hint(&self) -> Option<usize> {
        None
    }
}

/// An image as the extraction takes it, its time counted from `origin`.
pub fn timed(image: &CameraImage, origin: MonotonicNs) -> TimedImage {
    let grey = match image.damaged {
        true => Err("marked as damaged by the camera".to_owned()),
        false => decode::grey(image).map_err(|error| error.to_string()),
    };
    let time_s = image.mid_exposure.seconds_since(origin);
    TimedImage { name: image.sequence.to_string(), time_s, grey }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{CameraInfo, Encoding};
    use crate::record::recording::{Recorder, RecorderOptions};

    #[test]
    fn recording_is_a_source_of_timed_pictures_and_damaged_images_keep_their_place() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("recording.mcap");
        let info = CameraInfo {
            name: "test".into(),
            width_px: 4,
            height_px: 2,
            fps: 100.0,
            encoding: Encoding::Grey,
            mid_exposure_offset_s: 0.001,
        };
        let recorder = Recorder::create(&path, Some(&info), RecorderOptions::default()).unwrap();
        for sequence in 0..3 {
            let stamp = MonotonicNs(5_000_000_000).plus_seconds(0.01 * f64::from(sequence));
            recorder
                .image(std::sync::Arc::new(CameraImage {
                    sequence,
                    stamp,
                    mid_exposure: stamp.plus_seconds(0.001),
                    damaged: sequence == 1,
                    width_px: 4,
                    height_px: 2,
                    encoding: Encoding::Grey,
                    data: vec![sequence as u8; 8],
                }))
                .unwrap();
        }
        recorder.finish().unwrap();

        let source = crate::images::open(&path, None).unwrap();
        // More than once, as extraction does.
        for _ in 0..2 {
            let images: Vec<_> = source.images().unwrap().map(|image| image.unwrap()).collect();
            let times: Vec<_> = images.iter().map(|image| image.time_s).collect();
            assert_eq!(times, [0.0, 0.01, 0.02]);
            assert_eq!(images[2].grey.as_ref().unwrap().as_raw(), &[2; 8]);
            assert!(images[1].grey.as_ref().unwrap_err().contains("damaged"));
        }
        let from_start = RecordedImages::new(&path, Some(MonotonicNs(4_000_000_000)));
        let first = from_start.images().unwrap().next().unwrap().unwrap();
        assert!((first.time_s - 1.001).abs() < 1e-12);
    }

    #[test]
    fn a_damaged_recording_is_an_error_and_a_cut_one_gives_what_it_holds() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("recording.mcap");
        // Images larger than a chunk: each has one of its own.
        let size = (2048, 1024);
        let info = CameraInfo {
            name: "test".into(),
            width_px: size.0,
            height_px: size.1,
            fps: 100.0,
            encoding: Encoding::Grey,
            mid_exposure_offset_s: 0.0,
        };
        let recorder = Recorder::create(&path, Some(&info), RecorderOptions::default()).unwrap();
        for sequence in 0..3 {
            let stamp = MonotonicNs(1).plus_seconds(0.01 * f64::from(sequence));
            recorder
                .image(std::sync::Arc::new(CameraImage {
                    sequence,
                    stamp,
                    mid_exposure: stamp,
                    damaged: false,
                    width_px: size.0,
                    height_px: size.1,
                    encoding: Encoding::Grey,
                    data: vec![7 + sequence as u8; (size.0 * size.1) as usize],
                }))
                .unwrap();
        }
        recorder.finish().unwrap();
        let whole = std::fs::read(&path).unwrap();
        let second = whole.windows(64).position(|bytes| bytes == [8; 64]).unwrap();
        let read = |bytes: &[u8]| -> Vec<Result<TimedImage, SourceError>> {
            std::fs::write(&path, bytes).unwrap();
            crate::images::open(&path, None).unwrap().images().unwrap().collect()
        };

        let mut damaged = whole.clone();
        damaged[second] ^= 1;
        let images = read(&damaged);
        assert!(images[0].is_ok());
        assert!(matches!(images.last(), Some(Err(SourceError::Recording(RecordError::Damaged { .. })))));
        let cut = read(&whole[..second + 64]);
        assert!(cut.len() == 1 && cut[0].is_ok(), "{}", cut.len());
    }
}
