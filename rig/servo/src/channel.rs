//! A `[[servo.channel]]` table: one servo, its limits and its calibration.

use firmware_protocol::channel as wire;
use firmware_protocol::event::MAX_CHANNELS;
use firmware_protocol::units::{Channel, Name, PulseWidthUs, RateUsPerS};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ground::strict::Positive;
use serde::{Deserialize, Serialize};

use super::calibration::{ServoCalibration, ServoCalibrationError};
use super::travel::{COUNTS_PER_TURN, CountTravel, PulseTravel, Travel};

/// Default of `max_error_rad` \[rad\], chosen.
const DEFAULT_MAX_ERROR_RAD: Positive = Positive::literal(0.2);
/// Greatest ID of a servo on a bus: 254 is the broadcast, 253 and 255 are not used.
const MAX_BUS_ID: u8 = 252;

/// What a channel drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChannelKind {
    /// A servo.
    #[default]
    Servo,
    /// The device that holds the mechanism until a release.
    Release,
    /// A lamp in view of the camera.
    SyncLed,
}

/// What a channel does when the board stops by itself, or servos on a bus are stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SafeState {
    /// No pulse, no torque: the servo goes limp. What hangs keeps still, what stands falls.
    Detach,
    /// Keeps the pulse or the position that it had.
    Hold,
    /// Goes to its park position, at no more than the greatest rate.
    Park,
}

/// A `[[servo.channel]]` table: one channel, its limits and its calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ChannelTable", into = "ChannelTable")]
pub struct ServoChannel {
    /// Number on the board, from 0; on a bus the servo's ID.
    pub id: u8,
    /// Name in messages: 1 to 16 ASCII characters.
    pub name: String,
    /// The model's actuator that this servo drives.
    pub actuator: Option<String>,
    /// What it drives. Default a servo.
    pub kind: ChannelKind,
    /// Limits and calibration.
    pub travel: Travel,
    /// What it does when the board stops by itself.
    pub safe_state: SafeState,
    /// Whether zero and gain were measured. Otherwise the first motion after arming is small and slow.
    pub calibrated: bool,
    /// The file written by `rig calibrate servo`, relative to the config: table, zero and sign are taken from it then.
    pub calibration: Option<PathBuf>,
    /// The content of that file, once it was read.
    pub measured: Option<Arc<ServoCalibration>>,
}

/// All keys that a channel may have; some are for boards that make pulses only, some for servos on a bus only.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ChannelTable {
    id: u8,
    name: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    actuator: Option<String>,
    #[serde(default)]
    kind: ChannelKind,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    min_pulse_us: Option<u16>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    max_pulse_us: Option<u16>,
    /// Default 1500.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    zero_pulse_us: Option<Positive>,
    /// Default 1000 µs over 90°, what most hobby servos do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    us_per_rad: Option<Positive>,
    /// 0, for no limit, only where the channel drives no servo.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    max_rate_us_per_s: Option<u32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    park_pulse_us: Option<u16>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    min_count: Option<u16>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    max_count: Option<u16>,
    /// Default 2048, the middle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    zero_count: Option<u16>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    max_rate_rad_per_s: Option<Positive>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    park_count: Option<u16>,
    /// Default 0.2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    max_error_rad: Option<Positive>,
    safe_state: SafeState,
    #[serde(default)]
    calibrated: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    calibration: Option<PathBuf>,
}

