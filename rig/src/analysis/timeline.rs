//! What a recording says about time: when each image was exposed, and what the servo was told when, both on the
//! run's time.

use sim::Command;

use super::AnalysisError;
use crate::camera::images_lost;
use crate::clock::{ClockFit, MonotonicNs, Ping};
use crate::config::RigConfig;
use crate::record::ServoCommand;
use crate::record::folder::{RunFolder, file};
use crate::record::frames::FrameRow;
use crate::record::reader::{Item, Recording};
use crate::report::ClockQuality;
use crate::servo::ServoEvent;

/// [`FrameRow::status`] of an image that gets a row in the trajectory, before extraction says more: a row that did not
/// rise in time could not be read again.
pub const USABLE: &str = "ok";

/// An image of the recording, without its bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageTime {
    /// Its place in the recording.
    pub index: usize,
    /// Its row of `frames.csv`.
    pub row: FrameRow,
}

/// Tells the images that can be used by their stamps: each later than all before.
#[derive(Debug, Default)]
pub(super) struct Rising(Option<MonotonicNs>);

impl Rising {
    /// Whether an image exposed at `mid_exposure`, the next received, can be used.
    pub(super) fn takes(&mut self, mid_exposure: MonotonicNs) -> bool {
        let rises = self.0.is_none_or(|latest| mid_exposure > latest);
        if rises {
            self.0 = Some(mid_exposure);
        }
        rises
    }
}

/// See the module.
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
}

impl Timeline {
    /// Reads `run`'s recording. A recording that was cut off is read as far as it goes.
    ///
    /// # Errors
    /// [`AnalysisError`] when there is no readable recording, or the config's channels are not those of the run.
    pub fn read(run: &RunFolder, config: &RigConfig) -> Result<Self, AnalysisError> {
        let origin = run.origin();
        let mut images: Vec<ImageTime> = Vec::new();
        let mut rising = Rising::default();
        let mut last = None;
        let mut pings = Vec::new();
        let mut armed = None;
        let mut started = None;
        for item in Recording::open(&run.file(file::RECORDING))? {
            let (_, item) = item?;
            match item {
                Item::Image(image) => {
                    let (status, reason) = match rising.takes(image.mid_exposure) {
                        true => (USABLE, ""),
                        false => ("rejected", "its stamp is not later than the one before"),
                    };
                    let lost_before = last.map_or(0, |last| images_lost(last, image.sequence));
                    let row = FrameRow {
                        sequence: image.sequence,
                        time_s: image.mid_exposure.seconds_since(origin),
                        stamp_ns: image.stamp.0,
                        damaged: image.damaged,
                        lost_before,
                        status: status.into(),
                        reason: reason.into(),
                    };
                    images.push(ImageTime { index: images.len(), row });
                    last = Some(image.sequence);
                }
                Item::Servo(ServoEvent::Ping { sent, board_tick_us, received }) => {
                    pings.push(Ping { sent, board_tick_us, received });
                }
                Item::Servo(ServoEvent::Started { board_tick_us }) => started = Some(board_tick_us),
                Item::Command(ServoCommand::Arm { profile, .. }) => armed = Some(profile),
                Item::Servo(_) | Item::Command(_) => {}
            }
        }
        let clock = ClockFit::new(&pings);
        let command = match (&config.servo, &config.profile, armed, started, &clock) {
            (Some(servo), Some(profile), Some(pulses), Some(tick_us), Some(clock)) => {
                let start_s = clock.host(tick_us).seconds_since(origin);
                Some(pulses.command(servo, profile.mirrored, start_s)?)
            }
            _ => None,
        };
        let clock_at = pings.last().map_or(origin, |ping| ping.received);
        Ok(Self { images, clock, clock_at, command })
    }

    /// How well the board's clock is known, for the report.
    pub fn clock_quality(&self) -> Option<ClockQuality> {
        let clock = self.clock.as_ref()?;
        Some(ClockQuality {
            name: "servo board".into(),
            sigma_s: clock.sigma_s(self.clock_at),
            samples: clock.used,
            drift_ppm: Some(clock.drift_ppm()),
        })
    }
}
