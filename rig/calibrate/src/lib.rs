//! What is measured once for a rig: the latency of the camera's stamps ([`latency`]), the servo ([`servo`]), and the plane that the camera sees.
//!
//! Pictures of a board, held in the water in the mechanism's plane of motion, to that plane as the camera sees it.
//!
//! [`detect()`] finds the board's corners in one picture: saddle points (`saddle`), put in order (`grid`) or read as tags (`tags`,
//! `code`). [`fit()`] makes one plane of those of all pictures, a homography and a radial term, which is what a flat wall, water and
//! lens come to in one plane to within hundredths of a millimetre. [`world`] lays the origin and the axes, [`port`] moves the result
//! to a plane nearer or farther, and [`report`] says how good it is.
//!
//! [`servo`] calibrates a servo from a film in which it climbs a staircase.

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

mod board;
mod code;
mod detect;
mod error;
mod field;
mod fit;
mod grid;
mod homography;
pub mod latency;
pub mod port;
mod quality;
pub mod report;
mod saddle;
pub mod servo;
pub mod tag36h11;
mod tags;
pub mod world;

pub use board::{Board, BoardError};
pub use detect::{Corner, DetectError, detect};
pub use error::CalibrateError;
pub use fit::{Fit, FitError, ObservedCorners, fit};
pub use quality::Quality;
pub use tags::TagError;

use camera::calibration::{Plane, Px, View};
use nalgebra::Vector2;
use port::Port;
use world::Upright;

/// A picture and the corners found in it.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Name of its file.
    pub name: String,
    /// Width and height \[px\]; none of a picture that cannot be read.
    pub size_px: Option<[u32; 2]>,
    /// The board's corners, or why there are none.
    pub corners: Result<Vec<Corner>, String>,
}

/// The settings of a calibration: board, plane, origin and limits.
#[derive(Debug, Clone, Copy)]
pub struct Setup {
    /// The printed board.
    pub board: Board,
    /// Which plane of the world it is.
    pub view: View,
    /// Where the world's origin is seen.
    pub origin_px: Px,
    /// Which way is up.
    pub upright: Upright,
    /// How much farther from the camera than the board the mechanism's plane lies \[m\], and what is between camera and board.
    pub offset: Option<(f64, Port)>,
    /// Largest root mean square error of a picture \[m\].
    pub most_rms_m: f64,
}

/// A calibration of the camera.
#[derive(Debug, Clone)]
pub struct Calibrated {
    /// The mechanism's plane of motion.
    pub plane: Plane,
    /// The settings it was made with.
    pub setup: Setup,
    /// Width and height of the pictures \[px\].
    pub size_px: [u32; 2],
    /// Its quality.
    pub quality: Quality,
}

/// Most pictures of one calibration (chosen): more add nothing.
pub const MOST_PICTURES: usize = 200;
/// Steps of the grid of pixels, across and down, at which a plane behind the board is computed (chosen).
const OFFSET_GRID_POINTS: [u32; 2] = [33, 25];

/// The plane that `pictures` show.
///
/// # Errors
/// [`CalibrateError`], which names pictures and limits.
pub fn calibrate(pictures: &[Picture], setup: &Setup) -> Result<Calibrated, CalibrateError> {
    let size_px = one_size(pictures)?;
    let with_board: Vec<(&Picture, &Vec<Corner>)> =
        pictures.iter().filter_map(|picture| Some((picture, picture.corners.as_ref().ok()?))).collect();
    if with_board.is_empty() {
        return Err(CalibrateError::no_board(pictures));
    }
    let observed: Vec<ObservedCorners> = with_board
        .iter()
        .map(|(_, corners)| {
            corners.iter().map(|corner| (corner.px, setup.board.metres(corner.place))).collect()
        })
        .collect();
    quality::covered(&observed, size_px)?;
    let name = |i: usize| with_board[i].0.name.clone();
    let fit = fit(&observed, size_px).map_err(|error| match error {
        FitError::Singular { picture } => CalibrateError::Singular { picture: name(picture) },
        FitError::Diverged => CalibrateError::Fit(error),
    })?;
    let mut quality = Quality::of(pictures, &observed, &fit, size_px);
    if let Some(worst) = quality.pictures.iter().max_by(|a, b| a.rms_m.total_cmp(&b.rms_m))
        && worst.rms_m > setup.most_rms_m
    {
        let (rms_mm, worst_mm) = (worst.rms_m * 1e3, worst.worst_m * 1e3);
        return Err(CalibrateError::Error {
            picture: worst.name.clone(),
            rms_mm,
            worst_mm,
            limit_mm: setup.most_rms_m * 1e3,
        });
    }
    let mut plane = fit.plane;
    if let Some((behind_m, port)) = setup.offset {
        let farther = moved(&plane, behind_m, &port, size_px)?;
        quality.offset_worst_m = farther.errors_m.iter().flatten().copied().max_by(f64::total_cmp);
        plane = farther.plane;
    }
    let map = world::world_from_plane(&plane, setup.origin_px, setup.upright)?;
    let plane = plane.in_world(&map).ok_or(CalibrateError::Fit(FitError::Diverged))?.viewed(setup.view);
    quality.look(&plane, &observed, setup, size_px);
    Ok(Calibrated { plane, setup: *setup, size_px, quality })
}

fn one_size(pictures: &[Picture]) -> Result<[u32; 2], CalibrateError> {
    let mut sizes = pictures.iter().filter_map(|picture| Some((picture, picture.size_px?)));
    let Some((first, size_px)) = sizes.next() else { return Err(CalibrateError::no_board(pictures)) };
    match sizes.find(|(_, other)| *other != size_px) {
        None => Ok(size_px),
        Some((other, [other_width, other_height])) => Err(CalibrateError::Sizes {
            first: first.name.clone(),
            width: size_px[0],
            height: size_px[1],
            other: other.name.clone(),
            other_width,
            other_height,
        }),
    }
}

/// The plane `behind_m` farther from the camera than `plane`, which the camera's axis meets where the middle of the picture shows
/// it: square to it or nearly so.
fn moved(plane: &Plane, behind_m: f64, port: &Port, size_px: [u32; 2]) -> Result<Fit, CalibrateError> {
    if port.water_m.get() + behind_m <= 0.0 {
        return Err(CalibrateError::OutsideWater { behind_m, water_m: port.water_m.get() });
    }
    let last = size_px.map(|side| f64::from(side) - 1.0);
    let foot = Vector2::from(plane.metres(last.map(|side| side / 2.0)));
    let mut observed = ObservedCorners::new();
    for i in 0..=OFFSET_GRID_POINTS[0] {
        for j in 0..=OFFSET_GRID_POINTS[1] {
            let px = [
                last[0] * f64::from(i) / f64::from(OFFSET_GRID_POINTS[0]),
                last[1] * f64::from(j) / f64::from(OFFSET_GRID_POINTS[1]),
            ];
            let off = Vector2::from(plane.metres(px)) - foot;
            let distance = off.norm();
            if distance > 0.0 {
                observed.push((px, (foot + off * (port.farther(distance, behind_m) / distance)).into()));
            }
        }
    }
    Ok(fit(&[observed], size_px)?)
}
