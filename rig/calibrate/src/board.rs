//! The printed board, as the command line names it.

use std::str::FromStr;

use ground::strict::Positive;

use super::tag36h11::CODES;

/// A printed board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Board {
    /// A chessboard.
    Chessboard {
        /// Inner corners along one side and along the other: where four squares meet.
        corners: [usize; 2],
        /// Side of a square \[m\].
        square_m: Positive,
    },
    /// AprilTags of the family 36h11 in rows and columns, as Kalibr prints them: tag 0 at the lower left, then row by row; around each
    /// code a black border of two cells; small black squares between the tags' corners.
    AprilGrid {
        /// Tags along the lower side, and rows of them.
        tags: [usize; 2],
        /// Side of a tag, its black border included \[m\].
        tag_m: Positive,
        /// Gap between tags, as a share of a tag's side.
        spacing: Positive,
    },
}

/// Fewest inner corners along a side (chosen): with fewer, lens and tilt cannot be separated.
const SIDE_CORNERS_MIN: usize = 3;
/// Most inner corners along a side (chosen).
const SIDE_CORNERS_MAX: usize = 200;
/// Fewest tags along a side (chosen).
const SIDE_TAGS_MIN: usize = 2;
/// Largest side of a square or tag \[m\] (chosen): a larger one was given in millimetres.
const CELL_SIDE_MAX_M: f64 = 1.0;
/// Smallest side of the squares between tags, as a share of a tag (chosen): smaller ones are not detected.
const TAG_SPACING_SHARE_MIN: f64 = 0.1;
/// Widest gap between tags, as a share of a tag: Kalibr prints none wider.
const TAG_SPACING_SHARE_MAX: f64 = 1.0;

/// Why a board is not one.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum BoardError {
    /// Not of a form that is read.
    #[error(
        "`{0}` is no board: say chessboard:COLSxROWS:SQUARE_M, e.g. chessboard:9x6:0.020 for 9 x 6 inner corners and squares of 20 mm, or aprilgrid:COLSxROWS:TAG_M:SPACING, e.g. aprilgrid:6x6:0.030:0.3 for 6 x 6 tags of 30 mm with gaps of 0.3 times that"
    )]
    Form(String),
    /// Too few or too many corners.
    #[error(
        "a board of {columns} x {rows} inner corners; {SIDE_CORNERS_MIN} to {SIDE_CORNERS_MAX} a side are read"
    )]
    Corners {
        /// Corners along one side.
        columns: usize,
        /// Corners along the other side.
        rows: usize,
    },
    /// Too few or too many tags.
    #[error(
        "an aprilgrid of {columns} x {rows} tags; at least {SIDE_TAGS_MIN} a side are read, and the family 36h11 has {} tags in all",
        CODES.len()
    )]
    Tags {
        /// Tags along the lower side.
        columns: usize,
        /// Rows of tags.
        rows: usize,
    },
    /// A size that is not above 0, or too large.
    #[error(
        "squares or tags of {0} m: give the side in metres, above 0 and up to {CELL_SIDE_MAX_M}; 20 mm are 0.020"
    )]
    Size(String),
    /// A gap out of range.
    #[error(
        "a spacing of {0}: give the gap between tags as a share of a tag's side, {TAG_SPACING_SHARE_MIN} to {TAG_SPACING_SHARE_MAX}; 0.3 for gaps of 9 mm between tags of 30 mm"
    )]
    Spacing(String),
}

impl Board {
    /// All its corners that are looked for: the chessboard's inner ones, or four a tag.
    pub fn count(&self) -> usize {
        match self {
            Self::Chessboard { corners, .. } => corners[0] * corners[1],
            Self::AprilGrid { tags, .. } => 4 * tags[0] * tags[1],
        }
    }

    /// Where on the board the corner of `place` lies \[m\]: see [`super::Corner`].
    pub fn metres(&self, place: [i32; 2]) -> [f64; 2] {
        match self {
            Self::Chessboard { square_m, .. } => place.map(|steps| f64::from(steps) * square_m.get()),
            Self::AprilGrid { tag_m, spacing, .. } => place.map(|side| {
                let (tag, end) = (f64::from(side.div_euclid(2)), f64::from(side.rem_euclid(2)));
                (tag * (1.0 + spacing.get()) + end) * tag_m.get()
            }),
        }
    }
}

impl std::fmt::Display for Board {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Chessboard { corners: [columns, rows], square_m } => {
                write!(f, "chessboard:{columns}x{rows}:{}", square_m.get())
            }
            Self::AprilGrid { tags: [columns, rows], tag_m, spacing } => {
                write!(f, "aprilgrid:{columns}x{rows}:{}:{}", tag_m.get(), spacing.get())
            }
        }
    }
}

