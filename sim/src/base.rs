//! A base that moves: a path in the picture's plane, for rigs that are towed, heaved or carried by something that swims.

use crate::dynamics::Poses;
use crate::math::{Mat3, Vec3};
use crate::scalar::{Mask, Scalar};

/// A place and an angle in the picture's plane: x to the right \[m\], z up \[m\], counter-clockwise as the camera sees it \[rad\].
pub type PlanarPose<T = f64> = [T; 3];

/// Where the base is over time. Everything that the model fastens to the world moves with it: at the pose 0, 0, 0 it stands as
/// the model says.
///
/// Between its rows the path is the cubic spline through them, whose velocity and acceleration have no jumps; the third derivative has
/// none at the second row and the last but one either (not-a-knot). Two rows make a straight line, three a parabola. Before the first row and
/// after the last the path goes straight on.
#[derive(Debug, Clone, PartialEq)]
pub struct BasePath {
    time_s: Vec<f64>,
    pose: Vec<PlanarPose>,
    /// Pieces in order of time: what is before the first row, between each two, after the last.
    pieces: Vec<Piece>,
}

/// A cubic in the time since a row, of each coordinate.
#[derive(Debug, Clone, PartialEq)]
struct Piece {
    from_s: f64,
    powers: [[f64; 4]; 3],
}

/// Pose, velocity and acceleration at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaseMotion<T = f64> {
    /// Place \[m\] and angle \[rad\].
    pub pose: PlanarPose<T>,
    /// Velocity \[m/s\] and rate \[rad/s\].
    pub velocity: [T; 3],
    /// Acceleration \[m/s2\] and \[rad/s2\].
    pub acceleration: [T; 3],
}

/// Rows that make no path.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BaseError {
    /// There are none, or not a pose for each time.
    #[error(
        "a base's path needs one row at least and a pose for each time, not {times} times and {poses} poses"
    )]
    Rows {
        /// Number of times.
        times: usize,
        /// Number of poses.
        poses: usize,
    },
    /// A time that is no number or does not rise, or a pose that is no number.
    #[error("row {row} of a base's path: times must be finite and rise, poses must be finite")]
    Row {
        /// Number of the row, counted from 1.
        row: usize,
    },
}

impl BasePath {
    /// The path through `pose` at `time_s` \[s\], which rises.
    ///
    /// # Errors
    /// [`BaseError`].
    pub fn new(time_s: Vec<f64>, pose: Vec<PlanarPose>) -> Result<Self, BaseError> {
        if time_s.is_empty() || time_s.len() != pose.len() {
            return Err(BaseError::Rows { times: time_s.len(), poses: pose.len() });
        }
        let sound = |row: usize| {
            time_s[row].is_finite()
                && (row == 0 || time_s[row - 1] < time_s[row])
                && pose[row].iter().all(|x| x.is_finite())
        };
        if let Some(row) = (0..time_s.len()).find(|&row| !sound(row)) {
            return Err(BaseError::Row { row: row + 1 });
        }
        let bends: [Vec<f64>; 3] = std::array::from_fn(|axis| {
            let values: Vec<f64> = pose.iter().map(|pose| pose[axis]).collect();
            bends(&time_s, &values)
        });
        let last = time_s.len() - 1;
        let mut pieces = Vec::with_capacity(last + 2);
        for row in 0..last {
            let h = time_s[row + 1] - time_s[row];
            let powers = std::array::from_fn(|axis| {
                let (here, there) = (pose[row][axis], pose[row + 1][axis]);
                let (bend, next) = (bends[axis][row], bends[axis][row + 1]);
                let slope = (there - here) / h - h * (2.0 * bend + next) / 6.0;
                [here, slope, 0.5 * bend, (next - bend) / (6.0 * h)]
            });
            pieces.push(Piece { from_s: time_s[row], powers });
        }
        let straight = |row: usize, slopes: [f64; 3]| Piece {
            from_s: time_s[row],
            powers: std::array::from_fn(|axis| [pose[row][axis], slopes[axis], 0.0, 0.0]),
        };
        let slopes = |piece: Option<&Piece>, s: f64| {
            piece.map_or([0.0; 3], |piece| piece.powers.map(|[_, b, c, d]| b + s * (2.0 * c + 3.0 * d * s)))
        };
        let leaving = pieces.last().map_or(0.0, |piece| time_s[last] - piece.from_s);
        let (before, after) = (slopes(pieces.first(), 0.0), slopes(pieces.last(), leaving));
        let (before, after) = (straight(0, before), straight(last, after));
        pieces.insert(0, before);
        pieces.push(after);
        Ok(Self { time_s, pose, pieces })
    }

