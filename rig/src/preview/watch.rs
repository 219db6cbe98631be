//! The camera's images, measured and drawn, as they come.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, GrayImage, Rgb, RgbImage};
use serde::Serialize;
use tokio::sync::watch;

use super::flicker::{Flicker, flicker};
use super::measures::{GreyRange, Saturation, edge_width_px, grey_range, mean_grey, saturation};
use camera::{Camera, CameraError, CameraImage, CameraInfo, decode, images_lost};
use config::RigConfig;
use ground::clock::MonotonicNs;
use ground::error_chain::with_causes;
use run::RunError;
use run::open;
use vision::standing_out::{StandingOut, standing_out};

/// Images that may wait to be measured; further ones are skipped. Chosen.
const IMAGE_QUEUE_CAPACITY: usize = 32;
/// Time between two pictures for the page. Chosen.
const PICTURE_INTERVAL: Duration = Duration::from_millis(160);
/// Length of the window for flicker \[s\], and images in it at most. Chosen.
const FLICKER_WINDOW_S: f64 = 2.5;
const FLICKER_IMAGES_MAX: usize = 512;
/// Images over which the rate is averaged. Chosen.
const RATE_IMAGES: usize = 64;
/// Timeout of a call to the camera, and the delay of an end by it. Chosen.
const CAMERA_POLL_TIMEOUT: Duration = Duration::from_millis(200);
/// Time after which a lost camera is opened again. Chosen.
const CAMERA_RETRY_DELAY: Duration = Duration::from_secs(1);
const JPEG_QUALITY: u8 = 85;

/// Tints: of what stands out, and of what the static mask covers.
const PART_RGB: [u16; 3] = [30, 220, 120];
const MASKED_RGB: [u16; 3] = [220, 60, 220];

/// What is known of the camera apart from its pictures.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Rolling {
    /// The camera and its settings.
    pub camera: Option<CameraInfo>,
    /// Images a second, as received.
    pub fps: Option<f64>,
    /// Images received.
    pub received: u64,
    /// Images that the camera counted and never handed over.
    pub lost: u64,
    /// Images that were received and not measured: this machine is too slow for all of them.
    pub skipped: u64,
    /// The camera's current error.
    pub error: Option<String>,
}

/// The measures of a picture.
#[derive(Debug, Clone, Serialize)]
pub struct Measures {
    /// See [`edge_width_px`].
    pub edge_width_px: Option<f64>,
    /// The narrowest so far.
    pub best_edge_width_px: Option<f64>,
    /// See [`saturation`].
    pub saturation: Option<Saturation>,
    /// See [`grey_range`].
    pub grey: Option<GreyRange>,
    /// See [`flicker`]; of the last seconds.
    pub flicker: Option<Flicker>,
    /// Length of the window that flicker was measured over \[s\].
    pub flicker_s: f64,
    /// Area that stands out from the background \[px\].
    pub parts_px: Option<usize>,
    /// Why that is not known.
    pub no_parts: Option<String>,
    /// Area that the static mask covers \[px\].
    pub masked_px: Option<usize>,
}

/// One picture for the page.
#[derive(Debug, Clone)]
pub struct Picture {
    /// The camera's count.
    pub sequence: u32,
    /// Width and height \[px\].
    pub size_px: [u32; 2],
    /// The picture as a JPEG file.
    pub plain: Vec<u8>,
    /// The same, with what stands out and what is masked tinted.
    pub marked: Vec<u8>,
    /// Its measures, or why it cannot be read.
    pub measures: Result<Measures, String>,
}

/// State shared by both threads and the page.
#[derive(Debug, Default)]
struct Shared {
    stop: AtomicBool,
    received: AtomicU64,
    lost: AtomicU64,
    skipped: AtomicU64,
    /// Camera, rate, error.
    status: Mutex<(Option<CameraInfo>, Option<f64>, Option<String>)>,
}

