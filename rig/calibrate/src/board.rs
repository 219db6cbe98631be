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

/// Fewest inner corners along a side: fewer tell a lens from a tilt no more.
const LEAST_CORNERS: usize = 3;
/// Most inner corners along a side.
const MOST_CORNERS: usize = 200;
/// Fewest tags along a side.
const LEAST_TAGS: usize = 2;
/// A square or tag beyond this was given in millimetres \[m\].
const LARGEST_M: f64 = 1.0;
/// The small squares between tags are this large at least, as a share of a tag: smaller ones are not seen.
const LEAST_SPACING: f64 = 0.1;
/// And at most: Kalibr prints none with wider gaps.
const MOST_SPACING: f64 = 1.0;

/// Why a board is not one.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum BoardError {
    /// Not of a form that is read.
    #[error(
        "`{0}` is no board: say chessboard:COLSxROWS:SQUARE_M, e.g. chessboard:9x6:0.020 for 9 x 6 inner corners and squares of 20 mm, or aprilgrid:COLSxROWS:TAG_M:SPACING, e.g. aprilgrid:6x6:0.030:0.3 for 6 x 6 tags of 30 mm with gaps of 0.3 times that"
    )]
    Form(String),
    /// Too few or too many corners.
    #[error("a board of {columns} x {rows} inner corners; {LEAST_CORNERS} to {MOST_CORNERS} a side are read")]
    Corners {
        /// Along one side.
        columns: usize,
        /// Along the other.
        rows: usize,
    },
    /// Too few or too many tags.
    #[error(
        "an aprilgrid of {columns} x {rows} tags; at least {LEAST_TAGS} a side are read, and the family 36h11 has {} tags in all",
        CODES.len()
    )]
    Tags {
        /// Along the lower side.
        columns: usize,
        /// Rows.
        rows: usize,
    },
    /// No size.
    #[error(
        "squares or tags of {0} m: give the side in metres, above 0 and up to {LARGEST_M}; 20 mm are 0.020"
    )]
    Size(String),
    /// No gap.
    #[error(
        "a spacing of {0}: give the gap between tags as a share of a tag's side, {LEAST_SPACING} to {MOST_SPACING}; 0.3 for gaps of 9 mm between tags of 30 mm"
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
        let metres = size.parse::<f64>().ok().filter(|&side| side <= LARGEST_M).and_then(Positive::new);
        let metres = metres.ok_or_else(|| BoardError::Size(size.into()));
        match (kind, spacing) {
            ("chessboard", None) => {
                let read = LEAST_CORNERS..=MOST_CORNERS;
                if !read.contains(&columns) || !read.contains(&rows) {
                    return Err(BoardError::Corners { columns, rows });
                }
                Ok(Self::Chessboard { corners: [columns, rows], square_m: metres? })
            }
            ("aprilgrid", Some(spacing)) => {
                let few = columns < LEAST_TAGS || rows < LEAST_TAGS;
                if few || columns.saturating_mul(rows) > CODES.len() {
                    return Err(BoardError::Tags { columns, rows });
                }
                let share = spacing
                    .parse::<f64>()
                    .ok()
                    .filter(|share| (LEAST_SPACING..=MOST_SPACING).contains(share));
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
