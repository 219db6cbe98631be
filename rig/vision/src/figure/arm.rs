//! A soft arm: a band along a smooth line of a length that it keeps, its half width a smooth function of the way from root
//! to tip, its ends cut square or round.
//!
//! Numbers in order: P0's column and row, the length, the half width at [`WIDTHS`] even places from root to tip; then the
//! coefficients of the heading as a cubic B-spline of the way.

use nalgebra::{DMatrix, DVector};

use super::edges::Rim;
use super::{Figure, Places};
use crate::spline::{arc_lengths, point_at};
use camera::calibration::Px;

/// What is known of an arm.
#[derive(Debug, Clone)]
pub(crate) struct Arm {
    /// P0..Pn at these shares of the length.
    shares: Vec<f64>,
    /// Corner radius of the tip, as a share of its half width.
    rounding: f64,
    /// Whether the root's end shows.
    root_seen: bool,
    /// Pieces of the line.
    pieces: usize,
    /// The spline at the pieces' ends, shape (pieces + 1, [`COEFFICIENTS`]), and at their middles (pieces, ..).
    at_nodes: DMatrix<f64>,
    at_middles: DMatrix<f64>,
}

/// Where the number is.
pub(crate) const LENGTH: usize = 2;
pub(crate) const HALF: usize = 3;
/// How many half widths.
pub(crate) const WIDTHS: usize = 5;
const OWN: usize = HALF + WIDTHS;
/// Of the heading: an arm of eight segments that bend at joints is followed to a few hundredths of its width.
const COEFFICIENTS: usize = 13;
/// How much neighbouring coefficients turn from each other, 1 sigma of the second difference \[rad\]: far more than soft arms
/// do but at joints; it counts where nothing is seen.
const BEND_STD: f64 = 0.06;
/// How well a line's headings are known where a fit begins, 1 sigma \[rad\].
const START_STD: f64 = 0.02;
/// Length of a piece \[px\].
const PIECE_PX: f64 = 2.5;
/// Parts of its outline told apart.
const PARTS: usize = 8;
/// Places on a round corner, and across an end.
const ARC_PLACES: usize = 5;
/// Sides of a drawn round corner.
const ROUND_CORNERS: usize = 12;
const END_SPACING_PX: f64 = 2.0;
/// An edge this near another part's is not told from it \[px\].
const TOUCHING_PX: f64 = 2.5;

/// The line of a pose.
struct Line {
    points: Vec<Px>,
    /// Headings at the points \[rad\].
    heading: Vec<f64>,
    /// Derivatives of each point by the coefficients, shape (points, 2, [`COEFFICIENTS`]).
    by_coefficient: Vec<[[f64; COEFFICIENTS]; 2]>,
}

/// A place beside the line: at node `node`, `half * (a along + b across)`.
struct Local {
    node: usize,
    offset: [f64; 2],
    outward: [f64; 2],
}

impl Arm {
    /// An arm of about `length` \[px\] with P0..Pn at `shares` of it.
    pub(crate) fn new(shares: Vec<f64>, length: f64, rounding: f64, root_seen: bool) -> Self {
        let pieces = ((length / PIECE_PX).ceil() as usize).clamp(2 * COEFFICIENTS, 400);
        let spline = |count: usize, first: f64| {
            let mut values = DMatrix::zeros(count, COEFFICIENTS);
            for i in 0..count {
                let (from, weights) = basis((i as f64 + first) / pieces as f64);
                weights.iter().enumerate().for_each(|(k, weight)| values[(i, from + k)] = *weight);
            }
            values
        };
        let (at_nodes, at_middles) = (spline(pieces + 1, 0.0), spline(pieces, 0.5));
        Self { shares, rounding, root_seen, pieces, at_nodes, at_middles }
    }

    fn bent(&self, pose: &[f64]) -> Line {
        let coefficients = DVector::from_column_slice(&pose[OWN..]);
        let middles = &self.at_middles * &coefficients;
        let step = pose[LENGTH] / self.pieces as f64;
        let mut point = [pose[0], pose[1]];
        let mut by = [[0.0; COEFFICIENTS]; 2];
        let (mut points, mut by_coefficient) = (vec![point], vec![by]);
        for (i, heading) in middles.iter().enumerate() {
            let (sin, cos) = heading.sin_cos();
            point = [point[0] + step * cos, point[1] + step * sin];
            for (k, weight) in self.at_middles.row(i).iter().enumerate() {
                by[0][k] -= step * sin * weight;
                by[1][k] += step * cos * weight;
            }
            points.push(point);
            by_coefficient.push(by);
        }
        Line { points, heading: (&self.at_nodes * coefficients).as_slice().to_vec(), by_coefficient }
    }

