//! A recording as a camera: the images of a run folder's `recording.mcap`, once more.

use std::path::Path;
use std::time::Duration;

use super::{Camera, CameraError, CameraImage, CameraInfo};
use crate::record::RecordError;
use crate::record::reader::{Item, Recording};

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