impl Shared {
    fn status(&self) -> MutexGuard<'_, (Option<CameraInfo>, Option<f64>, Option<String>)> {
        self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// The camera being looked through. Dropping it ends that and lets go of the camera.
pub struct Watch {
    shared: Arc<Shared>,
    pictures: watch::Receiver<Option<Arc<Picture>>>,
    threads: Vec<JoinHandle<()>>,
}

impl Watch {
    /// Looks through the camera of `config`, whose relative paths start at `base`. One that goes away later is tried again.
    ///
    /// # Errors
    /// [`RunError`] where it cannot be opened.
    pub fn start(config: RigConfig, base: &Path) -> Result<Self, RunError> {
        let camera = open::camera(&config, base)?;
        let shared = Arc::new(Shared::default());
        let (hand_over, images) = sync_channel(IMAGE_QUEUE_CAPACITY);
        let (show, pictures) = watch::channel(None);
        let looker = Looker { config: config.clone(), base: base.into(), shared: Arc::clone(&shared), show };
        let roller = Roller { config, base: base.into(), shared: Arc::clone(&shared), hand_over };
        let threads = vec![
            std::thread::spawn(move || roller.roll(camera)),
            std::thread::spawn(move || looker.look(&images)),
        ];
        Ok(Self { shared, pictures, threads })
    }

    /// What is known of the camera apart from its pictures.
    pub fn rolling(&self) -> Rolling {
        let (camera, fps, error) = self.shared.status().clone();
        let count = |count: &AtomicU64| count.load(Ordering::Relaxed);
        Rolling {
            camera,
            fps,
            error,
            received: count(&self.shared.received),
            lost: count(&self.shared.lost),
            skipped: count(&self.shared.skipped),
        }
    }

    /// The latest picture, once there is one.
    pub fn picture(&self) -> Option<Arc<Picture>> {
        self.pictures.borrow().clone()
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // One that panicked has nothing more to say than it has on standard error.
            let _ = thread.join();
        }
    }
}

/// Takes the camera's images without waiting for the measuring thread.
struct Roller {
    config: RigConfig,
    base: PathBuf,
    shared: Arc<Shared>,
    hand_over: SyncSender<CameraImage>,
}

impl Roller {
    fn roll(&self, mut camera: Box<dyn Camera>) {
        loop {
            let ended = self.stream(camera.as_mut());
            camera.stop();
            // A device must be closed before it can be opened again.
            drop(camera);
            let Err(error) = ended else { return };
            self.set_error(with_causes(&error));
            camera = loop {
                let until = Instant::now() + CAMERA_RETRY_DELAY;
                while Instant::now() < until {
                    if self.shared.stopped() {
                        return;
                    }
                    std::thread::sleep(CAMERA_POLL_TIMEOUT / 4);
                }
                match open::camera(&self.config, &self.base) {
                    Ok(camera) => break camera,
                    Err(error) => self.set_error(with_causes(&error)),
                }
            };
        }
    }

    fn set_error(&self, error: String) {
        let mut status = self.shared.status();
        (status.1, status.2) = (None, Some(error));
    }

    /// Until it is told to stop, or the camera ends.
    fn stream(&self, camera: &mut dyn Camera) -> Result<(), CameraError> {
        camera.start()?;
        self.shared.status().0 = Some(camera.info().clone());
        let stall = self.config.camera.stall();
        let mut last_image = Instant::now();
        let mut last: Option<u32> = None;
        let mut taken: VecDeque<MonotonicNs> = VecDeque::new();
        while !self.shared.stopped() {
            let image = match camera.next_image(CAMERA_POLL_TIMEOUT.min(stall)) {
                Ok(image) => image,
                Err(CameraError::Stalled { camera, .. }) => {
                    if last_image.elapsed() > stall {
                        let waited_ms = last_image.elapsed().as_millis() as u64;
                        self.set_error(CameraError::Stalled { camera, waited_ms }.to_string());
                    }
                    continue;
                }
                Err(error) => return Err(error),
            };
            last_image = Instant::now();
            self.shared.received.fetch_add(1, Ordering::Relaxed);
            let lost = last.map_or(0, |last| images_lost(last, image.sequence));
            self.shared.lost.fetch_add(u64::from(lost), Ordering::Relaxed);
            last = Some(image.sequence);
            taken.push_back(image.mid_exposure);
            if taken.len() > RATE_IMAGES {
                taken.pop_front();
            }
            let mut status = self.shared.status();
            (status.1, status.2) = (rate(&taken), None);
            drop(status);
            if let Err(TrySendError::Full(_)) = self.hand_over.try_send(image) {
                self.shared.skipped.fetch_add(1, Ordering::Relaxed);
            }
        }
        Ok(())
    }
}

/// Images a second of those taken at these times.
fn rate(taken: &VecDeque<MonotonicNs>) -> Option<f64> {
    let span_s = taken.back()?.seconds_since(*taken.front()?);
    (span_s > 0.0).then(|| (taken.len() - 1) as f64 / span_s)
}

/// Measures images and draws some of them.
struct Looker {
    config: RigConfig,
    base: PathBuf,
    shared: Arc<Shared>,
    show: watch::Sender<Option<Arc<Picture>>>,
}

