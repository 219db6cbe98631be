//! The `[camera]` table of a rig config.

use std::path::PathBuf;
use std::time::Duration;

use ground::strict::{Finite, NonNegative, Positive, PositiveSeconds, duration};
use serde::{Deserialize, Serialize};

use super::{CameraError, CameraKind, Encoding};

/// Which camera, and how it is set up.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraConfig {
    /// Where images come from. Default `folder`.
    pub kind: CameraKind,
    /// `v4l`: the device node, for example `/dev/v4l/by-id/...` or `/dev/video0`. No default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<PathBuf>,
    /// `socket`: the tank's folder, in which `rig mock-camera` listens. No default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tank: Option<PathBuf>,
    /// Image width \[px\]. Default 640.
    pub width_px: u32,
    /// Image height \[px\]. Default 480.
    pub height_px: u32,
    /// Images a second. `v4l` and `mock` need it; for a folder of images its `frames.csv` wins over it. No default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fps: Option<Positive>,
    /// How images leave the camera: `grey`, `yuyv` or `jpeg`. Default `grey`.
    pub format: Encoding,
    /// Exposure time \[s\]. Left out: as the camera says. Needed for the time of mid-exposure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure_s: Option<Positive>,
    /// How much later than the instant it claims a stamp is, as measured by `rig calibrate latency` \[s\]; below 0: earlier.
    /// Default 0. USB webcams claim the start of exposure and stamp 5 to 60 ms later.
    pub latency_s: Finite,
    /// How well that is known, 1 sigma \[s\]. A fit then takes the images' clock to be off by so much at most, and a diagnosis looks
    /// elsewhere for what is more. Left out: not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub latency_std_s: Option<Positive>,
    /// From the first row's end of exposure to the last one's \[s\]; matters where stamps mark the image's end. Default 0.
    pub readout_s: NonNegative,
    /// Switch automatic exposure, gain, white balance and focus off. Default true: automatic exposure moves the time of
    /// mid-exposure, and on many webcams the image rate.
    pub lock_exposure: bool,
    /// Images thrown away at the start, which many drivers fill badly. Default 3.
    pub discard: u32,
    /// Time without an image after which the camera counts as stalled \[s\]. Default: five periods, at least 0.2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stall_s: Option<PositiveSeconds>,
}

impl Default for CameraConfig {
    fn default() -> Self {
        let zero = NonNegative::new(0.0).unwrap_or_else(|| unreachable!("0 is not below 0"));
        Self {
            kind: CameraKind::default(),
            device: None,
            tank: None,
            width_px: 640,
            height_px: 480,
            fps: None,
            format: Encoding::Grey,
            exposure_s: None,
            latency_s: Finite::new(0.0).unwrap_or_else(|| unreachable!("0 is finite")),
            latency_std_s: None,
            readout_s: zero,
            lock_exposure: true,
            discard: 3,
            stall_s: None,
        }
    }
}

/// Shortest default time without an image that counts as a stall \[s\], chosen: a busy host may be late by less.
const MIN_STALL_S: f64 = 0.2;

impl CameraConfig {
    /// How long to wait for an image before it is a stall.
    pub fn stall(&self) -> Duration {
        let five_periods = || self.fps.map_or(MIN_STALL_S, |fps| 5.0 / fps.get());
        self.stall_s.map_or_else(|| duration(five_periods().max(MIN_STALL_S)), PositiveSeconds::duration)
    }

    /// Images a second.
    ///
    /// # Errors
    /// [`CameraError::Refused`] where the config does not say.
    pub fn fps(&self) -> Result<f64, CameraError> {
        self.fps.map(Positive::get).ok_or_else(|| self.missing("fps"))
    }

    /// The error for an option this kind of camera needs.
    pub fn missing(&self, option: &str) -> CameraError {
        CameraError::Refused {
            camera: format!("{:?}", self.kind).to_lowercase(),
            what: format!("`{option}` is missing in the table [camera]; set it"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn parse(text: &str) -> Result<CameraConfig, ground::strict::StrictError> {
        ground::strict::parse(text, Path::new("rig.toml"))
    }

    #[test]
    fn short_table_of_an_extraction_is_enough() {
        let config = parse("fps = 100.0").unwrap();
        assert_eq!(config.kind, CameraKind::Folder);
        assert_eq!(config.fps().unwrap(), 100.0);
    }

    #[test]
    fn unknown_keys_and_impossible_values_are_refused() {
        for text in [
            "devise = \"/dev/video0\"",
            "fps = 0.0",
            "exposure_s = -1.0",
            "latency_s = nan",
            "format = \"rgb\"",
        ] {
            assert!(parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn stall_is_five_periods_and_never_less_than_a_busy_host_needs() {
        assert_eq!(parse("fps = 10.0").unwrap().stall(), Duration::from_millis(500));
        assert_eq!(parse("fps = 200.0").unwrap().stall(), Duration::from_millis(200));
        assert_eq!(parse("fps = 200.0\nstall_s = 0.05").unwrap().stall(), Duration::from_millis(50));
    }

    #[test]
    fn config_survives_the_round_trip() {
        let config =
            parse("kind = \"v4l\"\ndevice = \"/dev/video0\"\nfps = 60.0\nexposure_s = 0.004").unwrap();
        assert_eq!(parse(&toml::to_string(&config).unwrap()).unwrap(), config);
    }
}
