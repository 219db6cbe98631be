//! The `[vision.sam2]` table.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use ground::strict::{Finite, Positive};
use serde::{Deserialize, Serialize};

/// Whose silhouettes the keypoints are found in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Segmenter {
    /// `pose` where a model says what is held, how it turns in the plane, and where P0 is; else, and for what a mock camera draws, `classical`.
    #[default]
    Auto,
    /// What differs from the empty tank.
    Classical,
    /// What SAM 2 follows from clicks in one image: recorded films only.
    Sam2,
    /// Nobody's: the pose of the model that explains the picture is looked for, and what mechanism and tank look like is learned with it.
    /// For mechanisms that are held, turn in the plane and have a model.
    Pose,
}

/// SAM 2 as a segmenter: the `[vision.sam2]` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sam2Config {
    /// Folder of the exported graphs (`*.onnx`), beside the config.
    pub weights: PathBuf,
    /// ONNX Runtime's shared library, beside the config. Left out: what the variable `ORT_DYLIB_PATH` names, or the library of the
    /// usual name where the system looks for libraries.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub library: Option<PathBuf>,
    /// The number of the image that was clicked in, from 0. Default 0.
    #[serde(default)]
    pub start_image: usize,
    /// The clicks; at least one on the mechanism.
    pub clicks: Vec<Click>,
    /// The part of the picture that is looked at: the smaller, the finer the silhouette. Left out: the whole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crop_px: Option<Crop>,
    /// How far the silhouettes' edges may be off \[px\]: within that of them the picture itself decides. Left out: two cells of the answer, of
    /// which there are 256 across and down (guessed).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edge_px: Option<Positive>,
    /// Threads of the runtime. Left out: as many as the extraction has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub threads: Option<NonZeroUsize>,
}

/// A click in the start image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Click {
    /// Column \[px\].
    pub x_px: Finite,
    /// Row \[px\].
    pub y_px: Finite,
    /// On the mechanism (default), or on something else that must not be taken for it.
    #[serde(default = "yes")]
    pub positive: bool,
}

/// A rectangle of the picture \[px\].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Crop {
    /// First column.
    pub left: u32,
    /// First row.
    pub top: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Sam2Config {
    /// Names its files, which stay where they are, without regard to the config's own `folder`.
    pub fn start_from(&mut self, folder: &Path) {
        for path in std::iter::once(&mut self.weights).chain(&mut self.library) {
            let there = folder.join(&path);
            *path = std::path::absolute(&there).unwrap_or(there);
        }
    }

    /// What is wrong with it, whatever the pictures are.
    pub fn fault(&self) -> Option<&'static str> {
        if !self.clicks.iter().any(|click| click.positive) {
            return Some(
                "clicks has none on the mechanism: clicks = [{ x_px = ..., y_px = ... }] in image start_image",
            );
        }
        let empty = self.crop_px.is_some_and(|crop| crop.width == 0 || crop.height == 0);
        empty.then_some("crop_px is empty: width and height are at least 1")
    }
}

fn yes() -> bool {
    true
}
