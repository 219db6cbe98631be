//! The `[servo]` table: which board, and what its channels drive.

use std::path::Path;

use super::BoardKind;
use super::calibration::ServoCalibrationError;
pub use super::channel::{ChannelKind, SafeState, ServoChannel};
use super::travel::Unit;
use firmware_protocol::board::DEAD_MAN_RANGE_MS;
use firmware_protocol::command::Command;
use firmware_protocol::event::{Event, Fault, State};
use firmware_protocol::units::{Sequence, Ticks};
use ground::clock::Wire;
use ground::strict::Positive;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};

/// The `[servo]` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, remote = "Self")]
pub struct ServoConfig {
    /// Which kind of board.
    pub kind: BoardKind,
    /// The serial port, best by its stable name under `/dev/serial/by-id`. Needed by `serial`, `dynamixel` and `feetech`; with
    /// the last two `"mock"` is a bus of emulated servos.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub port: Option<String>,
    /// Bits per second on the line. Ignored by boards with a USB port of their own. Default 115200; servos for a bus come from
    /// the factory with another one.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// How long the host may be silent before the board puts every channel in its safe state \[ms\], 50 to 2000.
    /// The host takes the board for lost after as long a silence. Default 250.
    #[serde(default = "default_dead_man")]
    pub dead_man_ms: u16,
    /// Time between reports of the pulses \[ms\]; 0 for none. Default 20. Servos on a bus report their position each time they are
    /// sent one.
    #[serde(default = "default_telemetry")]
    pub telemetry_ms: u16,
    /// How often positions are sent to servos on a bus and read from them \[Hz\], 10 to 500. Default 100. Bus only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stream_hz: Option<Positive>,
    /// How late the host may send a position \[ms\]; later is a fault. Default 50. Bus only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_late_ms: Option<u16>,
    /// Feetech's servos have no watchdog: after the host's death they hold the last position sent, with torque.
    /// `true` says that this is known and accepted; without it `feetech` is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accept_no_watchdog: Option<bool>,
    /// The channels in use.
    #[serde(default, rename = "channel")]
    pub channels: Vec<ServoChannel>,
}

/// Bits on the line per byte: 8, a start bit and a stop bit.
const BITS_PER_BYTE: f64 = 10.0;
/// Default of `stream_hz` \[Hz\], chosen.
const DEFAULT_STREAM_HZ: f64 = 100.0;
/// Default of `max_late_ms` \[ms\], chosen.
const DEFAULT_MAX_LATE_MS: u16 = 50;
/// Shortest dead-man on a bus \[ms\], chosen: a few answers of up to 30 ms.
const MIN_BUS_DEAD_MAN_MS: u16 = 100;
/// The value of `port` that names an emulated bus.
const MOCK_PORT: &str = "mock";

fn default_baud() -> u32 {
    115_200
}

fn default_dead_man() -> u16 {
    250
}

