//! A camera's latency, from the sync LED in a film that is made now or was recorded in a run.

use std::fmt;
use std::path::Path;

use anyhow::anyhow;
use ident::table::{read_servo, read_trajectory};

use super::{Failure, Watcher, on_threads};
use calibrate::latency::link::{Followed, Following, following};
use calibrate::latency::{Film, Latency, LatencyError};
use camera::{Camera, CameraConfig, CameraError, CameraImage, decode};
use config::RigConfig;
use ground::clock::{ClockFit, MonotonicNs, Ping, Wire};
use record::folder::{RunFolder, file};
use record::reader::{Item, Recording};
use run::open;
use servo::{ServoBoard, ServoConfig, ServoEvent};

/// Memory for a film at most \[bytes\]; later images are left out. Chosen.
const FILM_LIMIT_BYTES: usize = 256 << 20;

/// A film of the sync LED, the board's pings, and the settings of the camera.
pub struct Filmed {
    film: Film,
    pings: Vec<Ping>,
    wire: Wire,
    camera: CameraConfig,
}

/// The latency of a camera as measured by the sync LED.
pub struct Measured {
    /// Latency in addition to the one that the config states already.
    pub beyond: Latency,
    /// What `[camera] latency_s` should be \[s\].
    pub latency_s: f64,
    /// What it is in the config \[s\].
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
        let mut opened = open::open(config, base, None).map_err(Failure::of_run)?;
        let Some(mut board) = opened.board.take() else {
            return Err(Failure::Input(anyhow!(
                "the config has no servo board, whose sync LED tells the time: add the table [servo]"
            )));
        };
        opened.begin(MonotonicNs::now());
        let mut filmed = Self::new(config);
        let made = filmed.make(opened.camera.as_mut(), board.as_mut(), film_s, watcher);
        opened.camera.stop();
        board.leave();
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
        while MonotonicNs::now() < until && self.film.bytes() < FILM_LIMIT_BYTES {
            match camera.next_image(stall) {
                Ok(image) => self.image(&image)?,
                Err(CameraError::End) => break,
                Err(error) => return Err(Failure::hardware(error)),
            }
            board.poll().map_err(Failure::hardware)?.iter().for_each(|event| self.servo_event(event));
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
                Item::Image(image) if filmed.film.bytes() < FILM_LIMIT_BYTES => {
                    filmed.image(&image)?;
                    watcher.step(filmed.film.images() as u64);
                }
                Item::Servo(event) => filmed.servo_event(&event),
                Item::Image(_) | Item::Command(_) | Item::Gap => {}
            }
        }
        watcher.clear();
        recording.warn_of_shortfall();
        Ok(filmed)
    }

    fn image(&mut self, image: &CameraImage) -> Result<(), Failure> {
        match decode::grey(image) {
            Ok(picture) => self.film.take(&picture, image.mid_exposure).map_err(Failure::data),
            // A damaged image says nothing of the LED; the film goes on.
            Err(_) => Ok(()),
        }
    }

    fn servo_event(&mut self, event: &ServoEvent) {
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

/// The latency of a camera as measured by the driven link of a run.
pub struct MeasuredByLink {
    following: Following,
    /// Whether the link was compared with the servo's measured angle, not with its command.
    measured: bool,
    /// What `[camera] latency_s` should be \[s\].
    pub latency_s: f64,
    /// How well that is known, 1 sigma \[s\].
    pub std_s: f64,
}

/// Time between the pulses of a servo \[s\]: it looks at one and acts, half of that after its command on average.
const PULSE_PERIOD_S: f64 = 0.02;

/// The camera's latency from how the first link of `run`, a driven one that was extracted, follows the servo.
///
/// # Errors
/// [`Failure::Input`] where there are no tables, [`Failure::Data`] where they do not tell.
pub fn by_link(run: &RunFolder) -> Result<MeasuredByLink, Failure> {
    let config = RigConfig::parse(&run.start().config, &run.file(file::START)).map_err(Failure::input)?;
    let trajectory = read_trajectory(&run.file(file::TRAJECTORY)).map_err(Failure::input)?;
    let table = read_servo(&run.file(file::SERVO)).map_err(Failure::input)?;
    let (command, measured) = (table.command, table.measured);
    let lacks = |what: &str| Failure::Data(anyhow!("run {}: {what}", run.path().display()));
    let place = |name: &str| trajectory.keypoints.iter().position(|keypoint| keypoint == name);
    let (Some(base), Some(end)) = (place("P0"), place("P1")) else {
        return Err(lacks("its trajectory has no P0 and P1, between which the driven link lies"));
    };
    let (mut time_s, mut angle_rad): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    for (row, &row_s) in trajectory.time_s.iter().enumerate() {
        let (from, to) = (trajectory.at(row, base), trajectory.at(row, end));
        let upward = if to[2].is_nan() { 1 } else { 2 };
        let angle = (to[upward] - from[upward]).atan2(to[0] - from[0]);
        if angle.is_finite() {
            let turns = angle_rad.last().map_or(0.0, |last| ((last - angle) / std::f64::consts::TAU).round());
            time_s.push(row_s);
            angle_rad.push(angle + turns * std::f64::consts::TAU);
        }
    }
    let measured = measured.iter().find(|angles| angles.time_s.len() > 10);
    let column: Vec<f64> = command.angle_rad.chunks(command.actuators.len()).map(|row| row[0]).collect();
    let followed = match measured {
        Some(measured) => Followed { time_s: &measured.time_s, angle_rad: &measured.angle_rad },
        None => Followed { time_s: &command.time_s, angle_rad: &column },
    };
    let following = following(followed, &time_s, &angle_rad, measured.is_none())
        .ok_or_else(|| lacks("neither servo nor link move enough to compare them"))?;
    // the delay of a servo until its next pulse is uniform over the pulse period
    let (wait_s, wait_std_s) = match measured {
        Some(_) => (0.0, 0.0),
        None => (PULSE_PERIOD_S / 2.0, PULSE_PERIOD_S / 12_f64.sqrt()),
    };
    Ok(MeasuredByLink {
        measured: measured.is_some(),
        latency_s: config.camera.latency_s.get() + following.delay_s - wait_s,
        std_s: following.std_s.hypot(wait_std_s).hypot(following.two_ways_s / 2.0),
        following,
    })
}

impl fmt::Display for MeasuredByLink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Following { delay_s, std_s, lag_s, gain, rms_rad, two_ways_s } = self.following;
        let whom = if self.measured { "the servo's own angle" } else { "the command" };
        write!(
            f,
            "the driven link follows {whom} {:.1} ms later, 1 sigma {:.1} ms, through a lag of {:.1} ms, with a gain of {gain:.3}; {:.1} mrad remain, \
             and the two ways of turning differ by {:.1} ms",
            delay_s * 1e3,
            std_s * 1e3,
            lag_s * 1e3,
            rms_rad * 1e3,
            two_ways_s * 1e3
        )?;
        if !self.measured {
            write!(
                f,
                "\n{:.0} ms of it are taken for the servo's own, which looks at its pulse every {:.0} ms: by how much that is wrong no film tells",
                PULSE_PERIOD_S * 5e2,
                PULSE_PERIOD_S * 1e3
            )?;
        }
        Ok(())
    }
}
