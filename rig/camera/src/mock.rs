//! The mock camera: films a simulated scene in real time, with the timing, losses and faults of a real camera.

mod fault;

pub use fault::{CameraFault, CameraFaultKind};

use std::collections::VecDeque;
use std::time::Duration;

use image::{GrayImage, ImageEncoder};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::{Camera, CameraConfig, CameraError, CameraImage, CameraInfo, Encoding, IMAGE_BUFFERS};
use ground::clock::MonotonicNs;

/// The scene that a mock camera films.
pub trait Scene: Send {
    /// The picture at the instant `at`.
    ///
    /// # Errors
    /// Why there is none, as a message.
    fn picture(&mut self, at: MonotonicNs) -> Result<GrayImage, String>;

    /// When the run began from which faults are timed; none: when the camera was started.
    fn run_origin(&self) -> Option<MonotonicNs> {
        None
    }
}

/// The errors of the mock camera's stamps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampTruth {
    /// How much later than the start of exposure stamps really are \[s\].
    pub latency_s: f64,
    /// Standard deviation of the stamps \[s\].
    pub jitter_s: f64,
    /// Seed of the jitter and of what faults do, together with when the film starts.
    pub seed: u64,
}

/// Share of the images that an intermittent camera loses, chosen.
const INTERMITTENT_LOSS_SHARE: f64 = 0.3;
/// JPEG quality, chosen as that of a common webcam.
const JPEG_QUALITY: u8 = 90;

/// The mock camera.
pub struct MockCamera {
    info: CameraInfo,
    exposure_s: f64,
    scene: Box<dyn Scene>,
    truth: StampTruth,
    faults: Vec<CameraFault>,
    random: ChaCha8Rng,
    /// When image 0 was exposed, while started.
    first: Option<MonotonicNs>,
    next: u32,
    /// Images that wait for the program, as in a driver's buffers.
    buffered: VecDeque<u32>,
    /// The last picture, which a stuck camera repeats.
    last_picture: Option<GrayImage>,
}

impl MockCamera {
    /// A camera set up as `config` says, looking at `scene`.
    ///
    /// # Errors
    /// [`CameraError::Refused`] where `config` leaves out what it needs.
    pub fn new(
        config: &CameraConfig,
        scene: Box<dyn Scene>,
        truth: StampTruth,
        mut faults: Vec<CameraFault>,
    ) -> Result<Self, CameraError> {
        let fps = config.fps()?;
        let exposure_s = config.exposure_s.map_or(0.0, |exposure| exposure.get());
        if exposure_s > 1.0 / fps {
            return Err(CameraError::Refused {
                camera: "mock".into(),
                what: format!(
                    "an exposure of {exposure_s} s does not fit into {fps} images a second; lower either"
                ),
            });
        }
        faults.sort_by(|a, b| a.at_s.get().total_cmp(&b.at_s.get()));
        Ok(Self {
            info: CameraInfo {
                name: "mock".into(),
                width_px: config.width_px,
                height_px: config.height_px,
                fps,
                encoding: config.format,
                mid_exposure_offset_s: exposure_s / 2.0 - config.latency_s.get(),
            },
            exposure_s,
            scene,
            truth,
            faults,
            random: ChaCha8Rng::seed_from_u64(truth.seed),
            first: None,
            next: 0,
            buffered: VecDeque::new(),
            last_picture: None,
        })
    }

    /// The fault that holds at `at`: the latest that has begun.
    fn fault(&self, at: MonotonicNs) -> Option<CameraFaultKind> {
        let since = at.seconds_since(self.scene.run_origin().or(self.first)?);
        self.faults.iter().rev().find(|fault| fault.at_s.get() <= since).map(|fault| fault.kind)
    }

    /// Image `index`: when it is exposed, in truth.
    fn exposed(&self, first: MonotonicNs, index: u32) -> MonotonicNs {
        first.plus_seconds(f64::from(index) / self.info.fps)
    }

    /// When image `index` is read out.
    fn ready(&self, first: MonotonicNs, index: u32) -> MonotonicNs {
        self.exposed(first, index).plus_seconds(self.exposure_s / 2.0)
    }