    /// Half width at `share` of the length, its slope by the share, and what each number counts in it.
    fn half(pose: &[f64], share: f64) -> (f64, f64, [f64; WIDTHS]) {
        let x = share * (WIDTHS - 1) as f64;
        let i = (x as usize).min(WIDTHS - 2);
        let mut weights = [0.0; WIDTHS];
        (weights[i], weights[i + 1]) = (1.0 - (x - i as f64), x - i as f64);
        let [from, to] = [pose[HALF + i], pose[HALF + i + 1]];
        (weights[i] * from + weights[i + 1] * to, (to - from) * (WIDTHS - 1) as f64, weights)
    }

    fn locals(&self, pose: &[f64]) -> Vec<Local> {
        let mut out = Vec::new();
        let tip = pose[HALF + WIDTHS - 1];
        let corner = self.rounding * tip;
        for node in 1..self.pieces {
            let share = node as f64 / self.pieces as f64;
            if (1.0 - share) * pose[LENGTH] < corner {
                break;
            }
            let narrowing = Self::half(pose, share).1 / pose[LENGTH];
            let norm = narrowing.hypot(1.0);
            for side in [-1.0, 1.0] {
                out.push(Local { node, offset: [0.0, side], outward: [-narrowing / norm, side / norm] });
            }
        }
        let flat = |node: usize, way: f64, reach: f64, half: f64, out: &mut Vec<Local>| {
            let count = (2.0 * reach * half / END_SPACING_PX).ceil() as usize;
            for k in 0..count {
                let b = reach * (2.0 * (k as f64 + 0.5) / count as f64 - 1.0);
                out.push(Local { node, offset: [0.0, b], outward: [way, 0.0] });
            }
        };
        if self.root_seen {
            flat(0, -1.0, 1.0, pose[HALF], &mut out);
        }
        flat(self.pieces, 1.0, 1.0 - self.rounding, tip, &mut out);
        for k in 0..if self.rounding > 0.0 { ARC_PLACES } else { 0 } {
            let turn = std::f64::consts::FRAC_PI_2 * (k as f64 + 0.5) / ARC_PLACES as f64;
            for side in [-1.0, 1.0] {
                let outward = [turn.cos(), side * turn.sin()];
                let offset = [
                    self.rounding * (outward[0] - 1.0),
                    side * (1.0 - self.rounding) + self.rounding * outward[1],
                ];
                out.push(Local { node: self.pieces, offset, outward });
            }
        }
        out
    }
}

/// The first of the four coefficients of a cubic B-spline that count at `share` of its range, and how much.
fn basis(share: f64) -> (usize, [f64; 4]) {
    let x = share * (COEFFICIENTS - 3) as f64;
    let i = (x as usize).min(COEFFICIENTS - 4);
    let t = x - i as f64;
    let weights = [
        (1.0 - t).powi(3),
        3.0 * t.powi(3) - 6.0 * t * t + 4.0,
        -3.0 * t.powi(3) + 3.0 * t * t + 3.0 * t + 1.0,
        t.powi(3),
    ];
    (i, weights.map(|weight| weight / 6.0))
}

impl Figure for Arm {
    fn size(&self) -> usize {
        OWN + COEFFICIENTS
    }

    fn shared(&self) -> usize {
        OWN
    }

    fn parts(&self) -> usize {
        PARTS
    }

    fn places(&self, pose: &[f64]) -> Places {
        let size = self.size();
        let line = self.bent(pose);
        let mut places = Places::default();
        for local in self.locals(pose) {
            let (node, share) = (local.node, local.node as f64 / self.pieces as f64);
            let (half, _, weights) = Self::half(pose, share);
            let (sin, cos) = line.heading[node].sin_cos();
            let turned = |[a, b]: [f64; 2]| [a * cos - b * sin, a * sin + b * cos];
            let (offset, outward, middle) = (turned(local.offset), turned(local.outward), line.points[node]);
            let at = [middle[0] + half * offset[0], middle[1] + half * offset[1]];
            if self.touched(&line, pose, node, at) {
                continue;
            }
            let part = ((share * PARTS as f64) as usize).min(PARTS - 1);
            places.rims.push(Rim { at, outward, part });
            let from = places.slopes.len();
            places.slopes.resize(from + size, 0.0);
            let slope = &mut places.slopes[from..];
            slope[..2].copy_from_slice(&outward);
            let way = [middle[0] - pose[0], middle[1] - pose[1]];
            slope[LENGTH] = (outward[0] * way[0] + outward[1] * way[1]) / pose[LENGTH];
            let by_half = local.outward[0] * local.offset[0] + local.outward[1] * local.offset[1];
            weights.iter().enumerate().for_each(|(k, weight)| slope[HALF + k] = by_half * weight);
            // Turned by a small angle, (a, b) goes by (-b, a).
            let by_turn = half * (local.outward[1] * local.offset[0] - local.outward[0] * local.offset[1]);
            for k in 0..COEFFICIENTS {
                let by = [0, 1].map(|axis| line.by_coefficient[node][axis][k]);
                slope[OWN + k] = outward[0] * by[0] + outward[1] * by[1] + by_turn * self.at_nodes[(node, k)];
            }
        }
        places
    }