fn default_telemetry() -> u16 {
    20
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
            stream_hz: None,
            max_late_ms: None,
            accept_no_watchdog: None,
            channels: Vec::new(),
        }
    }

    /// Whether the servos are on a bus, without a board.
    pub fn is_bus(&self) -> bool {
        matches!(self.kind, BoardKind::Dynamixel | BoardKind::Feetech)
    }

    /// Whether the bus and its servos are emulated.
    pub fn is_emulated_bus(&self) -> bool {
        self.is_bus() && self.port.as_deref() == Some(MOCK_PORT)
    }

    /// The serial port, where it is a real one that other programs can open; a mock has none.
    pub fn outside_port(&self) -> Option<&str> {
        self.port.as_deref().filter(|_| !self.is_emulated_bus())
    }

    /// Time between two positions for servos on a bus \[s\].
    pub fn stream_period_s(&self) -> f64 {
        1.0 / self.stream_hz.map_or(DEFAULT_STREAM_HZ, Positive::get)
    }

    /// How late a position may be \[s\].
    pub fn max_late_s(&self) -> f64 {
        f64::from(self.max_late_ms.unwrap_or(DEFAULT_MAX_LATE_MS)) * 1e-3
    }

    /// How long a ping and its answer take on the line at its baud rate.
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

    /// The channels that drive an actuator of the model, with its name.
    pub fn driven(&self) -> impl Iterator<Item = (&ServoChannel, &str)> {
        self.channels.iter().filter_map(|c| Some((c, c.actuator.as_deref()?)))
    }

    /// Reads the calibrations that channels name; relative paths start at `folder`.
    ///
    /// # Errors
    /// [`ServoCalibrationError`].
    pub fn read_calibrations(&mut self, folder: &Path) -> Result<(), ServoCalibrationError> {
        self.channels.iter_mut().try_for_each(|channel| channel.read_calibration(folder))
    }

    fn check(&self) -> Result<(), String> {
        if self.kind == BoardKind::Serial && self.port.is_none() {
            return Err("kind = \"serial\" needs a port, e.g. port = \"/dev/ttyACM0\"".into());
        }
        self.check_bus()?;
        if self.baud == 0 {
            return Err("baud must be above 0".into());
        }
        if !DEAD_MAN_RANGE_MS.contains(&self.dead_man_ms) {
            return Err(format!(
                "dead_man_ms = {} must be between {} and {}",
                self.dead_man_ms,
                DEAD_MAN_RANGE_MS.start(),
                DEAD_MAN_RANGE_MS.end()
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

impl ServoConfig {
    /// Checks that a bus has the keys that it needs, and a board that makes pulses none of them.
    fn check_bus(&self) -> Result<(), String> {
        let units = self.channels.iter().map(|channel| (channel, channel.travel.unit()));
        if !self.is_bus() {
            for (key, given) in [
                ("stream_hz", self.stream_hz.is_some()),
                ("max_late_ms", self.max_late_ms.is_some()),
                ("accept_no_watchdog", self.accept_no_watchdog.is_some()),
            ] {
                if given {
                    return Err(format!("{key} is of servos on a bus (kind = \"dynamixel\" or \"feetech\")"));
                }
            }
            // A recorded bus can be replayed.
            let plays_counts = matches!(self.kind, BoardKind::Replay | BoardKind::None);
            return match units.into_iter().find(|(_, unit)| !plays_counts && *unit == Unit::Counts) {
                Some((channel, _)) => Err(format!(
                    "channel `{}`: min_count, max_count, zero_count, max_rate_rad_per_s, park_count and max_error_rad are of servos \
                     on a bus; this board needs min_pulse_us, max_pulse_us and max_rate_us_per_s",
                    channel.name
                )),
                None => Ok(()),
            };
        }
        if self.port.is_none() {
            return Err(
                "servos on a bus need a port, e.g. port = \"/dev/ttyUSB0\", or \"mock\" for emulated ones"
                    .into(),
            );
        }
        if self.kind == BoardKind::Feetech && self.accept_no_watchdog != Some(true) {
            return Err("Feetech's servos have no watchdog: when this computer dies they hold their last position, with torque. \
                 Say accept_no_watchdog = true if that is safe with your mechanism"
                .into());
        }
        if self.kind == BoardKind::Dynamixel && self.accept_no_watchdog.is_some() {
            return Err(
                "accept_no_watchdog is for kind = \"feetech\": Dynamixel's servos have a watchdog".into()
            );
        }
        if self.dead_man_ms < MIN_BUS_DEAD_MAN_MS {
            return Err(format!(
                "dead_man_ms = {} must be at least {MIN_BUS_DEAD_MAN_MS} on a bus: an answer may take 30 ms",
                self.dead_man_ms
            ));
        }
        if self.telemetry_ms != default_telemetry() {
            return Err("telemetry_ms is of a board of pulses; servos on a bus tell their position stream_hz times a second".into());
        }
        if let Some(hz) = self.stream_hz.filter(|hz| !(10.0..=500.0).contains(&hz.get())) {
            return Err(format!("stream_hz = {} must be between 10 and 500", hz.get()));
        }
        for (channel, unit) in units {
            let name = &channel.name;
            if unit == Unit::PulseUs {
                return Err(format!(
                    "channel `{name}`: min_pulse_us, max_pulse_us, zero_pulse_us, us_per_rad, max_rate_us_per_s and park_pulse_us are \
                     of a board of pulses; a servo on a bus needs min_count, max_count and max_rate_rad_per_s"
                ));
            }
            if channel.kind != ChannelKind::Servo {
                return Err(format!("channel `{name}`: on a bus there are servos only, leave `kind` out"));
            }
        }
        match self.channels.is_empty() {
            true => Err("a bus needs a [[servo.channel]] for each servo".into()),
            false => Ok(()),
        }
    }
}

impl<'de> Deserialize<'de> for ServoConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // Through `remote`, the derived function is an inherent one: read first, then check the whole.
        let read = Self::deserialize(deserializer)?;
        read.check().map_err(D::Error::custom)?;
        Ok(read)
    }
}

impl Serialize for ServoConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Self::serialize(self, serializer)
    }
}

