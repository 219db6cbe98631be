//! Pictures of a board to a calibration file.

use std::path::Path;

use anyhow::anyhow;
use rayon::prelude::*;

use super::{Failure, Watcher};
use calibrate::{Board, Calibrated, MOST_PICTURES, Picture, Setup, calibrate, detect};
use images::{self, TimedImage};

/// Calibrates from the pictures that `path` holds. The threads of the caller's pool look for the board.
///
/// # Errors
/// [`Failure::Input`] where the pictures cannot be read, [`Failure::Data`] where they do not make a calibration.
pub fn from_pictures(path: &Path, setup: &Setup, watcher: &mut dyn Watcher) -> Result<Calibrated, Failure> {
    let source = images::open_untimed(path).map_err(Failure::input)?;
    watcher.begin("pictures", source.len_hint().map(|count| count as u64));
    let mut images = source.images().map_err(Failure::input)?;
    let mut pictures: Vec<Picture> = Vec::new();
    loop {
        let some = images.by_ref().take(rayon::current_num_threads());
        let some = some.collect::<Result<Vec<TimedImage>, _>>().map_err(Failure::input)?;
        if some.is_empty() {
            break;
        }
        let found: Vec<Picture> = some.into_par_iter().map(|image| look(image, &setup.board)).collect();
        pictures.extend(found);
        watcher.step(pictures.len() as u64);
        if pictures.len() > MOST_PICTURES {
            return Err(Failure::Input(anyhow!(
                "{} holds more than {MOST_PICTURES} pictures: choose about ten, with the board spread over the plane",
                path.display()
            )));
        }
    }
    watcher.clear();
    calibrate(&pictures, setup).map_err(|error| Failure::data_if(error.is_lack_of_data(), error))
}

fn look(image: TimedImage, board: &Board) -> Picture {
    let TimedImage { name, grey, .. } = image;
    let size_px = grey.as_ref().ok().map(|grey| grey.dimensions().into());
    let corners = grey.and_then(|grey| detect(&grey, board).map_err(|error| error.to_string()));
    Picture { name, size_px, corners }
}
