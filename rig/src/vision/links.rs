//! A chain of straight links fitted to the silhouette's edge.
//!
//! A medial axis cuts corners, so equal arc lengths along it are not the joints. Rigid links are rectangles:
//! their long sides tell their lines, the crossings of those the joints, and the ends where the chain sits
//! along them. The fit moves P0, the links' angles and half widths (and the common length, where it is not
//! known) until the edge points lie on the rectangles' outline, with Tukey's weights against screws, dirt and
//! rounded corners. Points near the inner joints take no part: how links overlap there is not modelled.

use nalgebra::{DMatrix, DVector};

use super::background::median;
use super::spline::distance;
use super::{Mask, Px};

/// What is known of the chain before it is seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// Pivot-to-pivot lengths, the last to the tip: \[px\] when `known`, else only their ratios count.
    pub lengths: Vec<f64>,
    /// Whether the lengths are taken as they are.
    pub known: bool,
    /// How far the first link reaches back past P0 \[px\].
    pub overhang: f64,
    /// Corner radius of the free ends, as a share of the half width.
    pub rounding: f64,
    /// P0 where it is not seen, and its sigma \[px\].
    pub base: Option<(Px, f64)>,
}

/// A chain as fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedChain {
    /// P0..Pn \[px\].
    pub points: Vec<Px>,
    /// Sigma of each, per axis \[px\].
    pub std_px: Vec<f64>,
    /// Half width of each link \[px\].
    pub half_width: Vec<f64>,
    /// Robust sigma of the edge points about the outline \[px\].
    pub scatter_px: f64,
}

/// Edge points closer to an inner joint than this many half widths are left out.
const JOINT: f64 = 1.5;
/// Tukey's constant, and the factor from a median size to a sigma.
const TUKEY: f64 = 4.685;
const SIZE_TO_SIGMA: f64 = 1.4826;
/// Neighbouring edge points share pixels, and so their noise.
const CORRELATED: f64 = 1.5;
/// What pixel sampling leaves however many points there are, 1 sigma \[px\]; measured on renders.
const FLOOR_PX: f64 = 0.03;
const ROUNDS: usize = 40;
/// Levenberg's damping, relative to the diagonal: almost none, and so much that nothing moves.
const LEAST_DAMPING: f64 = 1e-9;
const MOST_DAMPING: f64 = 1e9;
/// A step below this ends the fit \[px, and rad times link length\].
const SETTLED_PX: f64 = 1e-4;

/// Parameters in order: P0 x, y; n angles; n half widths; the unit of length when it is not known.
struct Pose {
    base: Px,
    angle: Vec<f64>,
    half: Vec<f64>,
    unit: f64,
}

/// One edge point's distance from the outline and its derivatives.
struct Residual {
    value: f64,
    slope: Vec<f64>,
}

impl Chain {
    /// Fits the chain to edge points, starting from P0..Pn at `start` and half width `half` \[px\].
    ///
    /// `None` when it does not settle or runs out of points.
    pub fn fit(&self, edge: &[Px], start: &[Px], half: f64) -> Option<FittedChain> {
        let n = self.lengths.len();
        let mut pose = Pose {
            base: start[0],
            angle: start.windows(2).map(|p| (p[1][1] - p[0][1]).atan2(p[1][0] - p[0][0])).collect(),
            half: vec![half; n],
            unit: self.unit(start),
        };
        let size = 2 + 2 * n + usize::from(!self.known);
        let mut damping = 1e-3;
        let (mut rows, mut scale) = self.linearised(edge, &pose, None)?;
        let mut cost = self.cost(&rows, scale, &pose);
        for _ in 0..ROUNDS {
            let (normal, right) = self.normal(&rows, scale, &pose, size);
            let settled = loop {
                let mut damped = normal.clone();
                (0..size).for_each(|i| damped[(i, i)] *= 1.0 + damping);
                let step = damped.cholesky()?.solve(&right);
                let next = pose.moved(&step, self.known);
                // The weights' scale stays while steps are compared, or no two costs would be comparable.
                let (next_rows, _) = self.linearised(edge, &next, Some(scale))?;
                if self.cost(&next_rows, scale, &next) <= cost {
                    let length = pose.unit * self.lengths.iter().copied().fold(0.0, f64::max);
                    let size_px =
                        |i: usize| step[i].abs() * if (2..2 + n).contains(&i) { length } else { 1.0 };
                    pose = next;
                    damping = (damping / 10.0).max(LEAST_DAMPING);
                    break (0..size).all(|i| size_px(i) < SETTLED_PX);
                }
                damping *= 10.0;
                if damping > MOST_DAMPING {
                    break true;
                }
            };
            (rows, scale) = self.linearised(edge, &pose, None)?;
            cost = self.cost(&rows, scale, &pose);
            if settled {
                break;
            }
        }
        let (normal, _) = self.normal(&rows, scale, &pose, size);
        let covariance = normal.cholesky()?.inverse() * CORRELATED;
        let std_px = (0..=n).map(|i| self.keypoint_std(i, &pose, &covariance)).collect();
        let points = pose.points(&self.lengths);
        points.iter().flatten().all(|v| v.is_finite()).then_some(FittedChain {
            points,
            std_px,
            half_width: pose.half,
            scatter_px: scale,
        })
    }

