//! The `[servo]` table: which board, and what hangs on its channels.

use super::BoardKind;
use crate::clock::Wire;
use firmware_protocol::board::DEAD_MAN_RANGE;
use firmware_protocol::channel as wire;
use firmware_protocol::command::Command;
use firmware_protocol::event::{Event, Fault, MAX_CHANNELS, State};
use firmware_protocol::units::{Channel, Name, PulseWidthUs, RateUsPerS, Sequence, Ticks};
use ident::strict::Positive;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};

/// The `[servo]` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, remote = "Self")]
pub struct ServoConfig {
    /// Which kind of board.
    pub kind: BoardKind,
    /// The serial port, best by its stable name under `/dev/serial/by-id`. Needed by `serial` only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub port: Option<String>,
    /// Bits per second on the line. Ignored by boards with a USB port of their own. Default 115200.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// How long the board bears the host's silence before it puts every channel in its safe state \[ms\], 50 to 2000.
    /// The host takes as long a silence of the board for its loss. Default 250.
    #[serde(default = "default_dead_man")]
    pub dead_man_ms: u16,
    /// Time between reports of the pulses \[ms\]; 0 for none. Default 20.
    #[serde(default = "default_telemetry")]
    pub telemetry_ms: u16,
    /// The channels in use.
    #[serde(default, rename = "channel")]
    pub channels: Vec<ServoChannel>,
}

/// What a channel drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChannelKind {
    /// A servo.
    #[default]
    Servo,
    /// What holds the mechanism until a release.
    Release,
    /// A lamp in view of the camera.
    SyncLed,
}

/// What a channel does when the board stops by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SafeState {
    /// No pulse: the servo goes limp. What hangs keeps still, what stands falls.
    Detach,
    /// The pulse it had.
    Hold,
    /// To the park pulse, at no more than the greatest rate.
    Park,
}

/// A `[[servo.channel]]` table: one channel, its limits and its calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, remote = "Self")]
pub struct ServoChannel {
    /// Number on the board, from 0.
    pub id: u8,
    /// For people: 1 to 16 ASCII characters.
    pub name: String,
    /// The model's actuator that stands for this servo.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub actuator: Option<String>,
    /// What it drives. Default a servo.
    #[serde(default)]
    pub kind: ChannelKind,
    /// Shortest pulse \[µs\].
    pub min_pulse_us: u16,
    /// Longest pulse \[µs\].
    pub max_pulse_us: u16,
    /// Pulse at angle zero \[µs\]. Default 1500.
    #[serde(default = "default_zero")]
    pub zero_pulse_us: Positive,
    /// Change of the pulse per angle \[µs/rad\]. Default 1000 µs over 90°, what most hobby servos do.
    #[serde(default = "default_gain")]
    pub us_per_rad: Positive,
    /// Fastest change of the pulse \[µs/s\]; 0, for no limit, only where the channel drives no servo.
    #[serde(default)]
    pub max_rate_us_per_s: u32,
    /// What it does when the board stops by itself.
    pub safe_state: SafeState,
    /// Where `park` goes \[µs\]; left out, to the zero pulse.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub park_pulse_us: Option<u16>,
    /// Zero and gain were measured. Otherwise the first motion after arming is small and slow.
    #[serde(default)]
    pub calibrated: bool,
}

/// With start and stop bit.
const BITS_PER_BYTE: f64 = 10.0;

fn default_baud() -> u32 {
    115_200
}

fn default_dead_man() -> u16 {
    250
}

fn default_telemetry() -> u16 {
    20
}

fn default_zero() -> Positive {
    Positive::new(1500.0).expect("1500 is above 0")
}

fn default_gain() -> Positive {
    Positive::new(1000.0 / std::f64::consts::FRAC_PI_2).expect("a positive quotient")
}

impl ServoConfig {
    /// No board.
    pub fn none() -> Self {
        Self {
            kind: BoardKind::None,
            port: None,
            baud: default_baud(),
            dead_man_ms: default_dead_man(),
            telemetry_ms: default_telemetry(),
            channels: Vec::new(),
        }
    }

