//! Why pictures make no calibration.

use std::collections::BTreeMap;

use super::fit::FitError;
use super::world::TooNear;
use super::{Board, Picture};

/// Why pictures make no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    /// No picture shows the board.
    #[error("none of {pictures} pictures shows the board: {reasons}")]
    NoBoard {
        /// How many there are.
        pictures: usize,
        /// Their reasons, the most frequent first.
        reasons: String,
    },
    /// Pictures of different cameras or settings.
    #[error(
        "{first} has {width}x{height} px, {other} {other_width}x{other_height} px: a calibration holds for one size; take all pictures with the run's settings"
    )]
    Sizes {
        /// Name of one picture.
        first: String,
        /// Its width \[px\].
        width: u32,
        /// Its height \[px\].
        height: u32,
        /// Name of a picture of another size.
        other: String,
        /// Width of that \[px\].
        other_width: u32,
        /// Height of that \[px\].
        other_height: u32,
    },
    /// The corners leave most of the picture unknown.
    #[error(
        "the boards cover {width_percent:.0} % of the picture's width and {height_percent:.0} % of its height; at least {least_percent:.0} % of both are needed: a larger board, or more places of it"
    )]
    Cover {
        /// Covered share of the width \[%\].
        width_percent: f64,
        /// Covered share of the height \[%\].
        height_percent: f64,
        /// Least share of both \[%\].
        least_percent: f64,
    },
    /// A picture's corners lie on a line.
    #[error("{picture}: all corners lie on a line or nearly so; a plane needs rows and columns")]
    Singular {
        /// Name of the picture.
        picture: String,
    },
    /// The fit failed.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A picture does not fit to the others.
    #[error(
        "{picture}: corners are {rms_mm:.3} mm rms ({worst_mm:.3} mm at worst) from where the board has them, the limit is {limit_mm} mm (--most-rms-mm). In all pictures the board must be flat, lie in one and the same plane, and have squares as large as --board says"
    )]
    Error {
        /// Name of the worst picture.
        picture: String,
        /// Root mean square error of its corners \[mm\].
        rms_mm: f64,
        /// Largest error of a corner \[mm\].
        worst_mm: f64,
        /// Largest root mean square error allowed \[mm\].
        limit_mm: f64,
    },
    /// The offset leads out of the water.
    #[error(
        "a plane {behind_m} m farther than the board is not in the water, of which {water_m} m are between wall and board"
    )]
    OutsideWater {
        /// Distance of the plane behind the board \[m\].
        behind_m: f64,
        /// Water between wall and board \[m\].
        water_m: f64,
    },
    /// The places that say which way is up are too near to each other.
    #[error(transparent)]
    Upright(#[from] TooNear),
}

impl CalibrateError {
    /// None of `pictures` shows a board.
    pub(super) fn no_board(pictures: &[Picture]) -> Self {
        let mut reasons: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for picture in pictures {
            if let Err(reason) = &picture.corners {
                reasons.entry(reason).or_default().push(&picture.name);
            }
        }
        let mut reasons: Vec<_> = reasons.into_iter().collect();
        reasons.sort_by_key(|(_, names)| std::cmp::Reverse(names.len()));
        let say = |(reason, names): &(&str, Vec<&str>)| match names.as_slice() {
            [name] => format!("{name}: {reason}"),
            [name, others @ ..] => format!("{name} and {} more: {reason}", others.len()),
            [] => String::new(),
        };
        let reasons = reasons.iter().map(say).collect::<Vec<_>>().join("; ");
        Self::NoBoard { pictures: pictures.len(), reasons }
    }

    /// The pictures cannot answer, rather than that something wrong was said of them.
    pub fn is_lack_of_data(&self) -> bool {
        !matches!(self, Self::Sizes { .. } | Self::OutsideWater { .. } | Self::Upright(_))
    }
}

/// What to say of a board that no picture shows whole, of which at most `most` corners were seen, `sides` of them a side.
pub(super) fn never_whole(board: &Board, most: usize, sides: [usize; 2]) -> String {
    let [columns, rows] = sides;
    format!(
        "no picture shows all {} inner corners of {board}, at most {most} ({columns} x {rows}): corners are where four squares meet, \
         one fewer a side than squares",
        board.count()
    )
}