impl Looker {
    fn look(&self, images: &Receiver<CameraImage>) {
        let mut means: VecDeque<(f64, f64)> = VecDeque::new();
        let mut best = None;
        let (mut origin, mut shown) = (None, None::<Instant>);
        loop {
            let image = match images.recv_timeout(CAMERA_POLL_TIMEOUT) {
                Ok(image) => image,
                Err(RecvTimeoutError::Timeout) if !self.shared.stopped() => continue,
                Err(_) => return,
            };
            let grey = decode::grey(&image).map_err(|error| with_causes(&error));
            if let Some(mean) = grey.as_ref().ok().and_then(mean_grey) {
                let time_s = image.mid_exposure.seconds_since(*origin.get_or_insert(image.mid_exposure));
                // a camera that was opened again may count from the start
                if means.back().is_some_and(|(last, _)| time_s <= *last) {
                    means.clear();
                }
                means.push_back((time_s, mean));
                while means.len() > FLICKER_IMAGES_MAX || means[0].0 < time_s - FLICKER_WINDOW_S {
                    means.pop_front();
                }
            }
            if shown.is_some_and(|shown| shown.elapsed() < PICTURE_INTERVAL) {
                continue;
            }
            shown = Some(Instant::now());
            let picture = match grey {
                Ok(grey) => self.picture(image.sequence, &grey, means.make_contiguous(), &mut best),
                Err(why) => self.unreadable(image.sequence, why),
            };
            // it does not matter whether anybody receives it
            let _ = self.show.send(Some(Arc::new(picture)));
        }
    }

    fn picture(
        &self,
        sequence: u32,
        grey: &GrayImage,
        means: &[(f64, f64)],
        best: &mut Option<f64>,
    ) -> Picture {
        let detected = standing_out(grey, &self.config.vision, &self.base);
        let edge_width_px = edge_width_px(grey);
        *best = [*best, edge_width_px].into_iter().flatten().reduce(f64::min);
        let parts = detected.as_ref().map(|detected| detected.parts.as_ref());
        let measures = Measures {
            edge_width_px,
            best_edge_width_px: *best,
            saturation: saturation(grey),
            grey: grey_range(grey),
            flicker: flicker(means),
            flicker_s: means.last().zip(means.first()).map_or(0.0, |(last, first)| last.0 - first.0),
            parts_px: parts.as_ref().ok().and_then(|parts| Some(parts.ok()?.area())),
            no_parts: match parts {
                Ok(parts) => parts.err().cloned(),
                Err(error) => Some(with_causes(error)),
            },
            masked_px: detected.as_ref().ok().and_then(|detected| Some(detected.masked.as_ref()?.area())),
        };
        Picture {
            sequence,
            size_px: grey.dimensions().into(),
            plain: jpeg(grey.clone().into()),
            marked: jpeg(marked(grey, detected.as_ref().ok()).into()),
            measures: Ok(measures),
        }
    }

    /// The picture before stays; what is wrong with this one is reported.
    fn unreadable(&self, sequence: u32, why: String) -> Picture {
        let before = self.show.borrow().clone();
        let (size_px, plain, marked) =
            before.map_or_else(Default::default, |p| (p.size_px, p.plain.clone(), p.marked.clone()));
        Picture { sequence, size_px, plain, marked, measures: Err(why) }
    }
}

fn jpeg(picture: DynamicImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    match picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)) {
        Ok(()) => bytes,
        // Only an empty picture cannot be one.
        Err(_) => Vec::new(),
    }
}

/// The picture with what stands out, and what is masked, tinted.
fn marked(grey: &GrayImage, detected: Option<&StandingOut>) -> RgbImage {
    let mut picture =
        RgbImage::from_fn(grey.width(), grey.height(), |x, y| Rgb([grey.get_pixel(x, y).0[0]; 3]));
    let Some(detected) = detected else { return picture };
    for (mask, tint) in [(detected.parts.as_ref().ok(), PART_RGB), (detected.masked.as_ref(), MASKED_RGB)] {
        for (column, row) in mask.iter().flat_map(|mask| mask.pixels()) {
            if let Some(pixel) = picture.get_pixel_mut_checked(column as u32, row as u32) {
                for (channel, tint) in pixel.0.iter_mut().zip(tint) {
                    *channel = ((u16::from(*channel) * 3 + tint * 2) / 5) as u8;
                }
            }
        }
    }
    picture
}