    fn points(&self, pose: &[f64]) -> (Vec<Px>, Vec<f64>) {
        let size = self.size();
        let line = self.bent(pose);
        let mut slopes = vec![0.0; 2 * self.shares.len() * size];
        let mut points = Vec::with_capacity(self.shares.len());
        for (i, share) in self.shares.iter().enumerate() {
            let x = share * self.pieces as f64;
            let node = (x as usize).min(self.pieces - 1);
            let between = |from: f64, to: f64| from + (x - node as f64) * (to - from);
            let point = [0, 1].map(|axis| between(line.points[node][axis], line.points[node + 1][axis]));
            for axis in 0..2 {
                let slope = &mut slopes[(2 * i + axis) * size..][..size];
                slope[axis] = 1.0;
                slope[LENGTH] = (point[axis] - pose[axis]) / pose[LENGTH];
                for k in 0..COEFFICIENTS {
                    slope[OWN + k] =
                        between(line.by_coefficient[node][axis][k], line.by_coefficient[node + 1][axis][k]);
                }
            }
            points.push(point);
        }
        (points, slopes)
    }

    fn start(&self, shared: &[f64], line: &[Px]) -> Vec<f64> {
        let line = if self.root_seen { line } else { &Self::joined(shared, line)[..] };
        let lengths = arc_lengths(line);
        let seen = lengths.last().copied().unwrap_or(0.0);
        let step = shared[LENGTH] / self.pieces as f64;
        let mut normal = self.stiffness().view((OWN, OWN), (COEFFICIENTS, COEFFICIENTS)).into_owned();
        let mut right = DVector::zeros(COEFFICIENTS);
        let mut last: Option<f64> = None;
        // From the tip back as far as the line goes.
        for i in (0..self.pieces).rev() {
            let to = seen - (self.pieces - 1 - i) as f64 * step;
            if to - step < 0.0 {
                break;
            }
            let [a, b] = [to - step, to].map(|s| point_at(line, &lengths, s));
            let mut heading = (b[1] - a[1]).atan2(b[0] - a[0]);
            if let Some(last) = last {
                heading -= std::f64::consts::TAU * ((heading - last) / std::f64::consts::TAU).round();
            }
            last = Some(heading);
            let row = self.at_middles.row(i).transpose();
            normal += START_STD.powi(-2) * &row * row.transpose();
            right += START_STD.powi(-2) * heading * &row;
        }
        let coefficients = normal.cholesky().map(|normal| normal.solve(&right));
        let coefficients = coefficients.map_or(vec![0.0; COEFFICIENTS], |found| found.as_slice().to_vec());
        shared.iter().copied().chain(coefficients).collect()
    }

    fn stiffness(&self) -> DMatrix<f64> {
        let mut precision = DMatrix::zeros(self.size(), self.size());
        let bend = [1.0, -2.0, 1.0];
        for first in 0..COEFFICIENTS - 2 {
            for (i, a) in bend.iter().enumerate() {
                for (j, b) in bend.iter().enumerate() {
                    precision[(OWN + first + i, OWN + first + j)] += a * b * BEND_STD.powi(-2);
                }
            }
        }
        precision
    }

    fn line(&self, pose: &[f64]) -> Vec<Px> {
        self.bent(pose).points
    }

