//! A camera's latency, from the sync LED in a film: one that is made now, or that of a recorded run.

use std::path::Path;

use anyhow::anyhow;

use super::{Failure, Watcher, on_threads};
use crate::calibrate::latency::{Film, Latency, LatencyError};
use crate::camera::{Camera, CameraConfig, CameraError, CameraImage, decode};
use crate::clock::{ClockFit, MonotonicNs, Ping, Wire};
use crate::config::RigConfig;
use crate::record::folder::{RunFolder, file};
use crate::record::reader::{Item, Recording};
use crate::run::open;
use crate::servo::{ServoBoard, ServoConfig, ServoEvent};

/// More than this is not kept of a film \[bytes\]: what comes after it is left out.
const MOST_BYTES: usize = 256 << 20;

/// What was filmed, and with which settings.
pub struct Filmed {
    film: Film,
    pings: Vec<Ping>,
    wire: Wire,
    camera: CameraConfig,
}

/// What the sync LED says of a camera as it is set up.
pub struct Measured {
    /// What the film says beyond what the config takes back already.
    pub beyond: Latency,
    /// What `[camera] latency_s` should be \[s\].
    pub latency_s: f64,
    /// What it was \[s\].
    pub configured_s: f64,
    /// Standard deviation of the board's clock \[s\]; an error of it is in the servo's times too, and cancels.
    pub clock_sigma_s: f64,
}

impl Filmed {
    fn new(config: &RigConfig) -> Self {
        let wire = config.servo.as_ref().map_or(Wire::NONE, ServoConfig::wire);
        Self { film: Film::default(), pings: Vec::new(), wire, camera: config.camera.clone() }
    }

    /// Opens what `config` names and films for `film_s`. Nothing moves.
    ///
    /// # Errors
    /// [`Failure::Hardware`] where camera or board fail, [`Failure::Input`] where there is no board.
    pub fn now(
        config: &RigConfig,
        base: &Path,
        film_s: f64,
        watcher: &mut dyn Watcher,
    ) -> Result<Self, Failure> {
        let mut opened = open::open(config, base).map_err(Failure::hardware)?;
        let Some(mut board) = opened.board.take() else {
            return Err(Failure::Input(anyhow!(
                "the config has no servo board, whose sync LED tells the time: add the table [servo]"
            )));
        };
        opened.begin(MonotonicNs::now());
        let mut filmed = Self::new(config);
        let made = filmed.make(opened.camera.as_mut(), board.as_mut(), film_s, watcher);
        opened.camera.stop();
        board.stop();
        watcher.clear();
        made.map(|()| filmed)
    }

    fn make(
        &mut self,
        camera: &mut dyn Camera,
        board: &mut dyn ServoBoard,
        film_s: f64,
        watcher: &mut dyn Watcher,
    ) -> Result<(), Failure> {
        let stall = self.camera.stall();
        camera.start().map_err(Failure::hardware)?;
        let until = MonotonicNs::now().plus_seconds(film_s);
        watcher.begin("images", Some((film_s * camera.info().fps) as u64));
        while MonotonicNs::now() < until && self.film.bytes() < MOST_BYTES {
            match camera.next_image(stall) {
                Ok(image) => self.image(&image)?,
                Err(CameraError::End) => break,
                Err(error) => return Err(Failure::hardware(error)),
            }
            board.poll().map_err(Failure::hardware)?.iter().for_each(|event| self.told(event));
            watcher.step(self.film.images() as u64);
        }
        Ok(())
    }

    /// What `run` recorded.
    ///
    /// # Errors
    /// [`Failure::Input`] where it cannot be read.
    pub fn of(run: &RunFolder, watcher: &mut dyn Watcher) -> Result<Self, Failure> {
        let config = RigConfig::parse(&run.start().config, &run.file(file::START)).map_err(Failure::input)?;
        let mut filmed = Self::new(&config);
        let mut recording = Recording::open(&run.file(file::RECORDING)).map_err(Failure::input)?;
        watcher.begin("images", None);
        for item in recording.by_ref() {
            match item.map_err(Failure::input)?.1 {
                Item::Image(image) if filmed.film.bytes() < MOST_BYTES => {
                    filmed.image(&image)?;
                    watcher.step(filmed.film.images() as u64);
                }
                Item::Servo(event) => filmed.told(&event),
                Item::Image(_) | Item::Command(_) => {}
            }
        }
        watcher.clear();
        recording.warn_if_cut_off();
        Ok(filmed)
    }

    fn image(&mut self, image: &CameraImage) -> Result<(), Failure> {
        match decode::grey(image) {
            Ok(picture) => self.film.take(&picture, image.mid_exposure).map_err(Failure::data),
            // A damaged image says nothing of the LED; the film goes on.
            Err(_) => Ok(()),
        }
    }

    fn told(&mut self, event: &ServoEvent) {
        self.pings.extend(event.ping());
    }

    /// What it says, worked out on so many threads.
    ///
    /// # Errors
    /// [`Failure::Data`]: no LED in the picture, or too short a film.
    pub fn measured(&self, threads: usize) -> Result<Measured, Failure> {
        let (clock, last) = match (ClockFit::new(&self.pings, self.wire), self.pings.last()) {
            (Some(clock), Some(last)) => (clock, last.received),
            _ => return Err(Failure::data(LatencyError::NoClock)),
        };
        let exposure_s = self.camera.exposure_s.map(|exposure| exposure.get());
        let mut beyond =
            on_threads(threads, || self.film.latency(&clock, exposure_s).map_err(Failure::data))?;
        // An image's time is that of its first row, and a camera that reads row by row exposes the LED's later.
        let row = beyond.place_px[1] / f64::from(self.camera.height_px);
        beyond.late_s += row * self.camera.readout_s.get();
        let configured_s = self.camera.latency_s.get();
        Ok(Measured {
            latency_s: configured_s + beyond.late_s,
            configured_s,
            clock_sigma_s: clock.sigma_s(last),
            beyond,
        })
    }
}