    /// The rows' times \[s\].
    pub fn time_s(&self) -> &[f64] {
        &self.time_s
    }

    /// Poses of the base, one a row: x, z \[m\] and angle \[rad\].
    pub fn poses(&self) -> &[PlanarPose] {
        &self.pose
    }

    /// The last time \[s\] before the base moves: the end of the leading rows that all agree. `None` when it never moves.
    pub fn first_motion_s(&self) -> Option<f64> {
        let moved = self.pose.iter().position(|pose| *pose != self.pose[0])?;
        Some(self.time_s[moved - 1])
    }

    /// How the base moves at `time_s` \[s\].
    pub fn at(&self, time_s: f64) -> BaseMotion {
        self.along(time_s, time_s)
    }

    /// How the base moves at `time` \[s\], which in every lane is near `about_s`.
    #[inline(always)]
    pub(crate) fn along<T: Scalar>(&self, about_s: f64, time: T) -> BaseMotion<T> {
        let last = self.pieces.len() - 1;
        let mut piece = self.time_s.partition_point(|&row_s| row_s <= about_s);
        // lanes may be in other pieces
        let mut first = piece;
        while first > 0 && time.less(T::from_f64(self.pieces[first].from_s)).any() {
            first -= 1;
        }
        while piece < last && !time.less(T::from_f64(self.pieces[piece + 1].from_s)).all() {
            piece += 1;
        }
        let mut motion = self.pieces[first].at(time);
        for piece in &self.pieces[first + 1..=piece] {
            let before = time.less(T::from_f64(piece.from_s));
            let here = piece.at(time);
            for axis in 0..3 {
                motion.pose[axis] = T::select(before, motion.pose[axis], here.pose[axis]);
                motion.velocity[axis] = T::select(before, motion.velocity[axis], here.velocity[axis]);
                motion.acceleration[axis] =
                    T::select(before, motion.acceleration[axis], here.acceleration[axis]);
            }
        }
        motion
    }
}

impl Piece {
    #[inline(always)]
    fn at<T: Scalar>(&self, time: T) -> BaseMotion<T> {
        let s = time - T::from_f64(self.from_s);
        let number = T::from_f64;
        BaseMotion {
            pose: self
                .powers
                .map(|[a, b, c, d]| number(a) + s * (number(b) + s * (number(c) + s * number(d)))),
            velocity: self.powers.map(|[_, b, c, d]| number(b) + s * (number(2.0 * c) + s * number(3.0 * d))),
            acceleration: self.powers.map(|[_, _, c, d]| number(2.0 * c) + s * number(6.0 * d)),
        }
    }
}

impl BaseMotion {
    /// Where a point is in the world that stands at `at` \[m\] while the base is at 0, 0, 0.
    pub fn place(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [base_x, base_z, angle] = self.pose;
        let (sin, cos) = angle.sin_cos();
        [base_x + cos * x - sin * z, y, base_z + sin * x + cos * z]
    }

    /// Where everything is that stands at `poses` while the base is at 0, 0, 0.
    pub fn carried(&self, poses: &Poses) -> Poses {
        let angle = self.pose[2];
        // counter-clockwise as the camera sees it is about -y
        let turn = Mat3::about(Vec3([0.0, -1.0, 0.0]), angle.sin_cos());
        let places = |places: &[Vec3<f64>]| places.iter().map(|at| Vec3(self.place(at.0))).collect();
        let turns = |turns: &[Mat3<f64>]| turns.iter().map(|own| turn.product(own)).collect();
        Poses {
            body_pos: places(&poses.body_pos),
            body_rot: turns(&poses.body_rot),
            geom_pos: places(&poses.geom_pos),
            geom_rot: turns(&poses.geom_rot),
            site_pos: places(&poses.site_pos),
        }
    }

