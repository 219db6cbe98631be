//! From images to keypoints: every stage a pure function of its input and its table of the config.
//!
//! An image's way: [`background`] says how much darker (or brighter) than the empty tank each pixel is,
//! [`component`] picks the mechanism's silhouette, [`thin`] finds its medial path, [`centreline`] moves that to
//! the middle between sub-pixel edges and out to both ends. Where P0 is held, `figure` then lays the mechanism's own outline
//! on the edges that the picture shows, beginning at that line or where the images before lead; elsewhere [`keypoints`] puts P0..Pn
//! on the line itself. What nothing holds is read whole: `body`, [`arms`]. [`gates`] refuse what cannot be the mechanism. [`Extractor`] takes images through all of them,
//! [`sequence`] a whole sequence: the stages that need one image alone in parallel, those that look at the image before in order,
//! so that the result does not depend on the number of threads. A rejected image keeps its row, empty, and its reason: no point is
//! ever made up. Where the config asks for it, [`sam2`] finds the silhouettes of a recorded film instead.
//!
//! Pixels are `[column, row]`, the centre of the top left one is `[0, 0]`.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

pub mod arms;
pub mod background;
mod body;
mod bridges;
pub mod captioned;
pub mod centreline;
pub mod component;
pub mod config;
pub mod contact_sheet;
mod continuity;
pub mod contour;
mod ends;
mod exposure;
pub mod extractor;
mod figure;
pub mod gates;
pub mod keypoints;
pub mod lettering;
pub mod links;
pub mod mask;
pub mod outline;
pub mod output;
pub mod overlay;
mod parts;
mod pixel_runs;
pub mod pose;
pub mod record;
pub mod refused;
pub mod rejection;
pub mod sam2;
pub mod sample;
pub mod self_check;
pub mod sequence;
pub mod silhouettes;
pub mod spline;
pub mod standing_out;
mod static_mask;
pub mod thin;

pub use config::{Ahead, Mode, VisionConfig};
pub use extractor::Extractor;
pub use mask::Mask;
pub use outline::Outline;
pub use record::{Extraction, ImageRecord, Keypoint, Status, StoredKeypoint, StoredRecord};
pub use sequence::Task;

use camera::source::SourceError;

/// Why a whole sequence could not be extracted.
#[derive(Debug, thiserror::Error)]
pub enum VisionError {
    /// The config's numbers do not go together.
    #[error("[vision] {what}")]
    Config {
        /// Which keys, their values, what would do.
        what: String,
    },
    /// A picture named by the config could not be used.
    #[error("[vision] {key} = {path:?}: {what}")]
    Picture {
        /// The config's key.
        key: &'static str,
        /// The file.
        path: std::path::PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// The calibration is of other pictures.
    #[error(transparent)]
    Calibration(#[from] camera::calibration::CalibrationError),
    /// No image stands out from its background.
    #[error(
        "telling the mechanism from its background in {images} images: {what}; light the tank evenly, or name \
         a picture of the empty tank as [vision] background"
    )]
    NoBackground {
        /// How many images were looked at.
        images: usize,
        /// What was seen instead.
        what: String,
    },
    /// P0 is expected where the mechanism is not.
    #[error(
        "[vision] P0 is expected at ({:.0}, {:.0}) px, and in most images the mechanism begins at ({:.0}, {:.0}) px, {apart_px:.0} px from there, \
         with a sigma of {std_px} px: correct `base_px` (or, where the model says it, the calibration's origin), or widen `base_std_px`",
        base[0], base[1], begins[0], begins[1]
    )]
    BaseElsewhere {
        /// Where P0 is expected \[px\].
        base: camera::calibration::Px,
        /// Where what is seen begins, in the middle of the images \[px\].
        begins: camera::calibration::Px,
        /// How far that is from there \[px\].
        apart_px: f64,
        /// `base_std_px`.
        std_px: f64,
    },
    /// The model is not what the images show.
    #[error(
        "[vision] the model, held at ({:.0}, {:.0}) px, explains {explained} of {images} images that were looked at, too few to believe those: \
         {}hide what stands in front with `static_mask`; correct `base_px`, the model's lengths or the calibration; or light the tank evenly",
        base[0], base[1],
        if *is_empty_given { "" } else { "give a picture of the empty tank as `background`; " }
    )]
    NotThisModel {
        /// Where P0 is expected \[px\].
        base: camera::calibration::Px,
        /// How many images it explains.
        explained: usize,
        /// How many were looked at.
        images: usize,
        /// Whether a picture of the empty tank was given.
        is_empty_given: bool,
    },
    /// Nothing says which of two things is the mechanism.
    #[error(
        "[vision] two things of much the same size ({own_px} and {other_px} px) stand out in most images, and nothing says which is the \
         mechanism: give `base_px`, where P0 is, or hide the other with `static_mask`"
    )]
    TwoAlike {
        /// Area of the larger one \[px\].
        own_px: usize,
        /// Area of the other \[px\].
        other_px: usize,
    },
    /// SAM 2 is wanted and did not segment.
    #[error(transparent)]
    Sam2(#[from] sam2::Sam2Error),
    /// There was nothing to extract from.
    #[error("no images to extract from")]
    NoImages,
}

/// Why a sequence from somewhere could not be extracted.
#[derive(Debug, thiserror::Error)]
pub enum SequenceError {
    /// Its images cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// They say nothing.
    #[error("extracting keypoints")]
    Vision(#[from] VisionError),
}
