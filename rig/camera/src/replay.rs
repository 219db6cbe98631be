//! A camera that replays the images of a recorded run.

use std::time::{Duration, Instant};

use super::{Camera, CameraError, CameraImage, CameraInfo};
use ground::clock::{MonotonicNs, ReplayClock};

/// Recorded images: the host's time at which each was handed over, and the image, or why there are no more.
pub type Received = Box<dyn Iterator<Item = Result<(MonotonicNs, CameraImage), String>> + Send>;

/// A recorded run's images.
pub struct Film {
    /// Description of the recorded camera.
    pub info: CameraInfo,
    /// Its images.
    pub received: Received,
    /// Maps times of the recorded run to times of this one.
    pub clock: ReplayClock,
}

/// Hands out each image as long after the run's start as in the recorded run, with its stamps shifted accordingly.
pub struct ReplayCamera {
    film: Film,
    next: Option<(MonotonicNs, CameraImage)>,
}

impl ReplayCamera {
    /// The camera of that run.
    pub fn new(film: Film) -> Self {
        Self { film, next: None }
    }
}

impl Camera for ReplayCamera {
    fn info(&self) -> &CameraInfo {
        &self.film.info
    }

    fn start(&mut self) -> Result<(), CameraError> {
        Ok(())
    }

    /// After the last image it is silent, as a camera that was stopped.
    fn next_image(&mut self, timeout: Duration) -> Result<CameraImage, CameraError> {
        let deadline = Instant::now() + timeout;
        let left = || deadline.saturating_duration_since(Instant::now());
        if self.next.is_none() {
            self.next = self
                .film
                .received
                .next()
                .transpose()
                .map_err(|what| CameraError::Refused { camera: self.film.info.name.clone(), what })?;
        }
        let Some((handed_over, _)) = &self.next else {
            std::thread::sleep(left());
            return Err(CameraError::End);
        };
        let wait_s = self.film.clock.to_present(*handed_over).seconds_since(MonotonicNs::now()).max(0.0);
        std::thread::sleep(left().min(ground::strict::duration(wait_s)));
        if left().is_zero() {
            let camera = self.film.info.name.clone();
            return Err(CameraError::Stalled { camera, waited_ms: timeout.as_millis() as u64 });
        }
        let (_, image) = self.next.take().ok_or(CameraError::End)?;
        let shifted = |then| self.film.clock.to_present(then);
        Ok(CameraImage { stamp: shifted(image.stamp), mid_exposure: shifted(image.mid_exposure), ..image })
    }

    fn stop(&mut self) {}
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, OnceLock};

    use super::*;
    use crate::fixtures;

    const TIMEOUT: Duration = Duration::from_millis(300);

    fn camera(times_ms: &[u64]) -> ReplayCamera {
        let image = |(sequence, &at_ms): (usize, &u64)| {
            let at = MonotonicNs(at_ms * 1_000_000);
            Ok((at, fixtures::image(sequence as u32, at, (1, 1))))
        };
        let images: Vec<_> = times_ms.iter().enumerate().map(image).collect();
        let info = fixtures::info((1, 1));
        let start = Arc::new(OnceLock::from(MonotonicNs::now()));
        let clock = ReplayClock::new(MonotonicNs(1_000_000_000), start);
        ReplayCamera::new(Film { info, received: Box::new(images.into_iter()), clock })
    }

    #[test]
    fn images_come_as_far_apart_as_then_and_silence_is_a_stall_or_the_end() {
        let mut camera = camera(&[1010, 1050, 1500]);
        let first = camera.next_image(TIMEOUT).unwrap();
        let second = camera.next_image(TIMEOUT).unwrap();
        assert_eq!(second.stamp.0 - first.stamp.0, 40_000_000);
        assert!(second.stamp <= MonotonicNs::now(), "shown before it was taken");
        assert!(matches!(camera.next_image(TIMEOUT), Err(CameraError::Stalled { waited_ms: 300, .. })));
        assert_eq!(camera.next_image(TIMEOUT).unwrap().data, [2]);
        assert!(matches!(camera.next_image(TIMEOUT), Err(CameraError::End)));
    }
}