    /// Where a point that is at `at` \[m\] in the world would stand with the base at 0, 0, 0.
    pub fn back(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [base_x, base_z, angle] = self.pose;
        let (sin, cos) = angle.sin_cos();
        let (x, z) = (x - base_x, z - base_z);
        [cos * x + sin * z, y, cos * z - sin * x]
    }
}

/// Second derivatives at the rows of the not-a-knot cubic spline through `values`.
fn bends(time_s: &[f64], values: &[f64]) -> Vec<f64> {
    let rows = values.len();
    let mut bends = vec![0.0; rows];
    let h: Vec<f64> = time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let slope: Vec<f64> = (1..rows).map(|row| (values[row] - values[row - 1]) / h[row - 1]).collect();
    if rows < 3 {
        return bends;
    }
    if rows == 3 {
        bends.fill(2.0 * (slope[1] - slope[0]) / (h[0] + h[1]));
        return bends;
    }
    // the second derivatives inside, tridiagonal; what the first and the last are, the ends' condition says
    let inner = rows - 2;
    let mut diagonal: Vec<f64> = (0..inner).map(|k| 2.0 * (h[k] + h[k + 1])).collect();
    let mut lower: Vec<f64> = (0..inner).map(|k| h[k]).collect();
    let mut upper: Vec<f64> = (0..inner).map(|k| h[k + 1]).collect();
    let mut right: Vec<f64> = (0..inner).map(|k| 6.0 * (slope[k + 1] - slope[k])).collect();
    let (start, end) = (h[0] / h[1], h[rows - 2] / h[rows - 3]);
    diagonal[0] += h[0] * (1.0 + start);
    upper[0] -= h[0] * start;
    diagonal[inner - 1] += h[rows - 2] * (1.0 + end);
    lower[inner - 1] -= h[rows - 2] * end;
    for k in 1..inner {
        let share = lower[k] / diagonal[k - 1];
        diagonal[k] -= share * upper[k - 1];
        right[k] -= share * right[k - 1];
    }
    for k in (0..inner).rev() {
        let above = if k + 1 < inner { upper[k] * bends[k + 2] } else { 0.0 };
        bends[k + 1] = (right[k] - above) / diagonal[k];
    }
    bends[0] = bends[1] + start * (bends[1] - bends[2]);
    bends[rows - 1] = bends[rows - 2] + end * (bends[rows - 2] - bends[rows - 3]);
    bends
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dual::Dual;

    fn cubic(t: f64) -> PlanarPose {
        [1.0 - 2.0 * t + t.powi(3), 0.5 * t * t, -t.powi(3) + 0.25 * t]
    }

    #[test]
    fn cubics_come_back_exactly_with_their_derivatives() {
        let time_s = vec![0.0, 0.3, 0.5, 0.9, 1.0, 1.6];
        let path = BasePath::new(time_s.clone(), time_s.iter().map(|&t| cubic(t)).collect()).unwrap();
        for t in [0.0, 0.11, 0.3, 0.72, 1.0, 1.59] {
            let at = path.at(t);
            let velocity = [-2.0 + 3.0 * t * t, t, -3.0 * t * t + 0.25];
            let acceleration = [6.0 * t, 1.0, -6.0 * t];
            for axis in 0..3 {
                assert!((at.pose[axis] - cubic(t)[axis]).abs() < 1e-12, "{t} {at:?}");
                assert!((at.velocity[axis] - velocity[axis]).abs() < 1e-11, "{t} {at:?}");
                assert!((at.acceleration[axis] - acceleration[axis]).abs() < 1e-9, "{t} {at:?}");
            }
        }
        // straight on beyond the last row
        let (end, beyond) = (path.at(1.6), path.at(1.8));
        assert!((beyond.pose[0] - end.pose[0] - 0.2 * end.velocity[0]).abs() < 1e-12, "{beyond:?}");
        assert_eq!(beyond.acceleration, [0.0; 3]);
    }

    #[test]
    fn a_sine_is_followed_to_the_fourth_power_of_the_rows_distance() {
        let worst = |rows: u32| {
            let time_s: Vec<f64> = (0..=rows).map(|k| f64::from(k) / f64::from(rows)).collect();
            let pose = time_s.iter().map(|t| [(6.0 * t).sin(), 0.0, 0.0]).collect();
            let path = BasePath::new(time_s, pose).unwrap();
            let off =
                |k: u32| (path.at(f64::from(k) / 1000.0).pose[0] - (6.0 * f64::from(k) / 1000.0).sin()).abs();
            (0..=1000).map(off).fold(0.0, f64::max)
        };
        let (coarse, fine) = (worst(20), worst(40));
        assert!(coarse < 1e-3 && coarse / fine > 10.0, "{coarse:e} {fine:e}");
    }

    #[test]
    fn few_rows_stand_still_go_straight_or_along_a_parabola() {
        let still = BasePath::new(vec![1.0], vec![[1.0, 2.0, 3.0]]).unwrap();
        assert_eq!(
            still.at(5.0),
            BaseMotion { pose: [1.0, 2.0, 3.0], velocity: [0.0; 3], acceleration: [0.0; 3] }
        );
        let two = BasePath::new(vec![0.0, 2.0], vec![[0.0; 3], [1.0, 0.0, 0.0]]).unwrap();
        assert_eq!((two.at(-1.0).pose[0], two.at(1.0).pose[0], two.at(3.0).pose[0]), (-0.5, 0.5, 1.5));
        let three =
            BasePath::new(vec![0.0, 1.0, 3.0], [0.0, 1.0, 9.0].map(|x| [x, 0.0, 0.0]).to_vec()).unwrap();
        assert!(
            (three.at(2.0).pose[0] - 4.0).abs() < 1e-12
                && (three.at(0.5).acceleration[0] - 2.0).abs() < 1e-12
        );
        assert_eq!(
            BasePath::new(vec![0.0, 1.0, 2.0], vec![[0.0; 3], [0.0; 3], [1.0; 3]]).unwrap().first_motion_s(),
            Some(1.0)
        );
        assert_eq!(BasePath::new(vec![0.0, 0.0], vec![[0.0; 3]; 2]), Err(BaseError::Row { row: 2 }));
        assert_eq!(BasePath::new(vec![], vec![]), Err(BaseError::Rows { times: 0, poses: 0 }));
    }

    #[test]
    fn derivatives_by_time_are_the_velocity_also_far_from_where_they_were_looked_for() {
        let time_s: Vec<f64> = (0..10).map(|k| 0.1 * f64::from(k)).collect();
        let pose = time_s.iter().map(|t| [(5.0 * t).sin(), (3.0 * t).cos(), *t]).collect();
        let path = BasePath::new(time_s, pose).unwrap();
        for (about_s, t) in [(0.42, 0.42), (0.1, 0.67), (0.8, 0.23), (-1.0, 0.5), (2.0, 0.5)] {
            let moving = path.along(about_s, Dual::<f64, 1>::variable(t, 0));
            for axis in 0..3 {
                assert_eq!(moving.pose[axis].value, path.at(t).pose[axis]);
                assert!((moving.pose[axis].partials[0] - path.at(t).velocity[axis]).abs() < 1e-12);
                assert!((moving.velocity[axis].partials[0] - path.at(t).acceleration[axis]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn points_go_with_the_base_and_come_back() {
        let quarter = BaseMotion {
            pose: [1.0, 2.0, std::f64::consts::FRAC_PI_2],
            velocity: [0.0; 3],
            acceleration: [0.0; 3],
        };
        // counter-clockwise as the camera sees it: x turns up
        let [x, y, z] = quarter.place([0.5, 0.1, 0.0]);
        assert!((x - 1.0).abs() < 1e-15 && y == 0.1 && (z - 2.5).abs() < 1e-15);
        let back = quarter.back([x, y, z]);
        assert!((back[0] - 0.5).abs() < 1e-15 && back[1] == 0.1 && back[2].abs() < 1e-15, "{back:?}");
    }
}
