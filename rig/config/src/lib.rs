//! A rig config: one TOML file that says everything about an experiment, read strictly.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

pub mod edit;
mod error;
mod extraction;
pub mod measured;
#[cfg(test)]
mod numbers;
pub mod paths;
pub mod schedule;
pub mod stoppable;
mod tables;
mod webhook;

pub use error::ConfigError;
pub use extraction::ExtractionConfig;
pub use tables::{
    AlertsConfig, MechanismConfig, MotionConfig, MotionKind, Mount, Overlap, QuietHours, RetentionConfig,
    RunConfig, ScheduleConfig, WaterConfig,
};
pub use webhook::Webhook;

use std::path::{Path, PathBuf};

use ground::strict::{self, NonNegative};
use ident::experiment::{CauseConfig, DiagnoseConfig, FitConfig};
use serde::{Deserialize, Serialize};

use camera::calibration::{Calibration, View};
use camera::mock::CameraFaultKind;
use camera::{CameraConfig, CameraKind};
use servo::bus::BusFault;
use servo::calibration::ServoCalibrationError;
use servo::profile::{Profile, ProfileConfig};
use servo::{BoardFault, BoardKind, ServoConfig};
use vision::config::{Background, VisionConfig};
use vision::sam2::Segmenter;

/// Everything about an experiment. One table each; the fields' types document the options.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigConfig {
    /// The file it was read from, from the root on; none where it was read from a text.
    #[serde(skip)]
    pub path: Option<PathBuf>,
    /// What is done, and with which model.
    pub run: RunConfig,
    /// The servo board; a drop has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub servo: Option<ServoConfig>,
    /// The stroke; a drop has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<ProfileConfig>,
    /// The camera.
    pub camera: CameraConfig,
    /// From pixels to metres.
    pub calibration: Calibration,
    /// From images to keypoints, where the model does not say it.
    #[serde(default)]
    pub vision: VisionConfig,
    /// What else is known of the mechanism.
    #[serde(default)]
    pub mechanism: MechanismConfig,
    /// What is known of the water.
    #[serde(default)]
    pub water: WaterConfig,
    /// What is fitted and how.
    #[serde(default)]
    pub fit: FitConfig,
    /// What may be wrong with the model, and how long it is sought.
    #[serde(default)]
    pub diagnose: DiagnoseConfig,
    /// Causes of one's own that a diagnosis tries.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cause: Vec<CauseConfig>,
    /// What is looked at before a motion that no person begins.
    #[serde(default)]
    pub motion: MotionConfig,
    /// When `rig daemon` runs it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub schedule: Option<ScheduleConfig>,
    /// Whom `rig daemon` tells that somebody should look.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alerts: Option<AlertsConfig>,
    /// What `rig daemon` deletes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub retention: Option<RetentionConfig>,
    /// The simulated tank behind mock board and mock camera.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mock: Option<MockConfig>,
    /// The recorded run behind replayed board and replayed camera.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub replay: Option<ReplayConfig>,
}

/// The `[replay]` table.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReplayConfig {
    /// The run's folder, relative to the config.
    pub run: PathBuf,
}

/// The `[mock]` table.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MockConfig {
    /// The tank, a TOML file relative to the config.
    pub tank: PathBuf,
    /// Faults to play.
    #[serde(default)]
    pub faults: Vec<Fault>,
}

/// A fault that a mock plays.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// When, from the run's start \[s\].
    pub at_s: NonNegative,
    /// What.
    pub kind: FaultKind,
}

/// What a mock can be made to do wrong.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum FaultKind {
    /// The camera.
    Camera(CameraFaultKind),
    /// The servo board.
    Board(BoardFault),
    /// Emulated servos on a bus.
    Bus(BusFault),
}

