//! The times in a recording: when each image was exposed, and the servo's commands and measured angles, all in the run's time.

use ident::table::{MeasuredAngles, read_servo};
use sim::Command;

use super::error::AnalysisError;
use camera::{CameraConfig, CameraImage, Rising, images_lost};
use config::RigConfig;
use ground::clock::{ClockFit, MonotonicNs, Ping, Wire};
use record::ServoCommand;
use record::folder::{RunFolder, file};
use record::frames::FrameRow;
use record::reader::{Item, Recording};
use report::ClockQuality;
use servo::profile::ProfileConfig;
use servo::{PulseProfile, ServoConfig, ServoEvent};

/// [`FrameRow::status`] of an image that gets a row in the trajectory, before the extraction judges it: an image that is not later
/// than the one before gets none, because the times of a trajectory must rise.
pub const USABLE: &str = "ok";

/// An image of the recording, without its bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageTime {
    /// Its place in the recording.
    pub index: u64,
    /// Its row of `frames.csv`.
    pub row: FrameRow,
}

/// A position that a servo on a bus reported, with the times of question and answer.
#[derive(Debug, Clone, Copy)]
struct PositionReading {
    channel: u8,
    count: i32,
    sent: MonotonicNs,
    received: MonotonicNs,
}

/// Collects images and servo events in recorded order, from the recording or while it is made, into a [`Timeline`].
#[derive(Debug, Clone)]
pub struct TimelineBuilder {
    origin: MonotonicNs,
    /// Latency to subtract from the images' times, in addition to what was subtracted when they were recorded \[s\].
    late_s: f64,
    images: Vec<ImageTime>,
    rising: Rising,
    last: Option<u32>,
    pings: Vec<Ping>,
    positions: Vec<PositionReading>,
    armed: Option<PulseProfile>,
    started_tick_us: Option<u64>,
}

impl TimelineBuilder {
    /// A builder for a run whose time counts from `origin`.
    pub fn new(origin: MonotonicNs) -> Self {
        Self {
            origin,
            late_s: 0.0,
            images: Vec::new(),
            rising: Rising::default(),
            last: None,
            pings: Vec::new(),
            positions: Vec::new(),
            armed: None,
            started_tick_us: None,
        }
    }

    /// The next image received.
    pub fn image(&mut self, image: &CameraImage) {
        let (status, reason) = match self.rising.takes(image.mid_exposure) {
            true => (USABLE, ""),
            false => ("rejected", "its stamp is not later than the one before"),
        };
        let row = FrameRow {
            sequence: image.sequence,
            time_s: image.mid_exposure.seconds_since(self.origin) - self.late_s,
            stamp_ns: image.stamp.0,
            damaged: image.damaged,
            lost_before: self.last.map_or(0, |last| images_lost(last, image.sequence)),
            status: status.into(),
            reason: reason.into(),
        };
        self.images.push(ImageTime { index: self.images.len() as u64, row });
        self.last = Some(image.sequence);
    }

    /// A part of the recording here cannot be read; image numbers missing across it do not count as lost.
    pub fn gap(&mut self) {
        self.last = None;
    }

    /// The next event of the board.
    pub fn servo(&mut self, event: &ServoEvent) {
        match *event {
            ServoEvent::Ping { sent, board_tick_us, received } => {
                self.pings.push(Ping { sent, board_tick_us, received });
            }
            ServoEvent::Position { channel, count, sent, received } => {
                self.positions.push(PositionReading { channel, count, sent, received });
            }
            ServoEvent::Started { board_tick_us } => self.started_tick_us = Some(board_tick_us),
            _ => {}
        }
    }

    /// The next command to the board.
    pub fn command(&mut self, command: &ServoCommand) {
        if let ServoCommand::Arm { profile, .. } = command {
            self.armed = Some(profile.clone());
        }
    }

    /// The rows of `frames.csv` so far.
    pub fn rows(&self) -> Vec<FrameRow> {
        self.images.iter().map(|image| image.row.clone()).collect()
    }

    /// The timeline of what was collected so far.
    ///
    /// # Errors
    /// [`AnalysisError`] when the channels of `config` are not those of the run.
    pub fn timeline(self, config: &RigConfig) -> Result<Timeline, AnalysisError> {
        let wire = config.servo.as_ref().map_or(Wire::NONE, ServoConfig::wire);
        let clock = ClockFit::new(&self.pings, wire);
        let measured = self.measured(config);
        let command = match (&config.servo, &config.profile, self.armed, self.started_tick_us, &clock) {
            (Some(servo), Some(profile), Some(pulses), Some(tick_us), Some(clock)) => {
                let start_s = clock.host(tick_us).seconds_since(self.origin);
                Some(pulses.command(servo, profile.is_mirrored(), start_s)?)
            }
            _ => None,
        };
        let clock_at = self.pings.last().map_or(self.origin, |ping| ping.received);
        let widths = self.positions.iter().map(|reading| reading.received.seconds_since(reading.sent));
        let feedback = (!measured.is_empty()).then(|| ClockQuality {
            name: "servo feedback".into(),
            // Any instant between question and answer is as likely as another.
            sigma_s: widths.sum::<f64>() / self.positions.len() as f64 / 12.0_f64.sqrt(),
            samples: self.positions.len(),
            drift_ppm: None,
        });
        let (images, shortfall) = (self.images, None);
        Ok(Timeline { images, clock, clock_at, command, measured, feedback, shortfall })
    }

