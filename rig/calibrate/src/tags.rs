//! An aprilgrid in a picture: four corners each (`saddle`) that read as a tag of the family 36h11 (`tag36h11`).
//!
//! Every tag's corner touches a small square's, so it is a saddle point as a chessboard's is and is refined in the same way. What is
//! between four of them says which tag it is, and with that where on the board each corner lies, however few tags are in view.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use image::GrayImage;
use nalgebra::Vector2;

use super::board::Board;
use super::code::{self, Reading};
use super::detect::{Corner, PICTURE_SIDE_MIN_PX, PYRAMID_LEVELS, SMOOTHING_PX, larger, near};
use super::field::Field;
use super::homography::{homography, project};
use super::saddle::{Saddle, saddles, symmetric};
use camera::calibration::Px;

/// Why a picture shows no aprilgrid, or another one.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TagError {
    /// No tag was found.
    #[error(
        "no aprilgrid: no tag of the family 36h11 with a black border of two cells and small squares at its corners was found"
    )]
    None,
    /// Too few tags.
    #[error("{found} of the board's {wanted} tags; at least {PICTURE_TAGS_MIN} must be in view")]
    Few {
        /// Tags found.
        found: usize,
        /// Tags of the board.
        wanted: usize,
    },
    /// A tag of another board.
    #[error("tag {id} is none of {board}: a board of {columns} x {rows} has tags 0 to {}", columns * rows - 1)]
    Foreign {
        /// Number of the tag.
        id: usize,
        /// The board as the user gave it.
        board: Board,
        /// Columns of the board as the user gave them.
        columns: usize,
        /// Rows of the board as the user gave them.
        rows: usize,
    },
    /// Two boards.
    #[error("tag {0} is seen twice: take away the other board, or cover one of the two")]
    Twice(usize),
    /// A mirrored picture.
    #[error(
        "the tags are mirrored: the picture was flipped, or taken through a mirror or from behind the sheet; switch off the camera's \
         flip, or print the board again"
    )]
    Mirrored,
    /// Tags in other places.
    #[error(
        "the tags do not lie as on a board of {columns} x {rows}, on average {off_percent:.0} % of a tag's side from there: COLS counts the tags \
         of the row that begins with tag 0, ROWS those rows; SPACING is the gap as a share of a tag's side"
    )]
    Layout {
        /// Columns of the board as the user gave them.
        columns: usize,
        /// Rows of the board as the user gave them.
        rows: usize,
        /// How far off they are \[% of a side\].
        off_percent: f64,
    },
}

/// Fewest tags of a picture that counts.
const PICTURE_TAGS_MIN: usize = 4;
/// Number of saddle points that are used, the strongest ones (chosen).
const SADDLES_MAX: usize = 4000;
/// How far a tag's side may be off the direction that its end shows \[rad\].
const SIDE_DIRECTION_ERROR_MAX_RAD: f64 = 0.35;
/// Ends of a side that are tried: nearer ones may be cells of the code.
const SIDE_ENDS_TRIED: usize = 4;
/// How well the brightness must be opposite or the same, as the cosine of the phases' difference.
const PHASE_COSINE_MIN: f64 = 0.5;
/// A side is at most so much longer than the next one.
const SIDE_RATIO_MAX: f64 = 2.0;
/// How far a tag's last corner may be from where the other three say, as a share of a side.
const LAST_CORNER_OFFSET_SHARE_MAX: f64 = 0.3;
/// Shortest side of a tag in the picture in which it is read \[px\]: two pixels a cell.
const TAG_SIDE_MIN_PX: f64 = 20.0;
/// The code's nearest cell is so far from a tag's corner, as a share of a side; the small square's far corners are a gap away.
const NEAREST_CELL_SHARE: f64 = 0.28;
/// Spacing of a chessboard whose corners have as much room, over that room: there a window reaches half way only.
const CHESSBOARD_SPACING_FACTOR: f64 = 1.33;
/// Clear distance around a corner, over that room: less than half of it, as `symmetric` looks twice as far.
const CLEARANCE_FACTOR: f64 = 0.4;
/// How far on average tags may be from their places on the board, as a share of a side.
const TAG_OFFSET_SHARE_MAX: f64 = 0.5;