    fn polygons(&self, pose: &[f64]) -> Vec<Vec<Px>> {
        let line = self.bent(pose);
        let beside = |node: usize, along: f64, across: f64| -> Px {
            let (sin, cos) = line.heading[node].sin_cos();
            let half = Self::half(pose, node as f64 / self.pieces as f64).0;
            let [x, y] = line.points[node];
            [x + half * (along * cos - across * sin), y + half * (along * sin + across * cos)]
        };
        // Where the round tip begins its corners take over.
        let tip = self.rounding * pose[HALF + WIDTHS - 1];
        let straight = |node: usize| (1.0 - node as f64 / self.pieces as f64) * pose[LENGTH] >= tip;
        let end = (0..=self.pieces).rev().find(|node| straight(*node)).unwrap_or(0).max(1);
        let piece = |node: usize| {
            let next = node + 1;
            vec![
                beside(node, 0.0, -1.0),
                beside(next, 0.0, -1.0),
                beside(next, 0.0, 1.0),
                beside(node, 0.0, 1.0),
            ]
        };
        let mut polygons: Vec<Vec<Px>> = (0..end).map(piece).collect();
        let corner = |k: usize, side: f64| {
            let (sin, cos) = (std::f64::consts::FRAC_PI_2 * k as f64 / ROUND_CORNERS as f64).sin_cos();
            let r = self.rounding;
            beside(self.pieces, r * (sin - 1.0), side * (1.0 - r + r * cos))
        };
        if self.rounding > 0.0 {
            let mut cap = vec![beside(end, 0.0, 1.0), beside(end, 0.0, -1.0)];
            cap.extend((0..=ROUND_CORNERS).map(|k| corner(k, -1.0)));
            cap.extend((0..=ROUND_CORNERS).rev().map(|k| corner(k, 1.0)));
            polygons.push(cap);
        }
        polygons
    }
}

impl Arm {
    /// `line` from the hidden base on: where what hides it cuts it, it turns into a corner.
    fn joined(shared: &[f64], line: &[Px]) -> Vec<Px> {
        let lengths = arc_lengths(line);
        let bent = lengths.partition_point(|length| *length < shared[HALF]).min(line.len() - 2);
        std::iter::once([shared[0], shared[1]]).chain(line[bent..].iter().copied()).collect()
    }

    /// Whether another part of the arm lies over `at`, which is beside `node`.
    fn touched(&self, line: &Line, pose: &[f64], node: usize, at: Px) -> bool {
        /// Every so many-th node is looked at: the arm is wider than their steps.
        const STRIDE: usize = 4;
        let widest = pose[HALF..OWN].iter().copied().fold(0.0, f64::max);
        // Neighbours along the line reach `at` as well where it bends.
        let own = (4.0 * widest * self.pieces as f64 / pose[LENGTH]) as usize;
        (0..=self.pieces).step_by(STRIDE).filter(|other| other.abs_diff(node) > own).any(|other| {
            let share = other as f64 / self.pieces as f64;
            let [x, y] = line.points[other];
            (x - at[0]).hypot(y - at[1]) < Self::half(pose, share).0 + TOUCHING_PX
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::tests::slopes_are_the_derivatives;
    use crate::spline::distance;

    const WHERE_A_FIT_BEGINS_PX: f64 = 1.5;

    fn pose(arm: &Arm) -> Vec<f64> {
        let shared = [100.0, 40.0, 200.0, 20.3, 17.0, 13.0, 10.0, 7.1];
        let own = (0..arm.size() - OWN).map(|k| 1.4 + 0.2 * (0.6 * k as f64).sin());
        shared.into_iter().chain(own).collect()
    }

    #[test]
    fn slopes_are_those_of_the_outline() {
        for rounding in [0.0, 0.5, 1.0] {
            let arm = Arm::new(vec![0.0, 0.47, 1.0], 200.0, rounding, true);
            // Sides move with the length along the arm as well, which is no motion outward but for the narrowing.
            slopes_are_the_derivatives(&arm, &pose(&arm));
        }
    }

    #[test]
    fn a_line_gives_its_pose_again_though_its_beginning_is_hidden() {
        let arm = Arm::new(vec![0.0, 0.5, 1.0], 200.0, 0.0, true);
        let pose = pose(&arm);
        let line = arm.line(&pose);
        for seen in [&line[..], &line[8..]] {
            let again = arm.start(&pose[..OWN], seen);
            let apart: f64 =
                arm.line(&again).iter().zip(&line).map(|(a, b)| distance(*a, *b)).fold(0.0, f64::max);
            assert!(apart < WHERE_A_FIT_BEGINS_PX, "{apart}");
        }
    }

    #[test]
    fn length_is_kept_and_the_basis_is_one() {
        let arm = Arm::new(vec![0.0, 0.5, 1.0], 200.0, 0.0, true);
        let lengths = arc_lengths(&arm.line(&pose(&arm)));
        assert!((lengths[lengths.len() - 1] - 200.0).abs() < 1e-9);
        for row in arm.at_nodes.row_iter().chain(arm.at_middles.row_iter()) {
            assert!((row.sum() - 1.0).abs() < 1e-12);
        }
    }
}