impl FromStr for Board {
    type Err = BoardError;

    fn from_str(text: &str) -> Result<Self, BoardError> {
        let form = || BoardError::Form(text.into());
        let parts: Vec<&str> = text.split(':').collect();
        let (&[kind, counts, size], spacing) = (match parts.as_slice() {
            [three @ .., spacing] if parts.len() == 4 => (three, Some(*spacing)),
            three => (three, None),
        }) else {
            return Err(form());
        };
        let (columns, rows) = counts.split_once('x').ok_or_else(form)?;
        let count = |text: &str| text.parse::<usize>().map_err(|_| form());
        let (columns, rows) = (count(columns)?, count(rows)?);
        let metres = size.parse::<f64>().ok().filter(|&side| side <= CELL_SIDE_MAX_M).and_then(Positive::new);
        let metres = metres.ok_or_else(|| BoardError::Size(size.into()));
        match (kind, spacing) {
            ("chessboard", None) => {
                let read = SIDE_CORNERS_MIN..=SIDE_CORNERS_MAX;
                if !read.contains(&columns) || !read.contains(&rows) {
                    return Err(BoardError::Corners { columns, rows });
                }
                Ok(Self::Chessboard { corners: [columns, rows], square_m: metres? })
            }
            ("aprilgrid", Some(spacing)) => {
                let few = columns < SIDE_TAGS_MIN || rows < SIDE_TAGS_MIN;
                if few || columns.saturating_mul(rows) > CODES.len() {
                    return Err(BoardError::Tags { columns, rows });
                }
                let share = spacing
                    .parse::<f64>()
                    .ok()
                    .filter(|share| (TAG_SPACING_SHARE_MIN..=TAG_SPACING_SHARE_MAX).contains(share));
                let share = share.and_then(Positive::new);
                let spacing = share.ok_or_else(|| BoardError::Spacing(spacing.into()))?;
                Ok(Self::AprilGrid { tags: [columns, rows], tag_m: metres?, spacing })
            }
            _ => Err(form()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn board_is_read_as_it_is_written() {
        let board: Board = "chessboard:9x6:0.020".parse().unwrap();
        assert_eq!((board.count(), board.metres([2, -1])), (54, [0.04, -0.02]));
        assert_eq!(board.to_string().parse(), Ok(board));
        let grid: Board = "aprilgrid:6x5:0.04:0.25".parse().unwrap();
        assert_eq!(grid.count(), 120);
        assert_eq!(grid.to_string().parse(), Ok(grid));
    }

    #[test]
    fn tags_of_a_grid_lie_a_side_and_a_gap_apart() {
        let grid: Board = "aprilgrid:6x5:0.04:0.25".parse().unwrap();
        for (place, metres) in [([0, 0], [0.0, 0.0]), ([1, 2], [0.04, 0.05]), ([3, 5], [0.09, 0.14])] {
            let off: Vec<f64> = grid.metres(place).iter().zip(metres).map(|(a, b)| (a - b).abs()).collect();
            assert!(off.iter().all(|off| *off < 1e-12), "{place:?} {:?}", grid.metres(place));
        }
    }

    #[test]
    fn what_is_no_board_is_refused_with_what_to_say() {
        for (text, what) in [
            ("chess:9x6:0.02", "say chessboard:COLSxROWS:SQUARE_M"),
            ("chessboard:9:0.02", "say chessboard"),
            ("chessboard:9x6", "say chessboard"),
            ("chessboard:9x6:0.02:1", "say chessboard"),
            ("chessboard:9x-6:0.02", "say chessboard"),
            ("chessboard:9x1:0.02", "9 x 1 inner corners"),
            ("chessboard:9x6:20", "20 mm are 0.020"),
            ("chessboard:9x6:nan", "tags of nan m"),
            ("chessboard:9x6:-0.02", "above 0"),
            ("", "say chessboard"),
            ("aprilgrid:6x6:0.03", "aprilgrid:COLSxROWS:TAG_M:SPACING"),
            ("aprilgrid:6x6:0.03:0.3:1", "aprilgrid:COLSxROWS:TAG_M:SPACING"),
            ("aprilgrid:6x1:0.03:0.3", "6 x 1 tags"),
            ("aprilgrid:60x10:0.03:0.3", "587 tags in all"),
            ("aprilgrid:6x6:30:0.3", "20 mm are 0.020"),
            ("aprilgrid:6x6:0.03:9", "a spacing of 9"),
            ("aprilgrid:6x6:0.03:nan", "a spacing of nan"),
            ("aprilgrid:6x6:0.03:0.009", "gaps of 9 mm"),
        ] {
            let message = text.parse::<Board>().unwrap_err().to_string();
            assert!(message.contains(what), "{text}: {message}");
        }
    }
}
