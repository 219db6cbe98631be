//! One plane from boards at several places of it: homography, radial term and its centre together with where each board lay, by
//! Levenberg-Marquardt.
//!
//! The centre is the picture's unless the corners clearly say otherwise: refraction bends lines about the foot of the camera's plumb
//! on the wall, and a camera that is turned by 2 degrees has that 2 degrees beside the middle.
//!
//! A board's own place and turn in the plane are unknown, so a board of which only a part is seen, or that looks the same from two
//! sides, tells as much as any other: only distances on it count.

use ground::levenberg_marquardt::{LevenbergMarquardt, NormalEquations, Scaling};
use ground::statistics::median;
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Rotation2, Vector2};

use super::homography::{homography, project};
use camera::calibration::{Plane, Px};

/// The corners of a picture: place in the picture \[px\] and on the board \[m\] of each.
pub type ObservedCorners = Vec<(Px, [f64; 2])>;

/// Result of the fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The plane; its world is the board of one of the pictures, so far.
    pub plane: Plane,
    /// Distance of each corner from where its board has it \[m\], by picture.
    pub errors_m: Vec<Vec<f64>>,
    /// Whether a corner was set aside, by picture: it was misread.
    pub misread: Vec<Vec<bool>>,
}

/// Why nothing was fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    /// A picture's corners determine no map.
    #[error("picture {picture}: all corners lie on a line or nearly so; a plane needs rows and columns")]
    Singular {
        /// Number of the picture, from 0.
        picture: usize,
    },
    /// The search did not end.
    #[error(
        "the fit of homography and radial term did not converge; are all pictures of the same board in the same plane?"
    )]
    Diverged,
}

/// Settings of the search (chosen).
const SEARCH: LevenbergMarquardt =
    LevenbergMarquardt { iterations_max: 200, relative_tolerance: 1e-12, scaling: Scaling::Marquardt };
/// Parameters of the plane: eight of the homography, the radial term, its centre.
const PLANE_PARAMETERS: usize = 11;
/// Prior standard deviation of the radial term's centre about the picture's \[half diagonals\] (chosen).
const CENTRE_SIGMA_HALF_DIAGONALS: f64 = 0.1;
/// Approximate standard deviation of a corner, which weighs that prior against the corners \[px\] (chosen).
const CORNER_SIGMA_PX: f64 = 0.05;
/// Index of the radial term among them; its centre comes after it.
const RADIAL_INDEX: usize = 8;
/// Parameters of a board's pose: turn and place.
const POSE_PARAMETERS: usize = 3;
/// Weight of a centre's place among the corners' squares \[px²\]: where it may move, and where it must not.
const CENTRE_WEIGHT_FREE_PX2: f64 =
    (CORNER_SIGMA_PX / CENTRE_SIGMA_HALF_DIAGONALS) * (CORNER_SIGMA_PX / CENTRE_SIGMA_HALF_DIAGONALS);
const CENTRE_WEIGHT_FIXED_PX2: f64 = 1e9;
/// Smallest decrease of the corners' squares for which the centre is moved, in variances of a corner: 1 chance in 1000 that it is noise.
const CENTRE_CHI_SQUARE_MIN: f64 = 13.8;
/// A corner is misread if it is off by more than this many standard deviations and by more than this many pixels (both chosen).
const MISREAD_SIGMAS: f64 = 6.0;
const MISREAD_PX: f64 = 0.3;
/// Largest share of a picture's corners that is set aside as misread (chosen): more are no mistake of single corners.
const MISREAD_SHARE_MAX: f64 = 0.06;
/// Median of a length in two dimensions, in standard deviations of either.
const MEDIAN_LENGTH_SIGMAS: f64 = 1.177_410_022_515_474_7;

/// A corner, ready for the fit.
#[derive(Debug, Clone, Copy)]
struct Point {
    picture: usize,
    /// Place in the picture, from its centre, in half diagonals.
    in_picture: Vector2<f64>,
    /// On the board \[m\].
    board: Vector2<f64>,
    /// Approximate pixels per metre there: corners are equally accurate in pixels.
    px_per_m: f64,
    used: bool,
}

/// The unknowns.
#[derive(Debug, Clone)]
struct State {
    /// Straight places to metres; its last number is 1.
    map: Matrix3<f64>,
    /// Radial term by half diagonals squared.
    radial: f64,
    /// Its centre \[half diagonals\].
    centre: Vector2<f64>,
    /// Turn \[rad\] and place \[m\] of each picture's board in the first one's.
    poses: Vec<(f64, Vector2<f64>)>,
}

