//! How good a calibration is.

use nalgebra::Vector2;

use super::error::never_whole;
use super::fit::{Fit, ObservedCorners};
use super::{Board, CalibrateError, Picture, Setup};
use camera::calibration::{Plane, Px};

/// How good a calibration is.
#[derive(Debug, Clone, PartialEq)]
pub struct Quality {
    /// Each picture that shows the board.
    pub pictures: Vec<PictureQuality>,
    /// Names of the other pictures, each with the reason.
    pub without_board: Vec<(String, String)>,
    /// Root mean square distance of all corners from where the board has them \[m\]; those misread do not count.
    pub rms_m: f64,
    /// Largest such distance \[m\].
    pub worst_m: f64,
    /// Share of the picture's width and of its height between the outermost corners.
    pub cover: [f64; 2],
    /// Scale in the middle of the picture \[m/px\].
    pub metres_per_px: f64,
    /// How much larger the scale is at the right edge than at the left one, and at the lower than at the upper one, as shares.
    pub scale_change: [f64; 2],
    /// Angle between the camera's axis and the plane's normal, as seen through the wall \[rad\].
    pub tilt_rad: f64,
    /// What the radial term moves at the picture's corner, as a share of its distance from the middle.
    pub radial_share: f64,
    /// Largest error of the map to another plane, where there is one \[m\].
    pub offset_worst_m: Option<f64>,
    /// Warnings for the user, one sentence each.
    pub warnings: Vec<String>,
}

/// How well a picture's corners fit.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureQuality {
    /// Name of its file.
    pub name: String,
    /// Number of corners found.
    pub corners: usize,
    /// Number of them set aside as misread.
    pub misread: usize,
    /// Root mean square distance from where the board has them \[m\].
    pub rms_m: f64,
    /// Largest such distance \[m\].
    pub worst_m: f64,
}

/// Least share of the picture's width and height between the outermost corners (chosen).
const COVER_SHARE_MIN: f64 = 0.3;
/// A smaller share gives a warning (chosen): beyond the outermost corners the plane is extrapolated.
const COVER_SHARE_GOOD: f64 = 0.6;
/// Fewer pictures give a warning (chosen).
const PICTURES_GOOD: usize = 3;
/// Largest angle between camera and wall on which homography and radial term were tried \[rad\]; beyond it a warning is given.
const TILT_TRIED_MAX_RAD: f64 = 15.0 * std::f64::consts::PI / 180.0;

/// The share of the picture's width and height between the outermost corners.
///
/// # Errors
/// [`CalibrateError::Cover`] where that is too little.
pub(super) fn covered(observed: &[ObservedCorners], size_px: [u32; 2]) -> Result<[f64; 2], CalibrateError> {
    let span = |axis: usize| {
        let at = observed.iter().flatten().map(|(px, _)| px[axis]);
        let (least, most) = (at.clone().min_by(f64::total_cmp), at.max_by(f64::total_cmp));
        (most.unwrap_or(0.0) - least.unwrap_or(0.0)) / f64::from(size_px[axis])
    };
    let cover = [span(0), span(1)];
    if cover.iter().all(|&share| share >= COVER_SHARE_MIN) {
        return Ok(cover);
    }
    let [width_percent, height_percent] = cover.map(|share| 100.0 * share);
    Err(CalibrateError::Cover { width_percent, height_percent, least_percent: 100.0 * COVER_SHARE_MIN })
}

impl Quality {
    /// The quality by the errors of the fit; the rest is set by [`Self::look`].
    pub(super) fn of(
        pictures: &[Picture],
        observed: &[ObservedCorners],
        fit: &Fit,
        size_px: [u32; 2],
    ) -> Self {
        let names = pictures.iter().filter(|picture| picture.corners.is_ok());
        let used = |i: usize| {
            let errors = fit.errors_m[i].iter().zip(&fit.misread[i]);
            errors.filter(|(_, misread)| !**misread).map(|(error, _)| *error)
        };
        let each = names.enumerate().map(|(i, picture)| PictureQuality {
            name: picture.name.clone(),
            corners: fit.errors_m[i].len(),
            misread: fit.misread[i].iter().filter(|misread| **misread).count(),
            rms_m: rms(used(i)),
            worst_m: used(i).fold(0.0, f64::max),
        });
        let without =
            |picture: &Picture| Some((picture.name.clone(), picture.corners.as_ref().err()?.clone()));
        let all = (0..observed.len()).flat_map(used);
        Self {
            pictures: each.collect(),
            without_board: pictures.iter().filter_map(without).collect(),
            rms_m: rms(all.clone()),
            worst_m: all.fold(0.0, f64::max),
            cover: covered(observed, size_px).unwrap_or_default(),
            metres_per_px: 0.0,
            scale_change: [0.0; 2],
            tilt_rad: 0.0,
            radial_share: 0.0,
            offset_worst_m: None,
            warnings: Vec::new(),
        }
    }