    /// Waits for the next image that is not lost; its index and true mid-exposure.
    fn wait(
        &mut self,
        timeout: Duration,
    ) -> Result<(u32, MonotonicNs, Option<CameraFaultKind>), CameraError> {
        let camera = || self.info.name.clone();
        let Some(first) = self.first else {
            return Err(CameraError::Refused {
                camera: camera(),
                what: "was asked for images before it was started".into(),
            });
        };
        let stalled = || CameraError::Stalled { camera: camera(), waited_ms: timeout.as_millis() as u64 };
        let deadline = MonotonicNs::now().plus_seconds(timeout.as_secs_f64());
        loop {
            let now = MonotonicNs::now();
            while self.ready(first, self.next) <= now {
                // one for which no buffer is free is lost, and leaves a gap in the count
                if self.buffered.len() < IMAGE_BUFFERS as usize {
                    self.buffered.push_back(self.next);
                }
                self.next += 1;
            }
            let Some(index) = self.buffered.pop_front() else {
                if now >= deadline {
                    return Err(stalled());
                }
                let until = self.ready(first, self.next).min(deadline);
                std::thread::sleep(Duration::from_nanos(until.0.saturating_sub(now.0)));
                continue;
            };
            let exposed = self.exposed(first, index);
            let fault = self.fault(exposed);
            match fault {
                Some(CameraFaultKind::Off) => return Err(CameraError::Gone { camera: camera() }),
                Some(CameraFaultKind::Slow) => {
                    let left = deadline.0.saturating_sub(MonotonicNs::now().0);
                    std::thread::sleep(Duration::from_nanos(left));
                    return Err(stalled());
                }
                _ => {}
            }
            if fault == Some(CameraFaultKind::Intermittent)
                && self.random.random_bool(INTERMITTENT_LOSS_SHARE)
            {
                continue;
            }
            return Ok((index, exposed, fault));
        }
    }
}

impl Camera for MockCamera {
    fn info(&self) -> &CameraInfo {
        &self.info
    }

    fn start(&mut self) -> Result<(), CameraError> {
        let first = MonotonicNs::now().plus_seconds(self.exposure_s / 2.0);
        // each film has a jitter of its own: what repeated runs had in common would look like a property of the mechanism
        self.random = ChaCha8Rng::seed_from_u64(self.truth.seed ^ first.0);
        self.first = Some(first);
        self.next = 0;
        self.buffered.clear();
        Ok(())
    }

    fn next_image(&mut self, timeout: Duration) -> Result<CameraImage, CameraError> {
        let (sequence, exposed, fault) = self.wait(timeout)?;
        let refused = |what| CameraError::Refused { camera: "mock".into(), what };
        let picture = match (fault, self.last_picture.take()) {
            (Some(CameraFaultKind::Stuck), Some(repeated)) => repeated,
            _ => self.scene.picture(exposed).map_err(refused)?,
        };
        let mut data = encode(&picture, self.info.encoding).map_err(refused)?;
        if fault == Some(CameraFaultKind::Garbage) {
            spoil(&mut data, &mut self.random);
        }
        let jitter: f64 = StandardNormal.sample(&mut self.random);
        let late_s = self.truth.latency_s + self.truth.jitter_s * jitter - self.exposure_s / 2.0;
        let stamp = exposed.plus_seconds(late_s);
        let (width_px, height_px) = picture.dimensions();
        self.last_picture = Some(picture);
        Ok(CameraImage {
            sequence,
            stamp,
            mid_exposure: stamp.plus_seconds(self.info.mid_exposure_offset_s),
            damaged: false,
            width_px,
            height_px,
            encoding: self.info.encoding,
            data,
        })
    }

    fn stop(&mut self) {
        self.first = None;
    }
}

fn encode(picture: &GrayImage, encoding: Encoding) -> Result<Vec<u8>, String> {
    let (width, height) = picture.dimensions();
    let grey = image::ExtendedColorType::L8;
    let mut bytes = Vec::new();
    match encoding {
        Encoding::Grey => bytes.clone_from(picture.as_raw()),
        Encoding::Yuyv => bytes.extend(picture.as_raw().iter().flat_map(|&luma| [luma, 128])),
        Encoding::Jpeg => image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
            .write_image(picture.as_raw(), width, height, grey)
            .map_err(|error| error.to_string())?,
        Encoding::Png => image::codecs::png::PngEncoder::new(&mut bytes)
            .write_image(picture.as_raw(), width, height, grey)
            .map_err(|error| error.to_string())?,
    }
    Ok(bytes)
}

/// Overwrites a stretch with noise, and cuts every other image short.
fn spoil(data: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    if data.is_empty() {
        return;
    }
    let from = random.random_range(0..data.len());
    let to = (from + data.len() / 4 + 1).min(data.len());
    random.fill_bytes(&mut data[from..to]);
    if random.random_bool(0.5) {
        data.truncate(from);
    }
}

#[cfg(test)]
mod tests;