/// The plane that all `pictures` of `size_px` show. Its world is arbitrary until [`super::world`] lays it.
///
/// # Errors
/// [`FitError`].
pub fn fit(pictures: &[ObservedCorners], size_px: [u32; 2]) -> Result<Fit, FitError> {
    let centre = size_px.map(|side| (f64::from(side) - 1.0) / 2.0);
    let unit = f64::from(size_px[0]).hypot(f64::from(size_px[1])) / 2.0;
    let in_picture = |px: Px| (Vector2::from(px) - Vector2::from(centre)) / unit;
    let maps = pictures.iter().enumerate().map(|(picture, corners)| {
        let pairs: Vec<_> =
            corners.iter().map(|&(px, board)| (in_picture(px), Vector2::from(board))).collect();
        homography(&pairs).ok_or(FitError::Singular { picture })
    });
    let maps = maps.collect::<Result<Vec<_>, _>>()?;
    let Some(first) = (0..pictures.len()).max_by_key(|&i| (pictures[i].len(), std::cmp::Reverse(i))) else {
        return Err(FitError::Diverged);
    };
    let map = maps[first] / maps[first][(2, 2)];
    let mut points: Vec<Point> = Vec::new();
    for (picture, corners) in pictures.iter().enumerate() {
        for &(px, board) in corners {
            let in_picture = in_picture(px);
            let px_per_m = unit / slope(&maps[picture], in_picture).determinant().abs().sqrt();
            points.push(Point { picture, in_picture, board: board.into(), px_per_m, used: true });
        }
    }
    let poses = (0..pictures.len())
        .map(|picture| {
            let corners = points.iter().filter(|point| point.picture == picture);
            rigid_motion(corners.map(|point| (point.board, project(&map, point.in_picture))))
        })
        .collect();
    let mut state = State { map, radial: 0.0, centre: Vector2::zeros(), poses };
    state = search(&points, state, first, CENTRE_WEIGHT_FIXED_PX2)?;
    let moved = search(&points, state.clone(), first, CENTRE_WEIGHT_FREE_PX2)?;
    if set_aside(&mut points, &moved) {
        state = search(&points, state, first, CENTRE_WEIGHT_FIXED_PX2)?;
    }
    let moved = search(&points, state.clone(), first, CENTRE_WEIGHT_FREE_PX2)?;
    let held = state.residuals(&points, CENTRE_WEIGHT_FIXED_PX2).norm_squared();
    let free = moved.residuals(&points, CENTRE_WEIGHT_FREE_PX2).norm_squared();
    let unknowns = PLANE_PARAMETERS + POSE_PARAMETERS * (pictures.len() - 1);
    let numbers = 2 * points.iter().filter(|point| point.used).count();
    if held - free > CENTRE_CHI_SQUARE_MIN * free / numbers.saturating_sub(unknowns).max(1) as f64 {
        state = moved;
    }
    let normal =
        Matrix3::new(1.0 / unit, 0.0, -centre[0] / unit, 0.0, 1.0 / unit, -centre[1] / unit, 0.0, 0.0, 1.0);
    let radial_per_px2 = state.radial / (unit * unit);
    let radial_centre = Vector2::from(centre) + state.centre * unit;
    let plane =
        Plane::new(state.map * normal, radial_centre.into(), radial_per_px2).ok_or(FitError::Diverged)?;
    let each = |picture: usize| points.iter().filter(move |point| point.picture == picture);
    Ok(Fit {
        plane,
        errors_m: (0..pictures.len())
            .map(|picture| each(picture).map(|point| state.error(point).norm()).collect())
            .collect(),
        misread: (0..pictures.len())
            .map(|picture| each(picture).map(|point| !point.used).collect())
            .collect(),
    })
}

impl State {
    /// Undistorted place of one in the picture.
    fn straight(&self, in_picture: Vector2<f64>) -> Vector2<f64> {
        let off = in_picture - self.centre;
        self.centre + off * (1.0 + self.radial * off.norm_squared())
    }

    /// How far the corner is from where its board has it \[m\].
    fn error(&self, point: &Point) -> Vector2<f64> {
        let (turn, place) = self.poses[point.picture];
        project(&self.map, self.straight(point.in_picture)) - (Rotation2::new(turn) * point.board + place)
    }

    /// Errors of the corners and of the radial term's centre \[px\].
    fn residuals(&self, points: &[Point], centre_weight: f64) -> DVector<f64> {
        let used = points.iter().filter(|point| point.used);
        let corners = used.map(|point| self.error(point) * point.px_per_m);
        let errors = corners.chain([self.centre * centre_weight.sqrt()]);
        DVector::from_vec(errors.flat_map(|error| [error.x, error.y]).collect())
    }

