//! What is printed between four corners, read as a tag.

use ground::statistics::median;
use nalgebra::Vector2;

use super::field::Field;
use super::homography::{homography, project};
use super::tag36h11::{CODES, SIDE};
use camera::calibration::Px;

/// A tag that was read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    /// Its number.
    pub(super) id: usize,
    /// Whether it is mirrored.
    pub(super) mirrored: bool,
    /// Which of the four corners is its upper left one.
    upper_left: usize,
}

impl Reading {
    /// The four corners in the order in which they were read, from the tag's upper left one on.
    pub(super) fn clockwise<T>(&self, mut corners: [T; 4]) -> [T; 4] {
        corners.rotate_left(self.upper_left);
        corners
    }
}

/// Cells of the black border.
const BORDER_CELLS: usize = 2;
/// Cells along a tag's side.
const TAG_SIDE_CELLS: usize = SIDE + 2 * BORDER_CELLS;
/// Least difference between white and black \[grey levels\].
const CONTRAST_MIN_GREY: f64 = 8.0;
/// Least share of the border that is black and of what is around it that is white.
const PLAIN_SHARE_MIN: f64 = 0.85;
/// Most cells of a code that may be misread: mirrored tags differ from others in at least 4.
const MISREAD_CELLS_MAX: u32 = 2;
/// Places of a cell that are looked at, from its middle \[cells\].
const CELL_SAMPLES: [[f64; 2]; 5] = [[0.0, 0.0], [-0.2, -0.2], [0.2, -0.2], [-0.2, 0.2], [0.2, 0.2]];

/// The tag between four `corners`, given clockwise as seen; its neighbours are `spacing` away \[sides\].
pub(super) fn read(field: &Field, corners: [Px; 4], spacing: f64) -> Option<Reading> {
    if !may_be_framed(field, corners.map(Vector2::from), spacing) {
        return None;
    }
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(Vector2::from);
    let pairs: Vec<_> = square.into_iter().zip(corners.map(Vector2::from)).collect();
    let map = homography(&pairs)?;
    let at = |x: f64, y: f64| field.between(project(&map, Vector2::new(x, y)).into()).map(f64::from);
    let cell = |column: usize, row: usize| {
        let look = |off: &[f64; 2]| {
            at(
                (column as f64 + 0.5 + off[0]) / TAG_SIDE_CELLS as f64,
                (row as f64 + 0.5 + off[1]) / TAG_SIDE_CELLS as f64,
            )
        };
        CELL_SAMPLES.iter().map(look).sum::<Option<f64>>().map(|sum| sum / CELL_SAMPLES.len() as f64)
    };
    let of_code = |i: usize| (BORDER_CELLS..BORDER_CELLS + SIDE).contains(&i);
    let border: Vec<f64> = (0..TAG_SIDE_CELLS * TAG_SIDE_CELLS)
        .map(|i| (i % TAG_SIDE_CELLS, i / TAG_SIDE_CELLS))
        .filter(|&(column, row)| !(of_code(column) && of_code(row)))
        .map(|(column, row)| cell(column, row))
        .collect::<Option<_>>()?;
    // Half way to the neighbours; at the border of a picture some of it may be out of sight.
    let around: Vec<f64> = (0..TAG_SIDE_CELLS)
        .map(|i| (i as f64 + 0.5) / TAG_SIDE_CELLS as f64)
        .flat_map(|x| {
            let (near, far) = (-spacing / 2.0, 1.0 + spacing / 2.0);
            [[x, near], [x, far], [near, x], [far, x]]
        })
        .filter_map(|[x, y]| at(x, y))
        .collect();
    let middle = |greys: &[f64]| median(&mut greys.to_vec(), f64::total_cmp);
    let (black, white) = (middle(&border)?, middle(&around)?);
    let between = (black + white) / 2.0;
    let share = |greys: &[f64], is_white: bool| {
        greys.iter().filter(|&&grey| (grey > between) == is_white).count() as f64 / greys.len() as f64
    };
    if white - black < CONTRAST_MIN_GREY
        || share(&border, false) < PLAIN_SHARE_MIN
        || share(&around, true) < PLAIN_SHARE_MIN
    {
        return None;
    }
    let mut code = 0;
    for i in 0..SIDE * SIDE {
        let grey = cell(BORDER_CELLS + i % SIDE, BORDER_CELLS + i / SIDE)?;
        code = 2 * code + u64::from(grey > between);
    }
    let found = |mirrored: bool| {
        let mut code = if mirrored { rearranged(code, |row, column| [row, SIDE - 1 - column]) } else { code };
        for turn in 0..4 {
            if let Some(id) = CODES.iter().position(|&other| (code ^ other).count_ones() <= MISREAD_CELLS_MAX)
            {
                return Some(Reading { id, mirrored, upper_left: turn });
            }
            code = rearranged(code, |row, column| [column, SIDE - 1 - row]);
        }
        None
    };
    found(false).or_else(|| found(true))
}

/// Whether the middle of each side is darker inside than outside, as far as can be seen: most places that are no tag are told by that
/// in a moment.
fn may_be_framed(field: &Field, corners: [Vector2<f64>; 4], spacing: f64) -> bool {
    let centre = corners.iter().sum::<Vector2<f64>>() / 4.0;
    (0..4).all(|i| {
        let middle = (corners[i] + corners[(i + 1) % 4]) / 2.0;
        // The centre is half a side away.
        let inward = 2.0 * (centre - middle);
        let border =
            field.between((middle + inward * (BORDER_CELLS as f64 / 2.0 / TAG_SIDE_CELLS as f64)).into());
        let gap = field.between((middle - inward * (spacing / 2.0)).into());
        border.zip(gap).is_none_or(|(border, gap)| f64::from(gap - border) > CONTRAST_MIN_GREY / 2.0)
    })
}

/// A code whose cell at each row and column is the one that `from` names of `code`.
fn rearranged(code: u64, from: impl Fn(usize, usize) -> [usize; 2]) -> u64 {
    (0..SIDE * SIDE).fold(0, |new, i| {
        let [row, column] = from(i / SIDE, i % SIDE);
        2 * new + (code >> (SIDE * SIDE - 1 - (SIDE * row + column)) & 1)
    })
}
