//! A camera at full rate through the whole recording path, while a servo plays its profile and a fit has the other core: camera
//! thread, coordinator, queue, zstd, disk. The camera hands out noisy pictures drawn beforehand, so that drawing takes no time from
//! what is looked at.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use camera::{Camera, CameraError, CameraImage, CameraInfo, Encoding};
use config::{MotionKind, RigConfig};
use ground::clock::MonotonicNs;
use nalgebra::DMatrix;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use record::recording::{Recorder, RecorderOptions};
use run::film::{Filmed, Setup, film};
use run::listener::Notice;
use run::machine::Plan;
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;
use servo::{self, MockOptions, PulseProfile, PulseSink, PulseTrack, ServoConfig, ServoEvent};

/// What is filmed.
#[derive(Debug, Clone, Copy)]
pub struct Soak {
    /// Image width and height \[px\].
    pub size_px: (u32, u32),
    /// Images a second.
    pub fps: f64,
    /// Grey or yuyv.
    pub encoding: Encoding,
    /// Standard deviation of a pixel's noise \[grey levels\].
    pub noise_grey: f64,
    /// Length of the servo's profile \[s\].
    pub profile_s: f64,
}

/// The result of a soak.
#[derive(Debug, Clone, Serialize)]
pub struct SoakResult {
    /// How it ended and what the recording holds.
    #[serde(skip)]
    pub filmed: Filmed,
    /// Images recorded.
    pub images: u64,
    /// Images that the camera counted and the program was too late for.
    pub images_lost: u64,
    /// Images that did not fit into the recording's queue.
    pub dropped: u64,
    /// Bytes of the images as received.
    pub received_bytes: u64,
    /// Bytes on the disk.
    pub recorded_bytes: u64,
    /// The most that waited for zstd and the disk \[bytes\].
    pub most_waiting_bytes: u64,
    /// How often the recording was said to fall behind.
    pub fell_behind: u64,
    /// How much longer the profile took on the board's clock than it should \[µs\].
    pub profile_late_us: i64,
    /// The longest that a thread which looks at the clock every 5 ms was kept from it \[s\]: what the machine itself lacks.
    pub longest_pause_s: f64,
    /// Resident memory of the process before the first image \[bytes\].
    pub resident_before_bytes: u64,
    /// And every second from then on \[bytes\].
    pub resident_bytes: Vec<u64>,
    /// Processor time of the whole process, the fit left out \[s\].
    pub processor_s: f64,
}

impl Soak {
    /// Bytes that may wait for zstd and the disk.
    pub fn queue_bytes(&self) -> usize {
        RecorderOptions::of(&self.info()).queue_bytes
    }

    fn info(&self) -> CameraInfo {
        CameraInfo {
            name: "soak".into(),
            width_px: self.size_px.0,
            height_px: self.size_px.1,
            fps: self.fps,
            encoding: self.encoding,
            mid_exposure_offset_s: 0.0,
        }
    }