    /// The chain's silhouette in the rectangle of `like`.
    pub fn drawn(&self, fitted: &FittedChain, like: &Mask) -> Mask {
        let mut mask = Mask::empty(like.left, like.top, like.width, like.height);
        let pose = Pose {
            base: fitted.points[0],
            angle: fitted.points.windows(2).map(|p| (p[1][1] - p[0][1]).atan2(p[1][0] - p[0][0])).collect(),
            half: fitted.half_width.clone(),
            unit: self.unit(&fitted.points),
        };
        for row in like.top..like.top + like.height {
            for column in like.left..like.left + like.width {
                let p = [column as f64, row as f64];
                let inner_joint = |i: usize| distance(p, fitted.points[i]) <= pose.half[i];
                let n = self.lengths.len();
                if (0..n).any(|i| self.to_link(&pose, &fitted.points, i, p).0 <= 0.0)
                    || (1..n).any(inner_joint)
                {
                    mask.set(column as isize, row as isize);
                }
            }
        }
        mask
    }

    /// Scale from [`Self::lengths`] to pixels of a chain from `points[0]` on.
    fn unit(&self, points: &[Px]) -> f64 {
        if self.known {
            return 1.0;
        }
        let seen: f64 = points.windows(2).map(|p| distance(p[0], p[1])).sum();
        seen / self.lengths.iter().sum::<f64>()
    }

    /// Signed distance of `p` to link `i`'s outline (negative inside), and its derivatives by the link's start
    /// along and across it, by the half width and by the length.
    fn to_link(&self, pose: &Pose, points: &[Px], i: usize, p: Px) -> (f64, [f64; 4], [f64; 2]) {
        let n = self.lengths.len();
        let (sin, cos) = pose.angle[i].sin_cos();
        let d = [p[0] - points[i][0], p[1] - points[i][1]];
        let (u, v) = (cos * d[0] + sin * d[1], cos * d[1] - sin * d[0]);
        let half = pose.half[i];
        let back = self.overhang;
        let front = if i + 1 == n { 0.0 } else { self.overhang };
        let length = self.lengths[i] * pose.unit;
        // Only the chain's free ends are rounded.
        let free = if u < length / 2.0 { i == 0 } else { i + 1 == n };
        let corner = if free { self.rounding * half } else { 0.0 };
        let (beyond, side) = if u < length / 2.0 { (-back - u, -1.0) } else { (u - length - front, 1.0) };
        let (a, b) = (beyond + corner, v.abs() - half + corner);
        let sign_v = if v < 0.0 { -1.0 } else { 1.0 };
        let (value, by_a, by_b) = if a > 0.0 && b > 0.0 && (corner > 0.0 || a.min(b) > 0.0) {
            let r = a.hypot(b);
            (r - corner, a / r, b / r)
        } else if a > b {
            (a - corner, 1.0, 0.0)
        } else {
            (b - corner, 0.0, 1.0)
        };
        let (by_u, by_v) = (by_a * side, by_b * sign_v);
        let by_half = -by_b + if free { self.rounding * (by_a + by_b - 1.0) } else { 0.0 };
        let by_length = if side > 0.0 { -by_a } else { 0.0 };
        (value, [by_u, by_v, by_half, by_length], [u, v])
    }

