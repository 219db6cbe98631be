//! The printed board, as the command line names it.

use std::str::FromStr;

use ident::strict::Positive;

/// A chessboard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Board {
    /// Inner corners along one side and along the other: where four squares meet.
    pub corners: [usize; 2],
    /// Side of a square \[m\].
    pub square_m: Positive,
}

/// Fewest inner corners along a side: fewer tell a lens from a tilt no more.
const LEAST_CORNERS: usize = 3;
/// Most inner corners along a side.
const MOST_CORNERS: usize = 200;
/// A square beyond this was given in millimetres \[m\].
const LARGEST_SQUARE_M: f64 = 1.0;

/// Why a board is not one.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum BoardError {
    /// Not of the form that is read.
    #[error(
        "`{0}` is no board: say chessboard:COLSxROWS:SQUARE_M, e.g. chessboard:9x6:0.020 for 9 x 6 inner corners and squares of 20 mm"
    )]
    Form(String),
    /// AprilTags are not read.
    #[error("aprilgrid boards are not read: print a chessboard and say chessboard:COLSxROWS:SQUARE_M")]
    AprilGrid,
    /// Too few or too many corners.
    #[error("a board of {columns} x {rows} inner corners; {LEAST_CORNERS} to {MOST_CORNERS} a side are read")]
    Corners {
        /// Along one side.
        columns: usize,
        /// Along the other.
        rows: usize,
    },
    /// No size of a square.
    #[error(
        "squares of {0} m: give the side of a square in metres, above 0 and up to {LARGEST_SQUARE_M}; 20 mm are 0.020"
    )]
    Square(String),
}

impl Board {
    /// All its inner corners.
    pub fn count(&self) -> usize {
        self.corners[0] * self.corners[1]
    }
}

impl std::fmt::Display for Board {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [columns, rows] = self.corners;
        write!(f, "chessboard:{columns}x{rows}:{}", self.square_m.get())
    }
}

impl FromStr for Board {
    type Err = BoardError;

    fn from_str(text: &str) -> Result<Self, BoardError> {
        let form = || BoardError::Form(text.into());
        let mut parts = text.split(':');
        match parts.next() {
            Some("chessboard") => {}
            Some("aprilgrid") => return Err(BoardError::AprilGrid),
            _ => return Err(form()),
        }
        let (Some(counts), Some(square), None) = (parts.next(), parts.next(), parts.next()) else {
            return Err(form());
        };
        let (columns, rows) = counts.split_once('x').ok_or_else(form)?;
        let count = |text: &str| text.parse::<usize>().map_err(|_| form());
        let (columns, rows) = (count(columns)?, count(rows)?);
        let read = LEAST_CORNERS..=MOST_CORNERS;
        if !read.contains(&columns) || !read.contains(&rows) {
            return Err(BoardError::Corners { columns, rows });
        }
        let metres = square.parse::<f64>().ok().filter(|&side| side <= LARGEST_SQUARE_M);
        let square_m = metres.and_then(Positive::new).ok_or_else(|| BoardError::Square(square.into()))?;
        Ok(Self { corners: [columns, rows], square_m })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn board_is_read_as_it_is_written() {
        let board: Board = "chessboard:9x6:0.020".parse().unwrap();
        assert_eq!((board.corners, board.square_m.get(), board.count()), ([9, 6], 0.02, 54));
        assert_eq!(board.to_string().parse(), Ok(board));
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
            ("chessboard:9x6:nan", "squares of nan m"),
            ("chessboard:9x6:-0.02", "above 0"),
            ("aprilgrid:6x6:0.03:0.3", "print a chessboard"),
        ] {
            let message = text.parse::<Board>().unwrap_err().to_string();
            assert!(message.contains(what), "{text}: {message}");
        }
    }
}