    /// Records into `path`, which must not exist.
    ///
    /// # Panics
    /// Where anything but the filming itself fails: this is for tests.
    pub fn endure(&self, path: &Path) -> SoakResult {
        let camera = Drawn::new(self);
        let profile = self.profile();
        let plan = Plan {
            kind: MotionKind::Driven,
            approach_s: 0.5,
            settle_s: 0.3,
            film_s: 0.5,
            profile_s: profile.duration_us() as f64 * 1e-6,
            lead_s: 0.4,
            release_timeout_s: 60.0,
            // Noise changes every pixel.
            still_share: 2.0,
        };
        let rig = RigConfig::read(&crate::config("chain-driven-pose-1.toml")).expect("a shipped config");
        // A shared machine may pause for longer than any board at a tank may wait.
        let config = ServoConfig { dead_man_ms: 2000, ..rig.servo.expect("a servo") };
        let opening = servo::Opening {
            config: &config,
            mock: (MockOptions::default(), Box::new(Nowhere)),
            bus: None,
            replay: None,
        };
        let board = servo::open(opening).expect("a mock board");
        let recorder = Recorder::create(path, Some(&self.info()), RecorderOptions::of(&self.info()))
            .expect("a recording");
        let (mut started_us, mut finished_us, mut fell_behind) = (None, None, 0);
        let setup = Setup {
            plan,
            camera: Box::new(camera),
            stall: Duration::from_secs(2),
            drive: Some((board, profile.clone())),
            recorder,
        };
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .enable_time()
            .build()
            .expect("a runtime");
        let resident_before_bytes = resident_bytes();
        let processor_before_s = processor_s(ClockId::ProcessCPUTime);
        let beside = Beside::start();
        let mut listener = |notice: &Notice| match notice {
            Notice::Servo(ServoEvent::Started { board_tick_us }) => started_us = Some(*board_tick_us),
            Notice::Servo(ServoEvent::Finished { board_tick_us }) => finished_us = Some(*board_tick_us),
            Notice::FallsBehind(_) => fell_behind += 1,
            _ => {}
        };
        let filmed = runtime.block_on(film(setup, std::future::pending(), &mut listener));
        let Watched { resident_bytes, longest_pause_s, fit_s } = beside.stop();
        let took_us = started_us.zip(finished_us).map(|(started, finished): (u64, u64)| finished - started);
        let recorded = filmed.recorded;
        let pixels = u64::from(self.size_px.0) * u64::from(self.size_px.1);
        SoakResult {
            images: recorded.images,
            images_lost: filmed.images.lost,
            dropped: recorded.dropped,
            received_bytes: recorded.images * self.encoding.bytes(pixels),
            recorded_bytes: recorded.bytes,
            most_waiting_bytes: recorded.most_waiting_bytes,
            fell_behind,
            profile_late_us: took_us.map_or(i64::MAX, |took| took as i64 - profile.duration_us() as i64),
            longest_pause_s,
            resident_before_bytes,
            resident_bytes,
            processor_s: processor_s(ClockId::ProcessCPUTime) - processor_before_s - fit_s,
            filmed,
        }
    }

    /// Strokes of 2:1, no more than twenty pairs of them.
    fn profile(&self) -> PulseProfile {
        let pairs = (self.profile_s / 1.5).ceil().min(20.0);
        let pair_us = self.profile_s * 1e6 / pairs;
        let strokes = [((pair_us * 2.0 / 3.0) as u32, 1700), ((pair_us / 3.0) as u32, 1300)];
        PulseProfile {
            tracks: vec![PulseTrack {
                channel: 0,
                start_pulse: 1300,
                segments: strokes.repeat(pairs as usize),
            }],
        }
    }
}

/// Pulses that move nothing.
struct Nowhere;

impl PulseSink for Nowhere {
    fn pulse(&mut self, _: u8, _: Option<u16>, _: MonotonicNs) {}
}

/// How many pictures are drawn beforehand: zstd, which looks back over half a megabyte, never meets one again.
const DRAWN_PICTURES: u32 = 16;
/// Images that wait for the program before some are lost: fewer than a driver has.
const BUFFERED_IMAGES: u32 = 4;

/// A camera that shows pictures drawn beforehand, on time, and loses those that nobody takes.
struct Drawn {
    info: CameraInfo,
    pictures: Vec<Vec<u8>>,
    begin: MonotonicNs,
    next: u32,
}

impl Drawn {
    fn new(soak: &Soak) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let (width, height) = soak.size_px;
        let picture = |number: u32| -> Vec<u8> {
            // A dark bar that swings in light which falls off towards the corners.
            let angle = 0.5 * (f64::from(number) / f64::from(DRAWN_PICTURES) * std::f64::consts::TAU).sin();
            let (across, along) = (angle.cos(), angle.sin());
            let mut bytes = Vec::with_capacity(soak.encoding.bytes(u64::from(width * height)) as usize);
            for pixel in 0..width * height {
                let x = f64::from(pixel % width) / f64::from(width) - 0.5;
                let y = f64::from(pixel / width) / f64::from(height) - 0.5;
                let dark = (x * across + y * along).abs() < 0.02 && y.abs() < 0.3;
                let light = if dark { 40.0 } else { 200.0 * (1.0 - 0.6 * (x * x + y * y)) };
                let mut noisy = |grey: f64, sigma: f64| -> u8 {
                    let noise: f64 = StandardNormal.sample(&mut random);
                    (grey + sigma * noise).round() as u8
                };
                bytes.push(noisy(light, soak.noise_grey));
                if soak.encoding == Encoding::Yuyv {
                    bytes.push(noisy(128.0, soak.noise_grey / 2.0));
                }
            }
            bytes
        };
        let pictures = (0..DRAWN_PICTURES).map(picture).collect();
        Self { info: soak.info(), pictures, begin: MonotonicNs(0), next: 0 }
    }
}