    /// Every edge point's residual that counts, and their robust sigma unless it is given.
    fn linearised(&self, edge: &[Px], pose: &Pose, scale: Option<f64>) -> Option<(Vec<Residual>, f64)> {
        let n = self.lengths.len();
        let points = pose.points(&self.lengths);
        let size = 2 + 2 * n + usize::from(!self.known);
        let mut rows = Vec::with_capacity(edge.len());
        for &p in edge {
            let near_joint = |j: usize| distance(p, points[j]) < JOINT * pose.half[j].max(pose.half[j - 1]);
            let near_base =
                self.base.is_some() && self.to_link(pose, &points, 0, p).2[0] < -self.overhang + pose.half[0];
            if (1..n).any(near_joint) || near_base {
                continue;
            }
            let links = (0..n).map(|i| (i, self.to_link(pose, &points, i, p)));
            let nearest = links.min_by(|a, b| a.1.0.partial_cmp(&b.1.0).unwrap_or(std::cmp::Ordering::Equal));
            let (i, (value, [by_u, by_v, by_half, by_length], [u, v])) = nearest?;
            let mut slope = vec![0.0; size];
            let (sin, cos) = pose.angle[i].sin_cos();
            // Moving the link's start moves the point the other way in the link's frame.
            let by_start = [-(by_u * cos - by_v * sin), -(by_u * sin + by_v * cos)];
            slope[0] = by_start[0];
            slope[1] = by_start[1];
            for j in 0..i {
                let (sin_j, cos_j) = pose.angle[j].sin_cos();
                let length = self.lengths[j] * pose.unit;
                slope[2 + j] = length * (cos_j * by_start[1] - sin_j * by_start[0]);
                if !self.known {
                    slope[2 + 2 * n] += self.lengths[j] * (cos_j * by_start[0] + sin_j * by_start[1]);
                }
            }
            slope[2 + i] += by_u * v - by_v * u;
            slope[2 + n + i] = by_half;
            if !self.known {
                slope[2 + 2 * n] += by_length * self.lengths[i];
            }
            rows.push(Residual { value, slope });
        }
        if rows.len() < 2 * size {
            return None;
        }
        let mut sizes: Vec<f64> = rows.iter().map(|row| row.value.abs()).collect();
        let scale = scale.unwrap_or_else(|| (SIZE_TO_SIGMA * median(&mut sizes)).max(FLOOR_PX));
        Some((rows, scale))
    }

    fn cost(&self, rows: &[Residual], scale: f64, pose: &Pose) -> f64 {
        let reach = TUKEY * scale;
        let rho = |r: f64| {
            let share = 1.0 - (r / reach).powi(2).min(1.0);
            reach * reach / 3.0 * (1.0 - share.powi(3))
        };
        let seen: f64 = rows.iter().map(|row| rho(row.value)).sum();
        let hidden = self.base.map_or(0.0, |(base, sigma)| (distance(base, pose.base) / sigma).powi(2));
        seen / (scale * scale) + hidden
    }

    /// Gauss-Newton's normal matrix and right side, in units of sigma.
    fn normal(
        &self,
        rows: &[Residual],
        scale: f64,
        pose: &Pose,
        size: usize,
    ) -> (DMatrix<f64>, DVector<f64>) {
        let mut normal = DMatrix::zeros(size, size);
        let mut right = DVector::zeros(size);
        for row in rows {
            let share = 1.0 - (row.value / (TUKEY * scale)).powi(2);
            if share <= 0.0 {
                continue;
            }
            let weight = (share / scale).powi(2);
            for (a, slope_a) in row.slope.iter().enumerate().filter(|(_, s)| **s != 0.0) {
                right[a] -= weight * slope_a * row.value;
                for (b, slope_b) in row.slope.iter().enumerate() {
                    normal[(a, b)] += weight * slope_a * slope_b;
                }
            }
        }
        if let Some((base, sigma)) = self.base {
            for axis in 0..2 {
                normal[(axis, axis)] += sigma.powi(-2);
                right[axis] += (base[axis] - pose.base[axis]) / (sigma * sigma);
            }
        }
        (normal, right)
    }