/// A tag that was read.
#[derive(Debug, Clone, Copy)]
struct Tag {
    /// Its corners, clockwise as seen from its upper left one.
    corners: [Px; 4],
    mirrored: bool,
}

impl Tag {
    fn middle(&self) -> Vector2<f64> {
        self.corners.iter().map(|&corner| Vector2::from(corner)).sum::<Vector2<f64>>() / 4.0
    }

    /// Its shortest side \[px\].
    fn side(&self) -> f64 {
        let side =
            |i: usize| (Vector2::from(self.corners[i]) - Vector2::from(self.corners[(i + 1) % 4])).norm();
        (0..4).map(side).fold(f64::INFINITY, f64::min)
    }
}

/// The corners of an aprilgrid's tags in `picture`, so many along its sides and so far apart \[sides\].
///
/// # Errors
/// [`TagError`].
pub(super) fn detect(
    picture: &GrayImage,
    board: &Board,
    [columns, rows]: [usize; 2],
    spacing: f64,
) -> Result<Vec<Corner>, TagError> {
    let plain = Field::of(picture);
    let full = plain.smoothed(SMOOTHING_PX);
    let mut tags: BTreeMap<usize, Tag> = BTreeMap::new();
    let mut level = plain;
    for halvings in 0..PYRAMID_LEVELS {
        if halvings > 0 {
            level = level.halved();
        }
        if level.width.min(level.height) < PICTURE_SIDE_MIN_PX as usize {
            break;
        }
        let mut corners = if halvings == 0 { saddles(&full) } else { saddles(&level.smoothed(SMOOTHING_PX)) };
        corners.truncate(SADDLES_MAX);
        for (id, tag) in read_all(&level, &corners, spacing) {
            let tag = Tag { corners: tag.corners.map(|at| larger(at, (1 << halvings) as f64)), ..tag };
            let known = tags.entry(id).or_insert(tag);
            if (known.middle() - tag.middle()).norm() > known.side() / 2.0 {
                return Err(TagError::Twice(id));
            }
        }
        if tags.len() >= columns * rows {
            break;
        }
    }
    let wanted = columns * rows;
    if tags.is_empty() {
        return Err(TagError::None);
    }
    if tags.values().filter(|tag| tag.mirrored).count() > tags.len() / 2 {
        return Err(TagError::Mirrored);
    }
    tags.retain(|_, tag| !tag.mirrored);
    if let Some((&id, _)) = tags.range(wanted..).next() {
        return Err(TagError::Foreign { id, board: *board, columns, rows });
    }
    if tags.len() < PICTURE_TAGS_MIN {
        return Err(TagError::Few { found: tags.len(), wanted });
    }
    let places = |id: usize| {
        let [x, y] = [2 * (id % columns) as i32, 2 * (id / columns) as i32];
        [[x, y + 1], [x + 1, y + 1], [x + 1, y], [x, y]]
    };
    let sides = tags.iter().map(|(&id, tag)| (tag, places(id)));
    let off = off(sides.clone(), board);
    if off > TAG_OFFSET_SHARE_MAX {
        return Err(TagError::Layout { columns, rows, off_percent: 100.0 * off });
    }
    let refined = |(tag, places): (&Tag, [[i32; 2]; 4])| {
        let room = spacing.min(NEAREST_CELL_SHARE) * tag.side();
        let sharp_at = |px| {
            near(&full, px, CHESSBOARD_SPACING_FACTOR * room)
                .filter(|&at| symmetric(&full, at, CLEARANCE_FACTOR * room))
        };
        let corners = tag.corners.into_iter().zip(places);
        let sharp: Vec<Corner> =
            corners.filter_map(|(px, place)| Some(Corner { px: sharp_at(px)?, place })).collect();
        sharp
    };
    Ok(sides.flat_map(refined).collect())
}