    /// The angles that servos on a bus reported, timed half-way between question and answer.
    fn measured(&self, config: &RigConfig) -> Vec<MeasuredAngles> {
        let Some(servo) = &config.servo else { return Vec::new() };
        let mirrored = config.profile.as_ref().is_some_and(ProfileConfig::is_mirrored);
        let mut measured: Vec<MeasuredAngles> = Vec::new();
        for reading in &self.positions {
            let Some(channel) = servo.channel(reading.channel) else { continue };
            let Some(actuator) = &channel.actuator else { continue };
            let half_s = reading.received.seconds_since(reading.sent) / 2.0;
            let time_s = reading.sent.plus_seconds(half_s).seconds_since(self.origin);
            let known = measured.iter().position(|angles| angles.actuator == *actuator);
            let place = known.unwrap_or_else(|| {
                measured.push(MeasuredAngles { actuator: actuator.clone(), ..MeasuredAngles::default() });
                measured.len() - 1
            });
            let angles = &mut measured[place];
            if angles.time_s.last().is_none_or(|last| time_s > *last) {
                angles.time_s.push(time_s);
                angles.angle_rad.push(channel.angle_rad(f64::from(reading.count), mirrored));
            }
        }
        measured
    }
}

/// Difference between the latency that `config` states and the one that was subtracted when the images of `run` were recorded \[s\].
pub fn late_s(run: &RunFolder, config: &RigConfig) -> f64 {
    #[derive(serde::Deserialize)]
    struct MadeWith {
        camera: CameraConfig,
    }
    // if the run's config cannot be read any more, the times stay as they were recorded
    let made_with = toml::from_str::<MadeWith>(&run.start().config).map(|made| made.camera.latency_s);
    made_with.map_or(0.0, |then| config.camera.latency_s.get() - then.get())
}

/// The times of all images and of the servo's command, in the run's time.
#[derive(Debug, Clone)]
pub struct Timeline {
    /// All images in the order they were received.
    pub images: Vec<ImageTime>,
    /// The board's clock, where pings were recorded.
    pub clock: Option<ClockFit>,
    /// When the last ping was answered.
    clock_at: MonotonicNs,
    /// Commanded angles, where a profile was played.
    pub command: Option<Command>,
    /// Angles that the servos reported.
    pub measured: Vec<MeasuredAngles>,
    /// How well their times are known.
    feedback: Option<ClockQuality>,
    /// What is missing from the recording, as a sentence without its full stop.
    pub shortfall: Option<String>,
}

impl Timeline {
    /// Reads `run`'s recording; of a truncated or damaged one, everything that is still readable.
    ///
    /// # Errors
    /// [`AnalysisError`] when there is no readable recording, or the config's channels are not those of the run.
    pub fn read(run: &RunFolder, config: &RigConfig) -> Result<Self, AnalysisError> {
        let mut builder =
            TimelineBuilder { late_s: late_s(run, config), ..TimelineBuilder::new(run.origin()) };
        let mut recording = Recording::open(&run.file(file::RECORDING))?;
        for item in recording.by_ref() {
            match item?.1 {
                Item::Image(image) => builder.image(&image),
                Item::Servo(event) => builder.servo(&event),
                Item::Command(command) => builder.command(&command),
                Item::Gap => builder.gap(),
            }
        }
        let mut timeline = Self { shortfall: recording.shortfall(), ..builder.timeline(config)? };
        // the commands may be in a chunk that is lost: `servo.csv` of the run holds them too
        if timeline.shortfall.is_some()
            && timeline.command.is_none()
            && let Ok(table) = read_servo(&run.file(file::SERVO))
        {
            (timeline.command, timeline.measured) = (Some(table.command), table.measured);
        }
        Ok(timeline)
    }

    /// The images that get a row in the trajectory.
    pub fn usable(&self) -> impl Iterator<Item = &ImageTime> {
        self.images.iter().filter(|image| image.row.status == USABLE)
    }

    /// How well the board's clock and the times of the reported positions are known, for the report.
    pub fn clock_quality(&self) -> impl Iterator<Item = ClockQuality> {
        let board = self.clock.as_ref().map(|clock| ClockQuality {
            name: "servo board".into(),
            sigma_s: clock.sigma_s(self.clock_at),
            samples: clock.used,
            drift_ppm: Some(clock.drift_ppm()),
        });
        // On a bus the servos have no clock of their own.
        board.filter(|_| self.feedback.is_none()).into_iter().chain(self.feedback.clone())
    }
}
