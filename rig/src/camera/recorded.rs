//! A recording as a camera: the images of a run folder's `recording.mcap`, once more.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::{Camera, CameraError, CameraImage, CameraInfo, decode};
use crate::clock::MonotonicNs;
use crate::record::RecordError;
use crate::record::reader::{Item, Recording};
use crate::vision::TimedImage;
use crate::vision::source::{ImageSource, SourceError};

/// Hands over the images of a recording, as fast as they are asked for and with the stamps they had.
pub struct RecordedCamera {
    info: CameraInfo,
    recording: Recording,
}

impl RecordedCamera {
    /// Opens the recording at `path`.
    ///
    /// # Errors
    /// [`RecordError`] when it cannot be read or no camera took part.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let recording = Recording::open(path)?;
        let Some(info) = recording.camera_info().cloned() else {
            return Err(RecordError::damaged(path, "holds no camera's images"));
        };
        Ok(Self { info, recording })
    }
}

impl Camera for RecordedCamera {
    fn info(&self) -> &CameraInfo {
        &self.info
    }

    fn start(&mut self) -> Result<(), CameraError> {
        Ok(())
    }

    fn next_image(&mut self, _timeout: Duration) -> Result<CameraImage, CameraError> {
        loop {
            match self.recording.next() {
                Some(Ok((_, Item::Image(image)))) => return Ok(image),
                Some(Ok(_)) => {}
                Some(Err(error)) => {
                    return Err(CameraError::Refused {
                        camera: self.info.name.clone(),
                        what: error.to_string(),
                    });
                }
                None => return Err(CameraError::End),
            }
        }
    }

    fn stop(&mut self) {}
}

/// The images of a recording for extraction; they can be read more than once.
#[derive(Debug, Clone)]
pub struct RecordedImages {
    path: PathBuf,
    origin: Option<MonotonicNs>,
}

impl RecordedImages {
    /// The images of the recording at `path`; times count from `origin`, the run's, or from the first image.
    pub fn new(path: &Path, origin: Option<MonotonicNs>) -> Self {
        Self { path: path.into(), origin }
    }
}

impl ImageSource for RecordedImages {
    fn images(&self) -> Result<Box<dyn Iterator<Item = Result<TimedImage, SourceError>> + '_>, SourceError> {
        let mut camera = RecordedCamera::open(&self.path)?;
        let mut origin = self.origin;
        Ok(Box::new(std::iter::from_fn(move || {
            let image = match camera.next_image(Duration::ZERO) {
                Ok(image) => image,
                Err(CameraError::End) => return None,
                // Said once; what is damaged stays so.
                Err(error) => {
                    tracing::warn!("{error}");
                    return None;
                }
            };
            let grey = match image.damaged {
                true => Err("marked as damaged by the camera".to_owned()),
                false => decode::grey(&image).map_err(|error| error.to_string()),
            };
            let origin = *origin.get_or_insert(image.mid_exposure);
            let time_s = image.mid_exposure.seconds_since(origin);
            Some(Ok(TimedImage { name: format!("image {}", image.sequence), time_s, grey }))
        })))
    }

    fn len_hint(&self) -> Option<usize> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Encoding;
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

        let source = crate::vision::source::open(&path, None).unwrap();
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
}