    /// How long a ping and its answer are on the line at its baud rate.
    pub fn wire(&self) -> Wire {
        let answer = Event::Pong { at: Ticks(0), boot_id: 0, state: State::Idle, fault: Fault::None };
        let packets = [Command::Ping.encode(Sequence(0)), answer.encode(Sequence(0))];
        let [to_s, back_s] =
            packets.map(|packet| packet.encode().len() as f64 * BITS_PER_BYTE / f64::from(self.baud));
        Wire { to_s, back_s }
    }

    /// The channel numbered `id`.
    pub fn channel(&self, id: u8) -> Option<&ServoChannel> {
        self.channels.iter().find(|channel| channel.id == id)
    }

    /// The channels that stand for an actuator of the model.
    pub fn driven(&self) -> impl Iterator<Item = (&ServoChannel, &str)> {
        self.channels.iter().filter_map(|c| Some((c, c.actuator.as_deref()?)))
    }

    fn check(&self) -> Result<(), String> {
        if self.kind == BoardKind::Serial && self.port.is_none() {
            return Err("kind = \"serial\" needs a port, e.g. port = \"/dev/ttyACM0\"".into());
        }
        if self.baud == 0 {
            return Err("baud must be above 0".into());
        }
        if !DEAD_MAN_RANGE.contains(&self.dead_man_ms) {
            return Err(format!(
                "dead_man_ms = {} must be between {} and {}",
                self.dead_man_ms,
                DEAD_MAN_RANGE.start(),
                DEAD_MAN_RANGE.end()
            ));
        }
        for (index, channel) in self.channels.iter().enumerate() {
            for other in &self.channels[..index] {
                if other.id == channel.id {
                    return Err(format!(
                        "channels `{}` and `{}` both have id {}",
                        other.name, channel.name, channel.id
                    ));
                }
                if other.name == channel.name {
                    return Err(format!("two channels are named `{}`", channel.name));
                }
                if channel.actuator.is_some() && other.actuator == channel.actuator {
                    return Err(format!(
                        "channels `{}` and `{}` drive one actuator",
                        other.name, channel.name
                    ));
                }
            }
        }
        Ok(())
    }
}

impl ServoChannel {
    /// Where `park` goes \[µs\].
    pub fn park_pulse_us(&self) -> u16 {
        self.park_pulse_us.unwrap_or(self.zero_pulse_us.get().round() as u16)
    }

    /// The pulse for `angle_rad` \[µs\], not rounded: zero + gain · angle, or zero − gain · angle where the servo is
    /// `mirrored`, that is, where a longer pulse turns it clockwise as the camera sees it.
    pub fn pulse_us(&self, angle_rad: f64, mirrored: bool) -> f64 {
        let sign = if mirrored { -1.0 } else { 1.0 };
        self.zero_pulse_us.get() + sign * self.us_per_rad.get() * angle_rad
    }

    /// The angle for `pulse_us` \[rad\]: the inverse of [`ServoChannel::pulse_us`].
    pub fn angle_rad(&self, pulse_us: f64, mirrored: bool) -> f64 {
        let sign = if mirrored { -1.0 } else { 1.0 };
        sign * (pulse_us - self.zero_pulse_us.get()) / self.us_per_rad.get()
    }

    /// The channel as the board is told of it; `None` for a name too long, which [`ServoChannel`] never has.
    pub(super) fn to_wire(&self) -> Option<wire::ChannelConfig> {
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
            min_pulse: PulseWidthUs(self.min_pulse_us),
            max_pulse: PulseWidthUs(self.max_pulse_us),
            park_pulse: PulseWidthUs(self.park_pulse_us()),
            max_rate: RateUsPerS(self.max_rate_us_per_s),
            name: Name::new(&self.name)?,
        })
    }

    fn check(&self) -> Result<(), String> {
        let name = &self.name;
        if Name::<16>::new(name).is_none() {
            return Err(format!("channel name `{name}` must be 1 to 16 printable ASCII characters"));
        }
        if usize::from(self.id) >= MAX_CHANNELS {
            return Err(format!("channel `{name}`: id = {} must be below {MAX_CHANNELS}", self.id));
        }
        let (min, max) = (self.min_pulse_us, self.max_pulse_us);
        if min == 0 || min >= max {
            return Err(format!(
                "channel `{name}`: min_pulse_us = {min} must be above 0 and below max_pulse_us = {max}"
            ));
        }
        if !(min..=max).contains(&self.park_pulse_us()) {
            return Err(format!(
                "channel `{name}`: it parks at {} µs, outside its limits {min} to {max} µs; set park_pulse_us",
                self.park_pulse_us()
            ));
        }
        if self.kind == ChannelKind::Servo && self.max_rate_us_per_s == 0 {
            return Err(format!("channel `{name}`: a servo needs max_rate_us_per_s above 0"));
        }
        Ok(())
    }
}