    /// Sigma per axis of keypoint `i` \[px\].
    fn keypoint_std(&self, i: usize, pose: &Pose, covariance: &DMatrix<f64>) -> f64 {
        let n = self.lengths.len();
        let mut variance = 0.0;
        for axis in 0..2 {
            let mut slope = DVector::zeros(covariance.nrows());
            slope[axis] = 1.0;
            for j in 0..i {
                let (sin, cos) = pose.angle[j].sin_cos();
                slope[2 + j] = self.lengths[j] * pose.unit * [-sin, cos][axis];
                if !self.known {
                    slope[2 + 2 * n] += self.lengths[j] * [cos, sin][axis];
                }
            }
            variance += (slope.transpose() * covariance * &slope)[0] / 2.0;
        }
        variance.sqrt().hypot(FLOOR_PX)
    }
}

impl Pose {
    fn points(&self, lengths: &[f64]) -> Vec<Px> {
        let mut points = vec![self.base];
        for (length, angle) in lengths.iter().zip(&self.angle) {
            let [x, y] = points[points.len() - 1];
            let length = length * self.unit;
            points.push([x + length * angle.cos(), y + length * angle.sin()]);
        }
        points
    }

    fn moved(&self, step: &DVector<f64>, known: bool) -> Self {
        let n = self.angle.len();
        Self {
            base: [self.base[0] + step[0], self.base[1] + step[1]],
            angle: (0..n).map(|i| self.angle[i] + step[2 + i]).collect(),
            half: (0..n).map(|i| (self.half[i] + step[2 + n + i]).max(0.5)).collect(),
            unit: if known { self.unit } else { (self.unit + step[2 + 2 * n]).max(1e-6) },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Central differences of a smooth distance.
    const DIFFERENCE: f64 = 1e-5;

    #[test]
    fn slopes_agree_with_differences() {
        let chain =
            Chain { lengths: vec![1.0, 1.0, 1.2], known: false, overhang: 2.0, rounding: 0.4, base: None };
        let pose =
            Pose { base: [10.0, 20.0], angle: vec![0.3, 0.9, -0.2], half: vec![5.0, 6.0, 4.0], unit: 40.0 };
        let corners = [[9.0, 27.0], [2.0, 14.0], [60.0, 80.0], [40.0, 23.0], [110.0, 52.0], [111.5, 58.0]];
        let edge: Vec<Px> =
            corners.iter().flat_map(|c| (0..4).map(|k| [c[0] + 0.3 * f64::from(k), c[1]])).collect();
        let rows = |pose: &Pose| chain.linearised(&edge, pose, Some(1.0)).unwrap().0;
        let at = rows(&pose);
        for parameter in 0..9 {
            let step = |sign: f64| {
                let mut step = DVector::zeros(9);
                step[parameter] = sign * DIFFERENCE;
                rows(&pose.moved(&step, false))
            };
            let (up, down) = (step(1.0), step(-1.0));
            for (k, row) in at.iter().enumerate() {
                let difference = (up[k].value - down[k].value) / (2.0 * DIFFERENCE);
                assert!((row.slope[parameter] - difference).abs() < 1e-5, "{parameter} {k}");
            }
        }
    }

    #[test]
    fn chain_is_recovered_from_points_on_its_outline() {
        let chain =
            Chain { lengths: vec![50.0, 50.0, 55.0], known: true, overhang: 5.0, rounding: 0.0, base: None };
        let truth = Pose { base: [30.0, 40.0], angle: vec![0.2, 0.6, 1.3], half: vec![8.0; 3], unit: 1.0 };
        let points = truth.points(&chain.lengths);
        let mut edge = Vec::new();
        for (i, (start, angle)) in points.iter().zip(&truth.angle).enumerate() {
            let (sin, cos) = angle.sin_cos();
            let along = |u: f64, v: f64| [start[0] + u * cos - v * sin, start[1] + u * sin + v * cos];
            edge.extend((0..100).map(|k| f64::from(k) / 2.0).flat_map(|u| [along(u, 8.0), along(u, -8.0)]));
            let cap = [Some(-5.0), None, Some(55.0)][i];
            edge.extend(
                cap.into_iter()
                    .flat_map(|u| (-8..=8).map(move |v| (u, f64::from(v))))
                    .map(|(u, v)| along(u, v)),
            );
        }
        let start: Vec<Px> = points.iter().map(|p| [p[0] + 2.0, p[1] - 1.5]).collect();
        let fitted = chain.fit(&edge, &start, 7.0).unwrap();
        for (a, b) in fitted.points.iter().zip(&points) {
            assert!(distance(*a, *b) < 0.01, "{a:?} {b:?}");
        }
    }
}