impl ChannelTable {
    /// The keys given that only a board of pulses has, and those that only a bus has.
    fn keys(&self) -> (Vec<&'static str>, Vec<&'static str>) {
        let given = |keys: &[(&'static str, bool)]| {
            keys.iter().filter(|(_, given)| *given).map(|(key, _)| *key).collect::<Vec<_>>()
        };
        let pulses = given(&[
            ("min_pulse_us", self.min_pulse_us.is_some()),
            ("max_pulse_us", self.max_pulse_us.is_some()),
            ("zero_pulse_us", self.zero_pulse_us.is_some()),
            ("us_per_rad", self.us_per_rad.is_some()),
            ("max_rate_us_per_s", self.max_rate_us_per_s.is_some()),
            ("park_pulse_us", self.park_pulse_us.is_some()),
        ]);
        let counts = given(&[
            ("min_count", self.min_count.is_some()),
            ("max_count", self.max_count.is_some()),
            ("zero_count", self.zero_count.is_some()),
            ("max_rate_rad_per_s", self.max_rate_rad_per_s.is_some()),
            ("park_count", self.park_count.is_some()),
            ("max_error_rad", self.max_error_rad.is_some()),
        ]);
        (pulses, counts)
    }

    fn travel(&self) -> Result<Travel, String> {
        let name = &self.name;
        let missing = |key: &str| format!("channel `{name}`: {key} is missing");
        match self.keys() {
            (pulses, counts) if !pulses.is_empty() && !counts.is_empty() => Err(format!(
                "channel `{name}`: `{}` is of a servo that gets pulses, `{}` of one on a bus; keep the keys of one of them",
                pulses.join("`, `"),
                counts.join("`, `")
            )),
            (_, counts) if !counts.is_empty() && self.calibration.is_some() => Err(format!(
                "channel `{name}`: `calibration` is of a servo that gets pulses; one on a bus tells its angle itself"
            )),
            _ if self.calibration.is_some()
                && (self.zero_pulse_us.is_some() || self.us_per_rad.is_some()) =>
            {
                Err(format!(
                    "channel `{name}`: zero and gain are those of its `calibration`: remove zero_pulse_us and us_per_rad, or `calibration`"
                ))
            }
            (_, counts) if !counts.is_empty() => Ok(Travel::Counts(CountTravel {
                min_count: self.min_count.ok_or_else(|| missing("min_count"))?,
                max_count: self.max_count.ok_or_else(|| missing("max_count"))?,
                zero_count: self.zero_count.unwrap_or(COUNTS_PER_TURN / 2),
                max_rate_rad_per_s: self.max_rate_rad_per_s.ok_or_else(|| missing("max_rate_rad_per_s"))?,
                park_count: self.park_count,
                max_error_rad: self.max_error_rad.unwrap_or(DEFAULT_MAX_ERROR_RAD),
            })),
            _ => Ok(Travel::Pulses(PulseTravel {
                min_pulse_us: self.min_pulse_us.ok_or_else(|| missing("min_pulse_us"))?,
                max_pulse_us: self.max_pulse_us.ok_or_else(|| missing("max_pulse_us"))?,
                zero_pulse_us: self.zero_pulse_us.unwrap_or_else(default_zero),
                us_per_rad: self.us_per_rad.unwrap_or_else(default_gain),
                max_rate_us_per_s: self.max_rate_us_per_s.unwrap_or(0),
                park_pulse_us: self.park_pulse_us,
            })),
        }
    }
}

impl TryFrom<ChannelTable> for ServoChannel {
    type Error = String;

    fn try_from(table: ChannelTable) -> Result<Self, String> {
        let channel = Self {
            travel: table.travel()?,
            id: table.id,
            name: table.name,
            actuator: table.actuator,
            kind: table.kind,
            safe_state: table.safe_state,
            calibrated: table.calibrated || table.calibration.is_some(),
            calibration: table.calibration,
            measured: None,
        };
        channel.check()?;
        Ok(channel)
    }
}

impl From<ServoChannel> for ChannelTable {
    fn from(channel: ServoChannel) -> Self {
        let (pulses, counts) = match channel.travel {
            Travel::Pulses(pulses) => (Some(pulses), None),
            Travel::Counts(counts) => (None, Some(counts)),
        };
        let (pulses, counts) = (pulses.as_ref(), counts.as_ref());
        // with a calibration, zero and gain stand in its file
        let uncalibrated = pulses.filter(|_| channel.calibration.is_none());
        Self {
            id: channel.id,
            name: channel.name,
            actuator: channel.actuator,
            kind: channel.kind,
            min_pulse_us: pulses.map(|p| p.min_pulse_us),
            max_pulse_us: pulses.map(|p| p.max_pulse_us),
            zero_pulse_us: uncalibrated.map(|p| p.zero_pulse_us),
            us_per_rad: uncalibrated.map(|p| p.us_per_rad),
            max_rate_us_per_s: pulses.map(|p| p.max_rate_us_per_s),
            park_pulse_us: pulses.and_then(|p| p.park_pulse_us),
            min_count: counts.map(|c| c.min_count),
            max_count: counts.map(|c| c.max_count),
            zero_count: counts.map(|c| c.zero_count),
            max_rate_rad_per_s: counts.map(|c| c.max_rate_rad_per_s),
            park_count: counts.and_then(|c| c.park_count),
            max_error_rad: counts.map(|c| c.max_error_rad),
            safe_state: channel.safe_state,
            calibrated: channel.calibrated,
            calibration: channel.calibration,
        }
    }
}

fn default_zero() -> Positive {
    Positive::new(1500.0).expect("1500 is above 0")
}

fn default_gain() -> Positive {
    Positive::new(1000.0 / std::f64::consts::FRAC_PI_2).expect("a positive quotient")
}

impl ServoChannel {
    /// Reads the file that [`ServoChannel::calibration`] names, if it names one; relative paths start at `folder`.
    ///
    /// # Errors
    /// [`ServoCalibrationError`].
    pub(super) fn read_calibration(&mut self, folder: &Path) -> Result<(), ServoCalibrationError> {
        let Some(file) = &self.calibration else { return Ok(()) };
        let path = folder.join(file);
        let measured = ServoCalibration::read(&path)?;
        if measured.channel != self.name {
            let (channel, of) = (self.name.clone(), measured.channel);
            return Err(ServoCalibrationError::Channel { path, channel, of });
        }
        if let Travel::Pulses(pulses) = &mut self.travel {
            (pulses.zero_pulse_us, pulses.us_per_rad) = measured.scale();
        }
        self.measured = Some(Arc::new(measured));
        self.check().map_err(|reason| ServoCalibrationError::Travel { path, reason })
    }

