//! What a report is made of.

use ident::experiment::Use;
use ident::fit::Fit;
use image::{GrayImage, RgbImage};
use sim::{Command, Trajectory};

use super::diagnosis_figures::DiagnosisFigures;
use super::motion::Motion;
use record::losses::Losses;
use record::timing::Timing;

/// Everything a report can show. Only `id` is needed; an empty or absent part is left out of the page.
#[derive(Debug, Clone, Default)]
pub struct ReportData {
    /// Run id, or the experiment's name.
    pub id: String,
    /// When the run began or the fit was made, for people.
    pub date: String,
    /// One line saying what was done, e.g. "driven run of chain, prescribed servo".
    pub description: String,
    /// How the run ended; absent for a fit of its own.
    pub end: Option<RunEnd>,
    /// The fit, as in `fit.json`.
    pub fit: Option<Fit>,
    /// What the simulation gets wrong, as in `diagnosis.json`.
    pub diagnosis: Option<DiagnosisFigures>,
    /// Measured and simulated motion of each run.
    pub runs: Vec<RunFigures>,
    /// The same in space.
    pub motions: Vec<Motion>,
    /// Selected camera images with what was extracted from them.
    pub overlays: Vec<Overlay>,
    /// Images that were refused or doubted, by reason.
    pub refused: Vec<RefusedImages>,
    /// Commanded and measured angles of the servos.
    pub servo: Option<ServoTrace>,
    /// What the camera delivered and what became of it.
    pub images: Option<ImageQuality>,
    /// How well other clocks were put on the host's.
    pub clocks: Vec<ClockQuality>,
    /// Wall times of the stages.
    pub timing: Timing,
    /// Things that went less than well, one sentence each.
    pub warnings: Vec<String>,
    /// Name and value: versions, seed, model, camera, water.
    pub provenance: Vec<(String, String)>,
    /// The rig config or `experiment.toml` as used.
    pub config_toml: Option<String>,
}

/// How a run ended, as in `stop.json`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RunEnd {
    /// It did what it was to do.
    Success,
    /// Someone or something stopped it, with the reason.
    Abort(String),
    /// A fault ended it, with the reason.
    Fail(String),
}

/// One run's motion, measured and simulated.
#[derive(Debug, Clone, Default)]
pub struct RunFigures {
    /// Run id as in the experiment.
    pub id: String,
    /// Fitted, or only scored.
    pub usage: Use,
    /// The extracted trajectory.
    pub measured: Trajectory,
    /// The trajectory of the calibrated model at the same instants; empty without a fit.
    pub simulated: Trajectory,
    /// Where the first pivot is \[m\], world frame; drawn as the start of each pose when the trajectory itself
    /// has no P0.
    pub base_m: Option<[f64; 3]>,
    /// When the mechanism begins to move \[s\].
    pub start_s: Option<f64>,
    /// Measured centrelines \[m\] as (x, z), base to tip, one for each of some instants.
    pub centrelines_m: Vec<Vec<[f64; 2]>>,
    /// The camera image of the first pose.
    pub measured_pose: Option<Overlay>,
    /// The same pose rendered from the model.
    pub simulated_pose: Option<GrayImage>,
    /// Some instants, filmed and simulated.
    pub strip: Vec<StripImage>,
}

/// One instant as filmed and as the calibrated model has it, in the same cut of the picture.
#[derive(Debug, Clone)]
pub struct StripImage {
    /// Mid-exposure \[s\] on the run's time.
    pub time_s: f64,
    /// From the camera.
    pub filmed: GrayImage,
    /// As the camera would see the model.
    pub simulated: GrayImage,
    /// Distance between measured and simulated keypoints \[m\], by name.
    pub errors_m: Vec<(String, f64)>,
}

/// A camera image and what was extracted from it. Pixels count from the centre of the top left one.
#[derive(Debug, Clone)]
pub struct Overlay {
    /// The image's name, or the camera's count.
    pub name: String,
    /// Mid-exposure \[s\] on the run's time.
    pub time_s: f64,
    /// The image.
    pub image: GrayImage,
    /// Nonzero where the mechanism was seen; of the image's size.
    pub mask: Option<GrayImage>,
    /// Centreline \[px\], base to tip, as (column, row).
    pub centreline_px: Vec<[f64; 2]>,
    /// Keypoints \[px\] as (name, column, row).
    pub keypoints_px: Vec<(String, [f64; 2])>,
    /// Accepted, or why it was rejected.
    pub status: String,
}

/// Images that were refused or doubted for one reason.
#[derive(Debug, Clone)]
pub struct RefusedImages {
    /// Why, in plain words.
    pub reason: String,
    /// They have keypoints, which may mislead; else they have none.
    pub doubtful: bool,
    /// Number of these images.
    pub count: usize,
    /// Some of them.
    pub shown: Vec<Overlay>,
    /// How many more would be shown if they could be read.
    pub unreadable: usize,
}

/// Commanded and measured servo angles.
#[derive(Debug, Clone, Default)]
pub struct ServoTrace {
    /// Commanded angles.
    pub commanded: Command,
    /// Angles from telemetry, where the board reports them; there may be fewer columns.
    pub measured: Option<Command>,
}

/// Counts of images.
#[derive(Debug, Clone, Default)]
pub struct ImageQuality {
    /// Images received.
    pub received: usize,
    /// Images that gave keypoints.
    pub used: usize,
    /// Reason and count of the rejected ones.
    pub rejected: Vec<(String, usize)>,
    /// Images the camera's own count says were lost.
    pub lost: usize,
    /// Images that came but had no room in a queue.
    pub dropped: usize,
    /// Images received that cannot be read from the recording any more.
    pub unread: usize,
    /// Images a second, as measured.
    pub fps: Option<f64>,
    /// Longest time between two images \[s\].
    pub longest_gap_s: Option<f64>,
    /// Missing images.
    pub losses: Losses,
}

/// How well a clock is known.
#[derive(Debug, Clone, Default)]
pub struct ClockQuality {
    /// Which clock.
    pub name: String,
    /// One sigma of its conversion to the host's clock \[s\].
    pub sigma_s: f64,
    /// Number of samples that the clock fit uses.
    pub samples: usize,
    /// Its rate against nominal \[parts per million\].
    pub drift_ppm: Option<f64>,
}

/// An RGB copy of a grey image.
pub(super) fn to_rgb(image: &GrayImage) -> RgbImage {
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let grey = image.get_pixel(x, y).0[0];
        image::Rgb([grey; 3])
    })
}
