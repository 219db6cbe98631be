//! The board in one picture.

use image::GrayImage;
use nalgebra::Vector2;

use super::board::Board;
use super::field::Field;
use super::grid::{self, Grid};
use super::saddle::{Saddle, refined, saddles, symmetric};
use super::tags::{self, TagError};
use camera::calibration::Px;

/// A corner of the board: where it is seen and where on the board it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Place in the picture \[px\].
    pub px: Px,
    /// On a chessboard in squares; which corner is `[0, 0]` and which way the axes point is different in each picture, but the second axis is
    /// always a quarter turn counter-clockwise of the first, as seen. On an aprilgrid `[2 column, 2 row]` for a tag's lower left
    /// corner, counted from the board's, one more to the right or up for its others.
    pub place: [i32; 2],
}

/// Why a picture shows no board.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DetectError {
    /// The picture is too small.
    #[error("a picture of {width} x {height} px")]
    Size {
        /// Width of the picture \[px\].
        width: u32,
        /// Height of the picture \[px\].
        height: u32,
    },
    /// No board.
    #[error("no chessboard: no four corners of a square were found")]
    None,
    /// Part of a board.
    #[error("{found} of the board's {wanted} inner corners; at least {least} must be in view")]
    Part {
        /// Corners found.
        found: usize,
        /// Corners of the board.
        wanted: usize,
        /// Fewest that will do.
        least: usize,
    },
    /// A larger board.
    #[error("a board of more than {columns} x {rows} inner corners: --board counts where four squares meet")]
    Larger {
        /// Columns of the board as the user gave them.
        columns: usize,
        /// Rows of the board as the user gave them.
        rows: usize,
    },
    /// No aprilgrid, or not the one.
    #[error(transparent)]
    Tags(#[from] TagError),
}

/// Smoothing before corners are looked for \[px\].
pub(super) const SMOOTHING_PX: f32 = 1.2;
/// Least share of a board's corners that makes a picture count.
const CORNERS_FOUND_SHARE_MIN: f64 = 0.5;
/// Largest share of corners found outside the board.
const CORNERS_OUTSIDE_SHARE_MAX: f64 = 0.1;
/// Smallest side of a picture \[px\].
pub(super) const PICTURE_SIDE_MIN_PX: u32 = 32;
/// Halvings of a picture in which corners are looked for: large or blurred boards are found in a smaller one.
pub(super) const PYRAMID_LEVELS: usize = 4;
/// A window's standard deviation as a share of the distance between neighbours, and its limits \[px\].
const WINDOW_SIGMA_SHARE: f64 = 0.2;
const WINDOW_SIGMA_RANGE_PX: [f64; 2] = [1.4, 12.0];
/// How far refinement may move a corner, as a share of the distance between neighbours.
const REFINEMENT_SHIFT_SHARE_MAX: f64 = 0.3;

/// The corners of `board` in `picture`, to a fraction of a pixel.
///
/// # Errors
/// [`DetectError`].
pub fn detect(picture: &GrayImage, board: &Board) -> Result<Vec<Corner>, DetectError> {
    let (width, height) = picture.dimensions();
    if width.min(height) < PICTURE_SIDE_MIN_PX {
        return Err(DetectError::Size { width, height });
    }
    match *board {
        Board::Chessboard { corners, .. } => chessboard(picture, corners),
        Board::AprilGrid { tags, spacing, .. } => Ok(tags::detect(picture, board, tags, spacing.get())?),
    }
}

