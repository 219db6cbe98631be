//! A camera of v4l2loopback that shows the mock rig's tank.

use std::io::Write as _;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use camera::mock::{MockCamera, Scene, StampTruth};
use camera::{Camera as _, CameraConfig, Encoding};
use ground::clock::MonotonicNs;
use image::GrayImage;
use system_tests::wait_until;
use tank::Tank;
use tank::scene::TankScene;
use v4l::video::Output as _;
use v4l::video::output::Parameters;
use v4l::{Device, Format, FourCC};

use crate::bench::must;

/// Both ends of it: the feeder writes what cameras read.
pub(crate) const CAMERA: &str = "/dev/video9";
/// Longer than a busy guest keeps an image waiting.
const PATIENCE: Duration = Duration::from_secs(5);

/// What the feeder does with the next image.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(u8)]
pub(crate) enum Mode {
    /// Shows it.
    Film,
    /// Keeps it, and the camera waits.
    Stall,
    /// Shows the one before again.
    Freeze,
    /// Shows half of its bytes.
    Cut,
    /// Ends, and takes the camera away.
    End,
}

/// One image as it was shown.
#[derive(Debug, Clone)]
pub(crate) struct Shown {
    /// Before and after it was handed to the driver, which stamps it between the two.
    pub handed: [MonotonicNs; 2],
    /// Where the keypoints were, `[x, z]` \[m\].
    pub keypoints_m: Vec<[f64; 2]>,
    /// As the driver got it.
    pub data: Arc<Vec<u8>>,
}

/// Feeds the camera from a thread of its own.
pub(crate) struct Feeder {
    mode: Arc<AtomicU8>,
    shown: Arc<Mutex<Vec<Shown>>>,
    thread: Option<JoinHandle<()>>,
}

/// The tank, and what its pictures showed.
struct Watched {
    tank: Tank,
    scene: TankScene,
    keypoints_m: Arc<Mutex<Vec<[f64; 2]>>>,
}

impl Scene for Watched {
    fn picture(&mut self, at: MonotonicNs) -> Result<GrayImage, String> {
        let picture = self.scene.picture(at)?;
        let model = self.tank.model();
        let poses = model.poses(&self.tank.qpos(at).map_err(|error| error.to_string())?);
        let places = model.keypoint_sites().into_iter().map(|site| poses.site_pos[site]);
        *self.keypoints_m.lock().expect("no panic") = places.map(|at| [at[0], at[2]]).collect();
        Ok(picture)
    }
}

impl Feeder {
    /// Shows `tank` as a camera set up as `config` would.
    pub(crate) fn start(tank: &Tank, config: &CameraConfig) -> Self {
        must("modprobe", &["v4l2loopback", "devices=1", "video_nr=9", "exclusive_caps=1", "max_buffers=6"]);
        let fourcc = match config.format {
            Encoding::Grey => b"GREY",
            Encoding::Yuyv => b"YUYV",
            Encoding::Jpeg | Encoding::Png => b"MJPG",
        };
        let mut device = Device::with_path(CAMERA).expect("the camera's other end");
        let format = Format::new(config.width_px, config.height_px, FourCC::new(fourcc));
        let set = device.set_format(&format).expect("a format");
        assert_eq!((set.width, set.height, set.fourcc), (format.width, format.height, format.fourcc));
        let fps = config.fps().expect("a rate") as u32;
        device.set_params(&Parameters::with_fps(fps)).expect("a rate");

        let keypoints_m = Arc::new(Mutex::new(Vec::new()));
        let scene =
            Watched { tank: tank.clone(), scene: tank.scene(config), keypoints_m: Arc::clone(&keypoints_m) };
        let truth = StampTruth { latency_s: 0.0, jitter_s: 0.0, seed: 1 };
        let mut camera = MockCamera::new(config, Box::new(scene), truth, Vec::new()).expect("a camera");
        camera.start().expect("a mock camera starts");

        let (mode, shown) = (Arc::new(AtomicU8::new(Mode::Film as u8)), Arc::new(Mutex::new(Vec::new())));
        let (modes, shows) = (Arc::clone(&mode), Arc::clone(&shown));
        let thread = std::thread::spawn(move || {
            let mut last = Vec::new();
            loop {
                let image = camera.next_image(PATIENCE).expect("a picture of the tank");
                let mode = modes.load(Ordering::Relaxed);
                if mode == Mode::End as u8 {
                    return;
                }
                if mode == Mode::Stall as u8 {
                    continue;
                }
                if mode != Mode::Freeze as u8 {
                    last = image.data;
                }
                if mode == Mode::Cut as u8 {
                    last.truncate(last.len() / 2);
                }
                let keypoints_m = keypoints_m.lock().expect("no panic").clone();
                let before = MonotonicNs::now();
                device.write_all(&last).expect("the driver takes an image");
                let handed = [before, MonotonicNs::now()];
                let data = Arc::new(last.clone());
                shows.lock().expect("no panic").push(Shown { handed, keypoints_m, data });
            }
        });
        let feeder = Self { mode, shown, thread: Some(thread) };
        wait_until("the first images", 10.0, || feeder.shown.lock().expect("no panic").len() > 2);
        feeder
    }

    pub(crate) fn set(&self, mode: Mode) {
        self.mode.store(mode as u8, Ordering::Relaxed);
    }

    /// The image that the driver stamped at `stamp`.
    pub(crate) fn shown_at(&self, stamp: MonotonicNs) -> Option<Shown> {
        // The driver's stamps are whole microseconds.
        let [within, end] = [MonotonicNs(stamp.0 + 1000), stamp];
        let shown = self.shown.lock().expect("no panic");
        shown.iter().find(|shown| shown.handed[0] <= within && end <= shown.handed[1]).cloned()
    }
}

impl Drop for Feeder {
    fn drop(&mut self) {
        self.set(Mode::End);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