    /// Moved by `step`, in the order of [`normal_equations`].
    fn moved(&self, step: &DVector<f64>, first: usize) -> Self {
        let mut new = self.clone();
        for i in 0..RADIAL_INDEX {
            new.map[(i / 3, i % 3)] += step[i];
        }
        new.radial += step[RADIAL_INDEX];
        new.centre += Vector2::new(step[RADIAL_INDEX + 1], step[RADIAL_INDEX + 2]);
        for (picture, pose) in new.poses.iter_mut().enumerate() {
            if let Some(at) = pose_at(picture, first) {
                pose.0 += step[at];
                pose.1 += Vector2::new(step[at + 1], step[at + 2]);
            }
        }
        new
    }
}

/// Where a picture's pose stands among the unknowns; the first board is the world.
fn pose_at(picture: usize, first: usize) -> Option<usize> {
    let poses_before = picture - usize::from(picture > first);
    (picture != first).then_some(PLANE_PARAMETERS + POSE_PARAMETERS * poses_before)
}

/// Derivative of the projection at a place, shape (2, 2).
pub(super) fn slope(map: &Matrix3<f64>, at: Vector2<f64>) -> Matrix2<f64> {
    let image = project(map, at);
    let weight = map[(2, 0)] * at.x + map[(2, 1)] * at.y + map[(2, 2)];
    Matrix2::from_fn(|i, j| (map[(i, j)] - image[i] * map[(2, j)]) / weight)
}

/// Normal equations of [`State::residuals`]; each corner depends on few of the unknowns.
fn normal_equations(points: &[Point], state: &State, first: usize, centre_weight: f64) -> NormalEquations {
    let size = PLANE_PARAMETERS + POSE_PARAMETERS * (state.poses.len() - 1);
    let (mut hessian, mut gradient) = (DMatrix::zeros(size, size), DVector::zeros(size));
    for point in points.iter().filter(|point| point.used) {
        let straight = state.straight(point.in_picture);
        let (map, image) = (&state.map, project(&state.map, straight));
        let weight = map[(2, 0)] * straight.x + map[(2, 1)] * straight.y + map[(2, 2)];
        let off = point.in_picture - state.centre;
        let slope = slope(map, straight);
        let with_radial = slope * off * off.norm_squared();
        let with_centre =
            -state.radial * slope * (Matrix2::identity() * off.norm_squared() + 2.0 * off * off.transpose());
        let error = state.error(point);
        let (turn, _) = state.poses[point.picture];
        let with_turn = Rotation2::new(turn + std::f64::consts::FRAC_PI_2) * point.board;
        let pose = pose_at(point.picture, first);
        for axis in 0..2 {
            let mut row = [(0, 0.0); 10];
            for (j, coordinate) in [straight.x, straight.y, 1.0].into_iter().enumerate() {
                row[j] = (3 * axis + j, coordinate / weight);
            }
            row[3] = (6, -image[axis] * straight.x / weight);
            row[4] = (7, -image[axis] * straight.y / weight);
            row[5] = (RADIAL_INDEX, with_radial[axis]);
            row[6] = (RADIAL_INDEX + 1, with_centre[(axis, 0)]);
            row[7] = (RADIAL_INDEX + 2, with_centre[(axis, 1)]);
            if let Some(at) = pose {
                row[8] = (at, -with_turn[axis]);
                row[9] = (at + 1 + axis, -1.0);
            }
            for &(i, a) in &row {
                gradient[i] += a * error[axis] * point.px_per_m.powi(2);
                for &(j, b) in &row {
                    hessian[(i, j)] += a * b * point.px_per_m.powi(2);
                }
            }
        }
    }
    for axis in 0..2 {
        let i = RADIAL_INDEX + 1 + axis;
        hessian[(i, i)] += centre_weight;
        gradient[i] += centre_weight * state.centre[axis];
    }
    NormalEquations { hessian, gradient }
}

fn search(points: &[Point], start: State, first: usize, centre_weight: f64) -> Result<State, FitError> {
    let found = SEARCH.minimise(
        start,
        |state| state.residuals(points, centre_weight),
        |state, _| normal_equations(points, state, first, centre_weight),
        |state, step| state.moved(step, first),
    );
    if found.converged { Ok(found.point) } else { Err(FitError::Diverged) }
}