impl RigConfig {
    /// Reads the config at `path` and checks that its tables agree.
    ///
    /// # Errors
    /// [`ConfigError`], naming the file and, within it, the line or the tables.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let config = Self::checked(strict::read(path)?, path)?;
        Ok(Self { path: std::path::absolute(path).ok(), ..config })
    }

    /// Reads the config from `text`, as [`RigConfig::read`] would at `path`.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        Self::checked(strict::parse(text, path)?, path)
    }

    fn checked(mut self, path: &Path) -> Result<Self, ConfigError> {
        self.read_calibrations(path)
            .map_err(|source| ConfigError::Servo { path: path.into(), source: Box::new(source) })?;
        let contradiction =
            |why: &str| Err(ConfigError::Contradiction { path: path.into(), why: why.into() });
        let driven = self.run.kind == MotionKind::Driven;
        if driven && (self.servo.is_none() || self.profile.is_none()) {
            return contradiction("a driven run needs the tables [servo] and [profile]");
        }
        if !driven && self.profile.is_some() {
            return contradiction(
                "a drop plays no profile: remove the table [profile], or say kind = \"driven\"",
            );
        }
        let emulated = self.servo.as_ref().is_some_and(ServoConfig::is_emulated_bus);
        if (self.has(BoardKind::Mock, CameraKind::Mock) || emulated) && self.mock.is_none() {
            return contradiction("mock board or mock camera without a tank: add [mock] tank = \"...\"");
        }
        let faults = || self.mock.iter().flat_map(|mock| &mock.faults);
        let of_board = |fault: &Fault| matches!(fault.kind, FaultKind::Board(_));
        let of_bus = |fault: &Fault| matches!(fault.kind, FaultKind::Bus(_));
        if emulated && faults().any(of_board) || !emulated && faults().any(of_bus) {
            return contradiction(
                "[mock] faults: board-... are of a mock board, bus-... and servo-... of an emulated bus ([servo] port = \"mock\")",
            );
        }
        if self.has(BoardKind::Replay, CameraKind::Replay) && self.replay.is_none() {
            return contradiction("replayed board or camera without a run: add [replay] run = \"...\"");
        }
        let above = self.calibration.view == Some(View::Xy);
        if above && matches!(self.mechanism.mount, Some(Mount::Hanging | Mount::Upright)) {
            return contradiction(
                "[calibration] view = \"x-y\" is a camera above a horizontal plane of motion, [mechanism] mount is another one: say \
                 mount = \"horizontal\", or leave `view` out",
            );
        }
        let webhook = self.alerts.as_ref().and_then(|alerts| alerts.webhook.as_ref());
        if let Some(Err(why)) = webhook.map(Webhook::check) {
            return contradiction(why);
        }
        if let Some(Err(error)) = self.vision.links.map(|links| self.vision.check(links)) {
            return contradiction(&format!("[vision]: {error}"));
        }
        // a simulated tank is drawn flat, without optics: there silhouettes are exact
        if self.mock.is_some() && self.vision.segmenter == Segmenter::Auto {
            self.vision.segmenter = Segmenter::Classical;
        }
        Ok(self)
    }

    /// Reads the servos' calibrations beside the config at `path`; what they say must not contradict it.
    fn read_calibrations(&mut self, path: &Path) -> Result<(), ServoCalibrationError> {
        let Some(servo) = &mut self.servo else { return Ok(()) };
        servo.read_calibrations(path.parent().unwrap_or(Path::new("")))?;
        let Some(profile) = self.profile.as_ref().and_then(|profile| profile.mirrored) else { return Ok(()) };
        let mut measured =
            servo.channels.iter().filter_map(|channel| Some((channel, channel.measured.as_ref()?.mirrored)));
        match measured.find(|(_, file)| *file != profile) {
            Some((channel, file)) => {
                Err(ServoCalibrationError::Mirrored { channel: channel.name.clone(), profile, file })
            }
            None => Ok(()),
        }
    }

    /// The servos' calibrations, relative to the config.
    pub fn servo_calibrations(&self) -> Vec<PathBuf> {
        let channels = self.servo.iter().flat_map(|servo| &servo.channels);
        channels.filter_map(|channel| channel.calibration.clone()).collect()
    }

    /// Bytes a second that the camera sends; at most, where it compresses.
    pub fn camera_bytes_per_s(&self) -> f64 {
        let camera = &self.camera;
        let pixels = u64::from(camera.width_px) * u64::from(camera.height_px);
        camera.format.bytes(pixels) as f64 * camera.fps.map_or(0.0, strict::Positive::get)
    }

    /// How much a run's recording takes on the disk \[bytes\] at most: as if nothing could be compressed, for as long as it is
    /// filmed.
    pub fn expected_bytes(&self) -> u64 {
        let profile_s = self
            .profile
            .as_ref()
            .and_then(|profile| Profile::new(profile).ok())
            .map_or(0.0, |p| p.duration_s());
        let seconds = profile_s + self.run.film_s.get() + self.run.settle_s.get();
        (self.camera_bytes_per_s() * seconds) as u64
    }

    /// Whether the servo is simulated within the program: nobody can be near what it moves.
    pub fn is_simulated(&self) -> bool {
        self.servo.as_ref().is_none_or(|servo| servo.outside_port().is_none())
    }

    /// Whether board or camera are of these kinds.
    fn has(&self, board: BoardKind, camera: CameraKind) -> bool {
        self.servo.as_ref().is_some_and(|servo| servo.kind == board) || self.camera.kind == camera
    }

    /// The files beside the config that an analysis needs, and a copy of the config that names them without
    /// folders: so both can be kept in a run folder.
    pub fn gathered(&self) -> (Self, Vec<PathBuf>) {
        let mut config = self.clone();
        let named = [
            config.vision.static_mask.as_mut(),
            config.calibration.file.as_mut(),
            match &mut config.vision.background {
                Background::Picture(path) => Some(path),
                _ => None,
            },
        ];
        let channels = config.servo.iter_mut().flat_map(|servo| &mut servo.channels);
        let files = named
            .into_iter()
            .flatten()
            .chain(channels.filter_map(|channel| channel.calibration.as_mut()))
            .map(|path| {
                let original = path.clone();
                if let Some(name) = original.file_name() {
                    *path = name.into();
                }
                original
            })
            .collect();
        (config, files)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calibration_file_goes_with_the_config_into_a_run_folder() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/chain-driven-pose-1.toml");
        let mut config = RigConfig::read(&path).unwrap();
        config.calibration = Calibration { file: Some("of-may/tank.toml".into()), ..Calibration::default() };
        let (kept, files) = config.gathered();
        assert_eq!(files, [Path::new("of-may/tank.toml")]);
        assert_eq!(kept.calibration.file.as_deref(), Some(Path::new("tank.toml")));
    }

    #[test]
    fn a_view_from_above_and_a_mount_that_is_not_horizontal_contradict_each_other() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/chain-driven-hanging.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        let above = text.replace("# view = \"x-z\"  ", "view = \"x-y\"  ");
        let message = RigConfig::parse(&above, &path).unwrap_err().to_string();
        assert!(message.contains("mount = \"horizontal\""), "{message}");
        let flat = above.replace("mount = \"hanging\"", "mount = \"horizontal\"");
        assert_eq!(RigConfig::parse(&flat, &path).unwrap().calibration.view, Some(View::Xy));
    }
}