#[cfg(test)]
mod tests {
    use crate::fixtures::{BUS, EXAMPLE, Rig, example, parse};

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
        assert_eq!(channel.setpoint(0.0, true), channel.setpoint(0.0, false));
        assert!(channel.setpoint(0.5, false) > 1500.0 && channel.setpoint(0.5, true) < 1500.0);
        for mirrored in [false, true] {
            let angle = channel.angle_rad(channel.setpoint(0.5, mirrored), mirrored);
            assert!((angle - 0.5).abs() < 1e-12);
        }
    }

    #[test]
    fn servo_on_a_bus_has_keys_of_its_own_and_no_others() {
        let config = parse(BUS).unwrap();
        assert!(config.is_emulated_bus() && config.outside_port().is_none());
        assert_eq!(config.stream_period_s(), 0.01);
        let text = toml::to_string(&Rig { servo: config.clone() }).unwrap();
        assert_eq!(config, parse(&text).unwrap());
        let channel = &config.channels[0];
        assert!((channel.setpoint(std::f64::consts::FRAC_PI_2, false) - 3072.0).abs() < 1e-9);
        for (from, to, says) in [
            (
                "zero_count = 2048",
                "zero_pulse_us = 1500.0",
                "`zero_pulse_us` is of a servo that gets pulses, `min_count`",
            ),
            ("max_late_ms = 1000", "telemetry_ms = 5", "telemetry_ms is of a board of pulses"),
            ("\"dynamixel\"", "\"feetech\"", "accept_no_watchdog = true"),
            ("\"dynamixel\"", "\"mock\"", "max_late_ms is of servos on a bus"),
            ("port = \"mock\"", "", "need a port"),
            ("id = 1\n", "id = 253\n", "id = 253 must be below 253"),
            ("max_count = 2700", "max_count = 4096", "below 4096"),
            (
                "zero_count = 2048",
                "zero_count = 1000",
                "parks at 1000 counts, outside its limits 1400 to 2700; set park_count",
            ),
            ("max_rate_rad_per_s = 6.0", "", "max_rate_rad_per_s is missing"),
            ("calibrated = true", "kind = \"release\"", "servos only"),
            ("dead_man_ms = 1000", "dead_man_ms = 60", "at least 100 on a bus"),
            ("max_late_ms = 1000", "stream_hz = 1000.0", "between 10 and 500"),
        ] {
            let changed = BUS.replace(from, to);
            assert_ne!(changed, BUS);
            let message = parse(&changed).unwrap_err().to_string();
            assert!(message.contains(says), "{message}");
        }
        let pulses = EXAMPLE.replace("\"mock\"", "\"dynamixel\"\nport = \"mock\"");
        let message = parse(&pulses).unwrap_err().to_string();
        assert!(
            message.contains("a servo on a bus needs min_count, max_count and max_rate_rad_per_s"),
            "{message}"
        );
    }
}
