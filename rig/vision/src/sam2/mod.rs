//! Silhouettes by SAM 2 from a few clicks in one image: the segmentation of the paper's Algorithm 1, for recorded films.
//!
//! The clicked image's mask is followed to the film's end and back to its beginning; what comes out are [`Silhouettes`] that take the
//! place of the ones that differ from the empty tank, static mask taken away like from those. Everything after them stays as it is.
//!
//! The network is not here: it is a folder of ONNX graphs that public tools export from the published weights, run by ONNX Runtime, whose
//! library is loaded when it is asked for. `files` tells the two kinds of export apart, `signature` holds their tensors against what is
//! known, `preprocess` and `logits` are the ways in and out, `video` remembers as SAM 2 does (`memory`), `single` asks image by image.

mod array;
mod config;
mod error;
mod files;
mod graph;
mod logits;
mod memory;
mod preprocess;
mod propagate;
mod signature;
mod single;
mod video;

pub use config::{Click, Crop, Sam2Config, Segmenter};
pub use error::Sam2Error;
pub use signature::{Mismatch, Tensor};

use std::path::Path;

use super::SequenceError;
use super::silhouettes::Silhouettes;
use array::Array;
use camera::source::ImageSource;
use files::Files;
use logits::Logits;
use preprocess::Prompt;
use single::Single;
use video::Video;

/// Cells of a decoder's answer, across and down.
const CELLS: usize = 256;

/// A model that finds in one image after the other what was clicked in one.
trait Follower {
    /// Begins with the image of number `image`, in which `prompt` was clicked.
    fn clicked(&mut self, image: usize, pixels: &Array, prompt: &Prompt) -> Result<Logits, Sam2Error>;

    /// Goes on with the image of number `image`, after or before all those since the beginning.
    fn followed(&mut self, image: usize, pixels: &Array) -> Result<Logits, Sam2Error>;

    /// Goes back to the clicked image.
    fn rewind(&mut self);
}

/// The silhouettes in all of `source`; paths in `config` start from `folder`. Library and graphs are read before any image.
///
/// # Errors
/// [`Sam2Error`], and what the source gives.
pub(super) fn segment(
    config: &Sam2Config,
    folder: &Path,
    source: &(impl ImageSource + ?Sized),
) -> Result<Silhouettes, SequenceError> {
    let mut follower = open(config, folder).map_err(super::VisionError::from)?;
    propagate::silhouettes(follower.as_mut(), config, source)
}

/// The export that `config` names.
fn open(config: &Sam2Config, folder: &Path) -> Result<Box<dyn Follower>, Sam2Error> {
    let files = files::found(&folder.join(&config.weights))?;
    let runtime = graph::runtime(&graph::library(config.library.as_deref(), folder))?;
    let threads = config.threads.map_or_else(rayon::current_num_threads, std::num::NonZeroUsize::get);
    Ok(match files {
        Files::Video(files) => Box::new(Video::read(&runtime, &files, threads)?),
        Files::Image(files) => Box::new(Single::read(&runtime, &files, threads)?),
    })
}