    /// The setpoint for `angle_rad`, in the channel's unit \[µs or counts\] and not rounded: by the table of its calibration, else zero + gain · angle, or
    /// zero − gain · angle where the servo is `mirrored`, that is, where a longer pulse or a greater count turns it clockwise as the
    /// camera sees it.
    pub fn setpoint(&self, angle_rad: f64, mirrored: bool) -> f64 {
        if let Some(measured) = &self.measured {
            return measured.table.pulse_us(angle_rad);
        }
        let (zero, gain) = self.travel.scale();
        let sign = if mirrored { -1.0 } else { 1.0 };
        zero + sign * gain * angle_rad
    }

    /// The angle for a `setpoint` \[rad\]: the inverse of [`ServoChannel::setpoint`].
    pub fn angle_rad(&self, setpoint: f64, mirrored: bool) -> f64 {
        if let Some(measured) = &self.measured {
            return measured.table.angle_rad(setpoint);
        }
        let (zero, gain) = self.travel.scale();
        let sign = if mirrored { -1.0 } else { 1.0 };
        sign * (setpoint - zero) / gain
    }

    /// The setpoints at which the angle's slope changes, the rows of its calibration \[µs\]; none without one.
    pub fn breakpoints(&self) -> impl Iterator<Item = f64> {
        let rows = self.measured.iter().flat_map(|measured| measured.table.rows());
        rows.map(|row| row.pulse_us.get())
    }

    /// The channel as it is sent to a board that makes pulses; `None` for a servo on a bus, and for a name too long, which
    /// [`ServoChannel`] never has.
    pub fn to_wire(&self) -> Option<wire::ChannelConfig> {
        let Travel::Pulses(pulses) = &self.travel else { return None };
        Some(wire::ChannelConfig {
            channel: Channel(self.id),
            kind: match self.kind {
                ChannelKind::Servo => wire::ChannelKind::Servo,
                ChannelKind::Release => wire::ChannelKind::Release,
                ChannelKind::SyncLed => wire::ChannelKind::SyncLed,
            },
            safe_state: match self.safe_state {
                SafeState::Detach => wire::SafeState::Detach,
                SafeState::Hold => wire::SafeState::Hold,
                SafeState::Park => wire::SafeState::Park,
            },
            min_pulse: PulseWidthUs(pulses.min_pulse_us),
            max_pulse: PulseWidthUs(pulses.max_pulse_us),
            park_pulse: PulseWidthUs(self.travel.park()),
            max_rate: RateUsPerS(pulses.max_rate_us_per_s),
            name: Name::new(&self.name)?,
        })
    }

    fn check(&self) -> Result<(), String> {
        let name = &self.name;
        if Name::<16>::new(name).is_none() {
            return Err(format!("channel name `{name}` must be 1 to 16 printable ASCII characters"));
        }
        let (most, bound) = match self.travel {
            Travel::Pulses(_) => (MAX_CHANNELS as u8 - 1, MAX_CHANNELS),
            Travel::Counts(_) => (MAX_BUS_ID, usize::from(MAX_BUS_ID) + 1),
        };
        if self.id > most {
            return Err(format!("channel `{name}`: id = {} must be below {bound}", self.id));
        }
        self.travel.check(name, self.kind == ChannelKind::Servo)
    }
}