impl Camera for Drawn {
    fn info(&self) -> &CameraInfo {
        &self.info
    }

    fn start(&mut self) -> Result<(), CameraError> {
        self.begin = MonotonicNs::now();
        Ok(())
    }

    fn next_image(&mut self, _: Duration) -> Result<CameraImage, CameraError> {
        let due = |sequence: u32| self.begin.plus_seconds(f64::from(sequence) / self.info.fps);
        let now = MonotonicNs::now();
        let elapsed = (now.seconds_since(self.begin) * self.info.fps) as u32;
        if elapsed > self.next + BUFFERED_IMAGES {
            self.next = elapsed - 1;
        }
        let stamp = due(self.next);
        std::thread::sleep(Duration::from_nanos(stamp.0.saturating_sub(now.0)));
        self.next += 1;
        let data = self.pictures[(self.next % DRAWN_PICTURES) as usize].clone();
        Ok(CameraImage {
            sequence: self.next,
            stamp,
            mid_exposure: stamp,
            damaged: false,
            width_px: self.info.width_px,
            height_px: self.info.height_px,
            encoding: self.info.encoding,
            data,
        })
    }

    fn stop(&mut self) {}
}

/// How far behind the devices' threads a fit beside the filming is, as `nice` counts.
const NICENESS: i32 = 19;
/// Interval at which memory and clock are read. Chosen.
const SAMPLE_INTERVAL: Duration = Duration::from_millis(5);

/// What goes on beside the filming: a thread that computes all the time, as a fit does, and one that looks at memory and clock.
struct Beside {
    over: Arc<AtomicBool>,
    fit: std::thread::JoinHandle<f64>,
    watch: std::thread::JoinHandle<(Vec<u64>, f64)>,
}

/// What was seen meanwhile.
struct Watched {
    resident_bytes: Vec<u64>,
    longest_pause_s: f64,
    /// Processor time of the fit.
    fit_s: f64,
}

impl Beside {
    fn start() -> Self {
        let over = Arc::new(AtomicBool::new(false));
        let (fit_over, watch_over) = (Arc::clone(&over), Arc::clone(&over));
        let fit = std::thread::spawn(move || {
            // Without it the load is merely less polite.
            let _ = rustix::process::nice(NICENESS);
            let matrix = DMatrix::<f64>::identity(120, 120);
            while !fit_over.load(Ordering::Relaxed) {
                std::hint::black_box(std::hint::black_box(&matrix) * &matrix);
            }
            processor_s(ClockId::ThreadCPUTime)
        });
        let watch = std::thread::spawn(move || {
            let (begin, mut last) = (MonotonicNs::now(), MonotonicNs::now());
            let (mut resident, mut longest_pause_s) = (Vec::new(), 0.0_f64);
            while !watch_over.load(Ordering::Relaxed) {
                if last.seconds_since(begin) >= resident.len() as f64 {
                    resident.push(resident_bytes());
                }
                std::thread::sleep(SAMPLE_INTERVAL);
                let now = MonotonicNs::now();
                longest_pause_s =
                    longest_pause_s.max(now.seconds_since(last) - SAMPLE_INTERVAL.as_secs_f64());
                last = now;
            }
            (resident, longest_pause_s)
        });
        Self { over, fit, watch }
    }

    fn stop(self) -> Watched {
        self.over.store(true, Ordering::Relaxed);
        let (resident_bytes, longest_pause_s) = self.watch.join().expect("a thread");
        Watched { resident_bytes, longest_pause_s, fit_s: self.fit.join().expect("a thread") }
    }
}

fn processor_s(clock: ClockId) -> f64 {
    let time = clock_gettime(clock);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Resident memory of this process.
fn resident_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux");
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("a resident size");
    let kibibytes: u64 = line.trim().trim_end_matches(" kB").parse().expect("a number");
    kibibytes * 1024
}
