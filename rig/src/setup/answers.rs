//! What can be answered about a rig.

use std::path::PathBuf;

use serde::Deserialize;
use serde::de::value::{Error, StrDeserializer};
use serde::de::{DeserializeOwned, IntoDeserializer as _};

use camera::Encoding;
use config::{MotionKind, Mount};

/// Stands for a board that is not there yet.
pub const YOUR_BOARD: &str = "/dev/serial/by-id/usb-YOUR_BOARD-if00";
/// Stands for a camera that is not there yet.
pub const YOUR_CAMERA: &str = "/dev/v4l/by-id/usb-YOUR_CAMERA-video-index0";

/// The shape of a link: of what its weight and the water's forces are reckoned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// A box.
    Box,
    /// An ellipsoid.
    Ellipsoid,
}

/// Answers so far; what is left out has a default that goes with the others. Lengths \[m\], weights \[kg\].
#[derive(Debug, Clone, Default, PartialEq, clap::Args)]
pub struct Answers {
    /// Number of links
    #[arg(long, value_name = "N")]
    pub links: Option<usize>,
    /// Length of a link, end to end, in metres
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub length_m: Option<f64>,
    /// How far two links overlap at their pivot, in metres; pivots are length - overlap apart
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub overlap_m: Option<f64>,
    /// Width of a link as the camera sees it, in metres
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub width_m: Option<f64>,
    /// Thickness of a link along the camera's view, in metres
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub thickness_m: Option<f64>,
    /// Shape of a link
    #[arg(long, value_name = "box|ellipsoid", value_parser = word::<Shape>)]
    pub shape: Option<Shape>,
    /// How it is mounted: hanging from its first pivot, upright (motor at the bottom; it floats), or in a horizontal plane filmed from
    /// above
    #[arg(long, value_name = "hanging|upright|horizontal", value_parser = word::<Mount>)]
    pub mount: Option<Mount>,
    /// What moves it: a servo at the first pivot, or a hand that lets go
    #[arg(long, value_name = "driven|drop", value_parser = word::<MotionKind>)]
    pub motion: Option<MotionKind>,
    /// Weight in air of a link, or of each with commas between them, in kilograms
    #[arg(
        long,
        value_name = "KG,...",
        value_delimiter = ',',
        allow_negative_numbers = true,
        conflicts_with = "density_kg_per_m3"
    )]
    pub dry_mass_kg: Option<Vec<f64>>,
    /// Weight in water of a link, or of each, in kilograms; negative where it floats
    #[arg(long, value_name = "KG,...", value_delimiter = ',', allow_negative_numbers = true)]
    pub wet_mass_kg: Option<Vec<f64>>,
    /// Standard deviation of the balance, in kilograms
    #[arg(long, value_name = "KG", allow_negative_numbers = true)]
    pub balance_std_kg: Option<f64>,
    /// Density of the links where they were not weighed, in kg/m3
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    pub density_kg_per_m3: Option<f64>,
    /// Temperature of the water, in degrees Celsius
    #[arg(long, value_name = "C", allow_negative_numbers = true)]
    pub water_temperature_c: Option<f64>,
    /// Salinity of the water, in g/kg
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub salinity_g_per_kg: Option<f64>,
    /// A mock board and a mock camera in a simulated tank, so that the rig runs without hardware; so it is, too, where nothing is plugged
    /// in and no option is about a board or a camera
    #[arg(long)]
    pub mock: bool,
    /// Serial port of the servo board
    #[arg(long, value_name = "PORT", conflicts_with = "mock")]
    pub port: Option<String>,
    /// The camera
    #[arg(long, value_name = "DEVICE", conflicts_with = "mock")]
    pub device: Option<String>,
    /// How images leave the camera
    #[arg(long, value_name = "grey|yuyv|jpeg", value_parser = word::<Encoding>, conflicts_with = "mock")]
    pub format: Option<Encoding>,
    /// Width and height of the images, in pixels
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size_px: Option<[u32; 2]>,
    /// Images a second
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub fps: Option<f64>,
    /// Exposure time, in seconds
    #[arg(long, value_name = "S", allow_negative_numbers = true, conflicts_with = "mock")]
    pub exposure_s: Option<f64>,
    /// Scale of the picture in the plane of motion, in metres per pixel, of a camera square to it
    #[arg(long, value_name = "M", allow_negative_numbers = true, conflicts_with = "calibration")]
    pub metres_per_pixel: Option<f64>,
    /// Instead of the scale: the file that `rig calibrate camera` wrote, as the config names it
    #[arg(long, value_name = "TOML", conflicts_with = "mock")]
    pub calibration: Option<PathBuf>,
}

impl Answers {
    /// Whether an answer is about a board or a camera that is there.
    pub fn name_devices(&self) -> bool {
        self.port.is_some()
            || self.device.is_some()
            || self.format.is_some()
            || self.exposure_s.is_some()
            || self.calibration.is_some()
    }
}

/// The value that a config spells so.
fn word<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    let word: StrDeserializer<'_, Error> = text.into_deserializer();
    T::deserialize(word).map_err(|error| error.to_string())
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let sides = text
        .split_once('x')
        .and_then(|(width, height)| Some([width.trim().parse().ok()?, height.trim().parse().ok()?]));
    sides.ok_or_else(|| "width and height are wanted with an x between them, like 640x480".into())
}