/// Marks corners as misread; whether there are any.
fn set_aside(points: &mut [Point], state: &State) -> bool {
    let errors_px: Vec<f64> = points.iter().map(|point| state.error(point).norm() * point.px_per_m).collect();
    let middle = median(&mut errors_px.clone(), f64::total_cmp).unwrap_or(0.0);
    let sigma = middle / MEDIAN_LENGTH_SIGMAS;
    let limit = (MISREAD_SIGMAS * sigma).max(MISREAD_PX);
    for picture in 0..state.poses.len() {
        let of = |i: &usize| points[*i].picture == picture;
        let all: Vec<usize> = (0..points.len()).filter(of).collect();
        let bad: Vec<usize> = all.iter().copied().filter(|&i| errors_px[i] > limit).collect();
        if bad.len() as f64 <= MISREAD_SHARE_MAX * all.len() as f64 {
            bad.into_iter().for_each(|i| points[i].used = false);
        }
    }
    points.iter().any(|point| !point.used)
}

/// Turn \[rad\] and shift that bring the first of each pair nearest to the second.
fn rigid_motion(pairs: impl Iterator<Item = (Vector2<f64>, Vector2<f64>)> + Clone) -> (f64, Vector2<f64>) {
    let count = pairs.clone().count().max(1) as f64;
    let (from, to) =
        pairs.clone().fold((Vector2::zeros(), Vector2::zeros()), |(from, to), (a, b)| (from + a, to + b));
    let (from, to): (Vector2<f64>, Vector2<f64>) = (from / count, to / count);
    let (sine, cosine) = pairs.fold((0.0, 0.0), |(sine, cosine), (a, b)| {
        let (a, b) = (a - from, b - to);
        (sine + a.perp(&b), cosine + a.dot(&b))
    });
    let turn = sine.atan2(cosine);
    (turn, to - Rotation2::new(turn) * from)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE_PX: [u32; 2] = [1280, 720];
    /// Error of exact corners that the prior of the radial centre causes \[m\].
    const CENTRE_PRIOR_ERROR_M: f64 = 3e-7;

    /// The corners that a camera of `plane` sees of boards of 9 x 6 corners that are turned and moved.
    fn corners(plane: &Plane, rows: usize) -> Vec<ObservedCorners> {
        let board = |(turn, x, z): (f64, f64, f64)| {
            let corner = |k: usize| {
                let board = [0.02 * (k % 9) as f64, 0.02 * (k / 9) as f64];
                let place = Rotation2::new(turn) * Vector2::from(board) + Vector2::new(x, z);
                (plane.pixel(place.into()), board)
            };
            (0..9 * rows).map(corner).collect()
        };
        [(0.0, -0.2, -0.1), (0.4, 0.0, -0.1), (2.0, 0.1, 0.0), (-1.5, -0.15, 0.1)].map(board).into()
    }

    #[test]
    fn plane_is_found_from_boards_that_lie_anywhere_in_it() {
        // Tilted, with a radial term about another place than the middle.
        let map = Matrix3::new(4e-4, 1e-6, -0.25, -2e-6, -4.2e-4, 0.15, 4e-5, 2e-5, 1.0);
        let plane = Plane::new(map, [600.0, 400.0], -4e-8).unwrap();
        let pictures = corners(&plane, 6);
        let fit = fit(&pictures, SIZE_PX).unwrap();
        let worst_m = fit.errors_m.iter().flatten().copied().fold(0.0, f64::max);
        assert!(worst_m < CENTRE_PRIOR_ERROR_M, "{worst_m}");
        assert!((fit.plane.radial_per_px2() / -4e-8 - 1.0).abs() < 1e-3, "{}", fit.plane.radial_per_px2());
        let centre = fit.plane.radial_centre_px();
        assert!((centre[0] - 600.0).hypot(centre[1] - 400.0) < 1.0, "{centre:?}");
        // Distances in the plane are what they are, whatever world the fit has chosen.
        let apart = |plane: &Plane, a: Px, b: Px| {
            (Vector2::from(plane.metres(a)) - Vector2::from(plane.metres(b))).norm()
        };
        for (a, b) in [([200.0, 200.0], [900.0, 500.0]), ([640.0, 300.0], [650.0, 600.0])] {
            let off_m = apart(&fit.plane, a, b) - apart(&plane, a, b);
            assert!(off_m.abs() < 10.0 * CENTRE_PRIOR_ERROR_M, "{off_m}");
        }
    }

    #[test]
    fn corners_on_a_line_are_refused_with_their_picture() {
        let plane = Plane::square(4e-4, [640.0, 360.0]);
        let mut pictures = corners(&plane, 6);
        pictures[2].truncate(9);
        assert_eq!(fit(&pictures, SIZE_PX), Err(FitError::Singular { picture: 2 }));
        assert!(fit(&[], SIZE_PX).is_err());
    }
}