    /// Adds scale, tilt and warnings of the plane in the world.
    pub(super) fn look(
        &mut self,
        plane: &Plane,
        observed: &[ObservedCorners],
        setup: &Setup,
        size_px: [u32; 2],
    ) {
        let [right, lower] = size_px.map(|side| f64::from(side) - 1.0);
        let middle = [right / 2.0, lower / 2.0];
        self.metres_per_px = plane.metres_per_pixel(middle);
        let change = |from: Px, to: Px| plane.metres_per_pixel(to) / plane.metres_per_pixel(from) - 1.0;
        self.scale_change =
            [change([0.0, middle[1]], [right, middle[1]]), change([middle[0], 0.0], [middle[0], lower])];
        // A circle seen at an angle is as flat as the angle's cosine.
        let shape = plane.straight_slope(middle).singular_values();
        self.tilt_rad = (shape.min() / shape.max()).min(1.0).acos();
        self.radial_share = plane.radial_per_px2() * Vector2::from(middle).norm_squared();
        self.warnings = self.warn(plane, observed, setup, size_px);
    }

    fn warn(
        &self,
        plane: &Plane,
        observed: &[ObservedCorners],
        setup: &Setup,
        size_px: [u32; 2],
    ) -> Vec<String> {
        let mut warnings = Vec::new();
        if let Board::Chessboard { square_m, .. } = setup.board
            && let Some(most) = observed.iter().max_by_key(|corners| corners.len())
            && most.len() < setup.board.count()
        {
            warnings.push(never_whole(&setup.board, most.len(), sides(most, square_m.get())));
        }
        if self.pictures.len() < PICTURES_GOOD {
            warnings.push(
                "fewer than three pictures: a bent board, or one that is not in the plane, shows only against others; take ten, spread \
                 over the plane"
                    .into(),
            );
        }
        if self.cover.iter().any(|&share| share < COVER_SHARE_GOOD) {
            warnings.push(
                "the boards cover little of the picture: beyond the outermost corners the plane is guessed"
                    .into(),
            );
        }
        let [column, row] = setup.origin_px;
        let [width, height] = size_px.map(f64::from);
        if !(column >= -0.5 && row >= -0.5 && column <= width - 0.5 && row <= height - 0.5) {
            warnings.push(format!("the origin [{column}, {row}] lies outside the picture"));
        }
        if self.tilt_rad > TILT_TRIED_MAX_RAD {
            warnings.push(
                "the camera looks at the plane at an angle of more than 15°, for which this calibration was not tried: turn it square \
                 to the plane"
                    .into(),
            );
        }
        if plane.straight_slope(setup.origin_px)[(1, 1)] > 0.0 {
            let [_, (_, up)] = setup.view.seen_axes();
            warnings
                .push(format!("{up} points downward in the picture: is the order of the two places right?"));
        }
        warnings
    }
}

/// Corners a side between the outermost ones seen, the longer side first.
fn sides(corners: &ObservedCorners, square_m: f64) -> [usize; 2] {
    let sides = [0, 1].map(|axis| {
        let at = corners.iter().map(|(_, board)| board[axis] / square_m);
        let (least, most) = at.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        (most - least).round() as usize + 1
    });
    [sides[0].max(sides[1]), sides[0].min(sides[1])]
}

fn rms(errors: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = errors.clone().count().max(1) as f64;
    (errors.map(|error| error * error).sum::<f64>() / count).sqrt()
}
