//! A case's runs as films, drawn by a renderer that shares no code with the mock camera's, and read as `rig extract` reads them.

use std::io::{Error, Result};

use vision::Status;

use super::bench::{DATA_STEP_S, IMAGE_INTERVAL_S, Run};
use super::cases::Made;
use super::write::Film;
use crate::clips::clip::{Level, prescribed_clip};
use crate::clips::mechanism::Mechanism;
use crate::clips::score::read;

/// Size of a pixel \[m\], and where P0 is seen \[px\].
const SCALE_M: f64 = 0.00028;
const BASE_PX: [f64; 2] = [320.0, 110.0];

/// The trajectory that the film of `run` gives, as a table. Light, noise, blur and where P0 was clicked come from `seed`; every second
/// film has uneven light, dirt, more noise and a motor before P0.
///
/// # Errors
/// Where the film is refused.
pub fn trajectory<const N: usize>(made: &Made<N>, film: Film, run: &Run<N>, seed: u64) -> Result<String> {
    if made.bench.mechanism.of_one_piece {
        return Err(Error::other("pictures are drawn of rigid links only; leave out `--pictures`"));
    }
    let seen = made.bench.watch(run, &made.hidden, DATA_STEP_S);
    let px = |[x, z]: [f64; 2]| [BASE_PX[0] + x / SCALE_M, BASE_PX[1] - z / SCALE_M];
    let points = |row: &Vec<[f64; 2]>| std::iter::once(BASE_PX).chain(row.iter().copied().map(px)).collect();
    let points = seen.iter().step_by(film.every).map(points).collect();
    let seed = seed.wrapping_add(run.motion.run as u64);
    let level = if seed.is_multiple_of(2) { Level::Clean } else { Level::Usual };
    let fps = 1.0 / (IMAGE_INTERVAL_S * film.every as f64);
    let clip = prescribed_clip(level, seed, &Mechanism::shipped_chain(SCALE_M), SCALE_M, points, fps);
    let (score, extraction) = read(&clip, true);
    let Some(extraction) = extraction else {
        return Err(Error::other(score.refused.unwrap_or_default()));
    };
    // What is doubtful is not written: its reader would look at the picture.
    let mut trajectory = extraction.trajectory;
    let width = trajectory.keypoints.len();
    for (row, record) in extraction.records.iter().enumerate() {
        if record.status != Status::Ok {
            trajectory.position_m[row * width..(row + 1) * width].fill([f64::NAN; 3]);
        }
    }
    Ok(ident::table::trajectory_text(&trajectory))
}

/// `model` with the keypoint that the first link turns about.
pub fn with_base(model: &str) -> String {
    model.replacen("<joint name=\"q1\"", "<site name=\"P0\"/>\n      <joint name=\"q1\"", 1)
}
