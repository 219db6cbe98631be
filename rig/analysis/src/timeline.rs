//! What a recording says about time: when each image was exposed, and what the servo was told when, both on the
//! run's time.

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

/// [`FrameRow::status`] of an image that gets a row in the trajectory, before extraction says more: a row that did not
/// rise in time could not be read again.
pub const USABLE: &str = "ok";

/// An image of the recording, without its bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageTime {
    /// Its place in the recording.
    pub index: u64,
    /// Its row of `frames.csv`.
    pub row: FrameRow,
}

/// Where a servo on a bus said it stood.
#[derive(Debug, Clone, Copy)]
struct Stood {
    channel: u8,
    count: i32,
    sent: MonotonicNs,
    received: MonotonicNs,
}

/// Takes in a run in the order in which it is recorded: from the recording, or beside it while it is made.
#[derive(Debug, Clone)]
pub struct Chronicle {
    origin: MonotonicNs,
    /// How much later than they claim the images' times are, beyond what was taken back when they were recorded \[s\].
    late_s: f64,
    images: Vec<ImageTime>,
    rising: Rising,
    last: Option<u32>,
    pings: Vec<Ping>,
    stood: Vec<Stood>,
    armed: Option<PulseProfile>,
    started_tick_us: Option<u64>,
}

impl Chronicle {
    /// Of a run whose time counts from `origin`.
    pub fn new(origin: MonotonicNs) -> Self {
        Self {
            origin,
            late_s: 0.0,
            images: Vec::new(),
            rising: Rising::default(),
            last: None,
            pings: Vec::new(),
            stood: Vec::new(),
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

    /// Something was recorded here that cannot be read: what the camera counted meanwhile it may have handed over.
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
                self.stood.push(Stood { channel, count, sent, received });
            }
            ServoEvent::Started { board_tick_us } => self.started_tick_us = Some(board_tick_us),
            _ => {}
        }
    }

    /// What the board was told next.
    pub fn command(&mut self, command: &ServoCommand) {
        if let ServoCommand::Arm { profile, .. } = command {
            self.armed = Some(profile.clone());
        }
    }

    /// The rows of `frames.csv` so far.
    pub fn rows(&self) -> Vec<FrameRow> {
        self.images.iter().map(|image| image.row.clone()).collect()
    }

    /// What all of it says.
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
        let widths = self.stood.iter().map(|stood| stood.received.seconds_since(stood.sent));
        let feedback = (!measured.is_empty()).then(|| ClockQuality {
            name: "servo feedback".into(),
            // Any instant between question and answer is as likely as another.
            sigma_s: widths.sum::<f64>() / self.stood.len() as f64 / 12.0_f64.sqrt(),
            samples: self.stood.len(),
            drift_ppm: None,
        });
        let (images, shortfall) = (self.images, None);
        Ok(Timeline { images, clock, clock_at, command, measured, feedback, shortfall })
    }

    /// The angles that servos on a bus told, half-way between question and answer.
    fn measured(&self, config: &RigConfig) -> Vec<MeasuredAngles> {
        let Some(servo) = &config.servo else { return Vec::new() };
        let mirrored = config.profile.as_ref().is_some_and(ProfileConfig::is_mirrored);
        let mut measured: Vec<MeasuredAngles> = Vec::new();
        for stood in &self.stood {
            let Some(channel) = servo.channel(stood.channel) else { continue };
            let Some(actuator) = &channel.actuator else { continue };
            let half_s = stood.received.seconds_since(stood.sent) / 2.0;
            let time_s = stood.sent.plus_seconds(half_s).seconds_since(self.origin);
            let known = measured.iter().position(|angles| angles.actuator == *actuator);
            let place = known.unwrap_or_else(|| {
                measured.push(MeasuredAngles { actuator: actuator.clone(), ..MeasuredAngles::default() });
                measured.len() - 1
            });
            let angles = &mut measured[place];
            if angles.time_s.last().is_none_or(|last| time_s > *last) {
                angles.time_s.push(time_s);
                angles.angle_rad.push(channel.angle_rad(f64::from(stood.count), mirrored));
            }
        }
        measured
    }
}

/// How much later the images of `run` are, by the latency that `config` states, than by the one that was stated when they were
/// recorded \[s\].
pub fn late_s(run: &RunFolder, config: &RigConfig) -> f64 {
    #[derive(serde::Deserialize)]
    struct MadeWith {
        camera: CameraConfig,
    }
    // What cannot be read any more is left as it was recorded.
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
    /// Angles that servos told.
    pub measured: Vec<MeasuredAngles>,
    /// How well their times are known.
    feedback: Option<ClockQuality>,
    /// What the recording does not give any more, in a sentence without its full stop.
    pub shortfall: Option<String>,
}

impl Timeline {
    /// Reads `run`'s recording. Of one that was cut off or is damaged all is read that is whole.
    ///
    /// # Errors
    /// [`AnalysisError`] when there is no readable recording, or the config's channels are not those of the run.
    pub fn read(run: &RunFolder, config: &RigConfig) -> Result<Self, AnalysisError> {
        let mut chronicle = Chronicle { late_s: late_s(run, config), ..Chronicle::new(run.origin()) };
        let mut recording = Recording::open(&run.file(file::RECORDING))?;
        for item in recording.by_ref() {
            match item?.1 {
                Item::Image(image) => chronicle.image(&image),
                Item::Servo(event) => chronicle.servo(&event),
                Item::Command(command) => chronicle.command(&command),
                Item::Gap => chronicle.gap(),
            }
        }
        let mut timeline = Self { shortfall: recording.shortfall(), ..chronicle.timeline(config)? };
        // what the servo was told may be in a chunk that is lost: the run's own table says it too
        if timeline.shortfall.is_some()
            && timeline.command.is_none()
            && let Ok((command, measured)) = read_servo(&run.file(file::SERVO))
        {
            (timeline.command, timeline.measured) = (Some(command), measured);
        }
        Ok(timeline)
    }

    /// The images that get a row in the trajectory.
    pub fn usable(&self) -> impl Iterator<Item = &ImageTime> {
        self.images.iter().filter(|image| image.row.status == USABLE)
    }

    /// How well the board's clock is known, and when servos stood where they said, for the report.
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
