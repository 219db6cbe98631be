//! Why SAM 2 could not segment.

use std::fmt;
use std::path::PathBuf;

use super::signature::Mismatch;

/// Why SAM 2 could not segment.
#[derive(Debug, thiserror::Error)]
pub enum Sam2Error {
    /// ONNX Runtime is not there.
    #[error(
        "loading ONNX Runtime from {}: {what}; SAM 2 needs its shared library, version 1.17 or later (`pip install onnxruntime` brings one: \
         onnxruntime/capi/libonnxruntime.so.* in its folder; or a release of the onnxruntime project): name it as [vision.sam2] library, \
         or in the variable ORT_DYLIB_PATH",
        path.display()
    )]
    Library {
        /// Where it was looked for.
        path: PathBuf,
        /// What the loader said.
        what: String,
    },
    /// The graphs are not there.
    #[error("[vision.sam2] weights = {}: {what}; {HOW_TO_EXPORT}", folder.display())]
    Weights {
        /// The folder.
        folder: PathBuf,
        /// What is missing.
        what: String,
    },
    /// A graph is none.
    #[error("reading the graph {}: {what}; export it again, or copy it again", path.display())]
    Graph {
        /// Its file.
        path: PathBuf,
        /// What the runtime said.
        what: String,
    },
    /// A graph of another export.
    #[error("the graph {} is not that of a SAM 2 export that is known: {mismatch}; {HOW_TO_EXPORT}", path.display())]
    Signature {
        /// Its file.
        path: PathBuf,
        /// Which tensor, what was expected, what was found.
        mismatch: Mismatch,
    },
    /// A graph does not run.
    #[error("running the graph {}: {what}", path.display())]
    Run {
        /// Its file.
        path: PathBuf,
        /// What the runtime said.
        what: String,
    },
    /// The clicked image is none of these.
    #[error("[vision.sam2] start_image = {start_image}, but there are {images} images, counted from 0")]
    NoStart {
        /// The config's number.
        start_image: usize,
        /// How many there are.
        images: usize,
    },
    /// The clicked image cannot be read.
    #[error(
        "[vision.sam2] start_image = {start_image} ({name}) is unreadable: {why}; click in another image"
    )]
    UnreadableStart {
        /// The config's number.
        start_image: usize,
        /// The image's name.
        name: String,
        /// Why.
        why: String,
    },
    /// A click or the crop is not in the picture.
    #[error("[vision.sam2] {what} lies outside of {of}")]
    Outside {
        /// Which, and where it is.
        what: String,
        /// The picture or the crop, and its size.
        of: String,
    },
    /// There is nothing where was clicked.
    #[error(
        "SAM 2 finds nothing at the clicks of [vision.sam2] in image {start_image} ({name}): click on the middle of the mechanism, and say \
         positive = false for clicks on other things"
    )]
    Nothing {
        /// The config's number.
        start_image: usize,
        /// The image's name.
        name: String,
    },
    /// What was clicked is the tank.
    #[error(
        "the clicks of [vision.sam2] in image {start_image} ({name}) select {:.0} % of what is looked at, which is no mechanism: click on the \
         middle of the mechanism, and say positive = false for clicks on other things",
        share * 100.0
    )]
    Background {
        /// The config's number.
        start_image: usize,
        /// The image's name.
        name: String,
        /// Share of the picture, or of the crop.
        share: f64,
    },
}

/// Where graphs come from.
const HOW_TO_EXPORT: &str = "needed are the two files of an image export (`samexporter`: NAME.encoder.onnx, NAME.decoder.onnx) or the four of a \
     video export (`SAM2Export`, `sam2-onnx-cpp`: image_encoder.onnx, image_decoder.onnx, memory_encoder.onnx, memory_attention.onnx)";

impl Sam2Error {
    /// A runtime's error about the graph at `path`.
    pub(super) fn run(path: &std::path::Path, what: impl fmt::Display) -> Self {
        Self::Run { path: path.into(), what: what.to_string() }
    }
}