/// A chessboard's inner corners, so many along its sides.
fn chessboard(picture: &GrayImage, corners: [usize; 2]) -> Result<Vec<Corner>, DetectError> {
    let ([columns, rows], count) = (corners, corners[0] * corners[1]);
    let plain = Field::of(picture);
    let full = plain.smoothed(SMOOTHING_PX);
    let mut best = Grid::new();
    let mut level = plain;
    for halvings in 0..PYRAMID_LEVELS {
        if halvings > 0 {
            level = level.halved();
        }
        if level.width.min(level.height) < PICTURE_SIDE_MIN_PX as usize {
            break;
        }
        let all = if halvings == 0 { saddles(&full) } else { saddles(&level.smoothed(SMOOTHING_PX)) };
        let found = grid::largest(&all, count);
        let mut grid = sharp(&full, &found, (1 << halvings) as f64);
        fill(&full, &mut grid);
        if grid.len() > best.len() {
            best = grid;
        }
        if best.len() >= count {
            break;
        }
    }
    if best.is_empty() {
        return Err(DetectError::None);
    }
    let (grid, outside) = grid::on_board(&best, corners);
    if outside as f64 > CORNERS_OUTSIDE_SHARE_MAX * grid.len() as f64 {
        return Err(DetectError::Larger { columns, rows });
    }
    let least = (CORNERS_FOUND_SHARE_MIN * count as f64).ceil() as usize;
    if grid.len() < least {
        return Err(DetectError::Part { found: grid.len(), wanted: count, least });
    }
    Ok(grid.into_iter().map(|(place, saddle)| Corner { px: saddle.at, place }).collect())
}

/// Corners found in a picture `scale` times smaller, refined in the full one; those that cannot be are left out.
fn sharp(full: &Field, found: &Grid, scale: f64) -> Grid {
    let rough: Grid = found
        .iter()
        .map(|(&place, saddle)| (place, Saddle { at: larger(saddle.at, scale), ..*saddle }))
        .collect();
    let refine = |(&place, saddle): (&[i32; 2], &Saddle)| {
        let at = near(full, saddle.at, spacing(&rough, place)?)?;
        Some((place, Saddle { at, ..*saddle }))
    };
    rough.iter().filter_map(refine).collect()
}

/// A place of a picture `scale` times smaller in the full one.
pub(super) fn larger(at: Px, scale: f64) -> Px {
    at.map(|x| scale * x + (scale - 1.0) / 2.0)
}

/// The corner near `start`, where neighbours are `spacing` away \[px\].
pub(super) fn near(full: &Field, start: Px, spacing: f64) -> Option<Px> {
    let sigma = (WINDOW_SIGMA_SHARE * spacing).clamp(WINDOW_SIGMA_RANGE_PX[0], WINDOW_SIGMA_RANGE_PX[1]);
    refined(full, start, sigma, REFINEMENT_SHIFT_SHARE_MAX * spacing).filter(|&at| symmetric(full, at, sigma))
}

/// Least distance to a neighbour \[px\].
fn spacing(grid: &Grid, [i, j]: [i32; 2]) -> Option<f64> {
    let here = Vector2::from(grid.get(&[i, j])?.at);
    let neighbours = [[i + 1, j], [i - 1, j], [i, j + 1], [i, j - 1]];
    let distances =
        neighbours.iter().filter_map(|place| Some((Vector2::from(grid.get(place)?.at) - here).norm()));
    distances.min_by(f64::total_cmp)
}

/// Looks again where corners of the board should be and none stood out.
fn fill(full: &Field, grid: &mut Grid) {
    let Some((&place, first)) = grid.first_key_value() else { return };
    let (parity, first) = (place[0] + place[1], *first);
    let inside = |grid: &Grid, axis: usize, at: i32| {
        grid.keys().any(|place| place[axis] <= at) && grid.keys().any(|place| place[axis] >= at)
    };
    for place in grid::around(grid) {
        let Some((expected, spacing)) = grid::expected(grid, place) else { continue };
        // Beyond the outermost corners something else may look like one.
        if !(inside(grid, 0, place[0]) && inside(grid, 1, place[1])) {
            continue;
        }
        let Some(saddle) = near(full, expected, spacing).and_then(|at| Saddle::sought(full, at)) else {
            continue;
        };
        let sign = f64::from(1 - 2 * (place[0] + place[1] - parity).rem_euclid(2));
        if sign * first.likeness(&saddle) > 0.0 {
            grid.insert(place, saddle);
        }
    }
}