/// How far the tags' corners are from where a board as flat as that one has them, in sides, root mean square.
fn off<'a>(tags: impl Iterator<Item = (&'a Tag, [[i32; 2]; 4])> + Clone, board: &Board) -> f64 {
    let corners = tags.flat_map(|(tag, places)| {
        let side = tag.side();
        tag.corners.into_iter().zip(places).map(move |(px, place)| (Vector2::from(px), place, side))
    });
    let on_board = |place| Vector2::from(board.metres(place));
    let pairs: Vec<_> = corners.clone().map(|(px, place, _)| (on_board(place), px)).collect();
    let Some(map) = homography(&pairs) else { return f64::INFINITY };
    let off =
        corners.map(|(px, place, side)| (project(&map, on_board(place)) - px).norm_squared() / (side * side));
    (off.sum::<f64>() / pairs.len() as f64).sqrt()
}

/// All tags whose four corners are among `saddles`, by their numbers; where one is seen twice, both.
fn read_all(level: &Field, saddles: &[Saddle], spacing: f64) -> Vec<(usize, Tag)> {
    let mut tags: Vec<(usize, Tag)> = Vec::new();
    let mut taken = vec![false; saddles.len()];
    for first in 0..saddles.len() {
        for turn in [0.0, PI] {
            // Each corner is one tag's only.
            if taken[first] {
                break;
            }
            let Some((corners, reading)) = tag_at(level, saddles, first, turn, spacing) else { continue };
            corners.iter().for_each(|&i| taken[i] = true);
            let corners = reading.clockwise(corners).map(|i| saddles[i].at);
            tags.push((reading.id, Tag { corners, mirrored: reading.mirrored }));
        }
    }
    tags
}

/// The tag of which `first` is a corner, in the direction of one of its dark sides or of the other (`turn`).
fn tag_at(
    level: &Field,
    saddles: &[Saddle],
    first: usize,
    turn: f64,
    spacing: f64,
) -> Option<([usize; 4], Reading)> {
    let inward = saddles[first].phase / 2.0 + FRAC_PI_2 + turn;
    let from = Vector2::from(saddles[first].at);
    // Rows grow downward: clockwise as seen is the way angles grow.
    let (ahead, aside) = (ends(saddles, first, inward - FRAC_PI_4), ends(saddles, first, inward + FRAC_PI_4));
    for &b in &ahead {
        for &c in &aside {
            let (to_b, to_c) = (Vector2::from(saddles[b].at) - from, Vector2::from(saddles[c].at) - from);
            let (shorter, longer) = (to_b.norm().min(to_c.norm()), to_b.norm().max(to_c.norm()));
            if longer > SIDE_RATIO_MAX * shorter {
                continue;
            }
            let fourth = from + to_b + to_c;
            let distance = |i: &usize| (Vector2::from(saddles[*i].at) - fourth).norm();
            let near = (0..saddles.len()).filter(|i| {
                distance(i) < LAST_CORNER_OFFSET_SHARE_MAX * shorter
                    && saddles[first].likeness(&saddles[*i]) > PHASE_COSINE_MIN
            });
            let Some(d) = near.min_by(|a, b| distance(a).total_cmp(&distance(b))) else { continue };
            let corners = [first, b, d, c];
            if let Some(reading) = code::read(level, corners.map(|i| saddles[i].at), spacing) {
                return Some((corners, reading));
            }
        }
    }
    None
}

/// Where the side of a tag that leaves `first` in the direction `angle` may end, the nearest first.
fn ends(saddles: &[Saddle], first: usize, angle: f64) -> Vec<usize> {
    let (from, along) = (Vector2::from(saddles[first].at), Vector2::new(angle.cos(), angle.sin()));
    let length = |i: usize| {
        let off = Vector2::from(saddles[i].at) - from;
        let length = off.norm();
        let straight =
            length > TAG_SIDE_MIN_PX && off.dot(&along) > length * SIDE_DIRECTION_ERROR_MAX_RAD.cos();
        (straight && saddles[first].likeness(&saddles[i]) < -PHASE_COSINE_MIN).then_some((length, i))
    };
    let mut ends: Vec<(f64, usize)> = (0..saddles.len()).filter_map(length).collect();
    ends.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    ends.truncate(SIDE_ENDS_TRIED);
    ends.into_iter().map(|(_, i)| i).collect()
}