macro_rules! checked {
    ($type:ident) => {
        impl<'de> Deserialize<'de> for $type {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                // Through `remote`, the derived function is an inherent one: read first, then check the whole.
                let read = $type::deserialize(deserializer)?;
                read.check().map_err(D::Error::custom)?;
                Ok(read)
            }
        }

        impl Serialize for $type {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                $type::serialize(self, serializer)
            }
        }
    };
}
checked!(ServoConfig);
checked!(ServoChannel);

#[cfg(test)]
pub(crate) mod tests {
    use std::path::Path;

    use super::*;

    pub(crate) const EXAMPLE: &str = r#"
[servo]
kind = "mock"
dead_man_ms = 1000
[[servo.channel]]
id = 0
name = "base"
actuator = "servo"
min_pulse_us = 900
max_pulse_us = 2100
max_rate_us_per_s = 4000
safe_state = "hold"
"#;

    pub(crate) fn example() -> ServoConfig {
        parse(EXAMPLE).unwrap()
    }

    /// A rig's config as far as it concerns servos.
    #[derive(Debug, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Rig {
        servo: ServoConfig,
    }

    pub(crate) fn parse(text: &str) -> Result<ServoConfig, ident::strict::StrictError> {
        ident::strict::parse(text, Path::new("rig.toml")).map(|rig: Rig| rig.servo)
    }

    fn refusal(from: &str, to: &str) -> String {
        let text = EXAMPLE.replace(from, to);
        assert_ne!(text, EXAMPLE);
        parse(&text).unwrap_err().to_string()
    }

    #[test]
    fn contradictions_are_refused_with_the_place_and_what_to_change() {
        for (from, to, says) in [
            ("\"mock\"", "\"serial\"", "needs a port"),
            ("1000", "20", "dead_man_ms = 20 must be between 50 and 2000"),
            ("900", "2200", "min_pulse_us = 2200 must be above 0 and below max_pulse_us = 2100"),
            ("900", "1600", "parks at 1500 µs, outside its limits 1600 to 2100 µs; set park_pulse_us"),
            ("max_rate_us_per_s = 4000", "", "a servo needs max_rate_us_per_s above 0"),
            ("\"base\"", "\"a name much too long\"", "1 to 16 printable ASCII"),
            ("id = 0", "id = 16", "id = 16 must be below 16"),
            ("actuator", "actuater", "did you mean `actuator`?"),
            ("\"hold\"", "\"held\"", "unknown variant `held`"),
        ] {
            let message = refusal(from, to);
            assert!(message.contains(says), "{message}");
            assert!(message.contains("line ") && message.contains('^'), "{message}");
        }
        let twice = format!("{EXAMPLE}{}", &EXAMPLE[EXAMPLE.find("[[").unwrap()..]);
        let message = parse(&twice).unwrap_err().to_string();
        assert!(message.contains("both have id 0"), "{message}");
    }

    #[test]
    fn written_config_reads_the_same() {
        let config = example();
        let text = toml::to_string(&Rig { servo: config.clone() }).unwrap();
        assert_eq!(config, parse(&text).unwrap());
    }

    #[test]
    fn mirrored_servo_turns_the_other_way_for_the_same_pulse() {
        let channel = &example().channels[0];
        assert_eq!(channel.pulse_us(0.0, true), channel.pulse_us(0.0, false));
        assert!(channel.pulse_us(0.5, false) > 1500.0 && channel.pulse_us(0.5, true) < 1500.0);
        for mirrored in [false, true] {
            let angle = channel.angle_rad(channel.pulse_us(0.5, mirrored), mirrored);
            assert!((angle - 0.5).abs() < 1e-12);
        }
    }
}
