//! A chain of straight links fitted to the silhouette's edge.
//!
//! A medial axis cuts corners, so equal arc lengths along it are not the joints. Rigid links are rectangles:
//! their long sides tell their lines, the crossings of those the joints, and the ends where the chain sits
//! along them. The fit moves P0, the links' angles and half widths (and the common length, where it is not
//! known) until the edge points lie on the rectangles' outline, with Tukey's weights against screws, dirt and
//! rounded corners. Points near the inner joints take no part: how links overlap there is not modelled.

use ground::statistics::{MEDIAN_TO_SIGMA, TUKEY_SIGMAS, median};
use nalgebra::{DMatrix, DVector};

use super::Mask;
use super::spline::distance;
use camera::calibration::Px;

/// What is known of the chain before it is seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// Pivot-to-pivot lengths, the last to the tip: \[px\] when `known`, else only their ratios count.
    pub lengths: Vec<f64>,
    /// Whether the lengths are taken as they are.
    pub known: bool,
    /// How far each link reaches past its pivots \[px\].
    pub overhang: f64,
    /// How well that is known, 1 sigma \[px\]: 0 to take it as it is, infinite where it is only where a fit begins.
    pub overhang_std: f64,
    /// How far the last link reaches past Pn \[px\].
    pub tip_overhang: f64,
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
    /// The overhang \[px\] and its sigma, 0 where it was given.
    pub overhang: (f64, f64),
    /// How badly the outline explains the edge points it is asked about, the fewer the better: Tukey's mean at a fixed scale.
    pub misfit: f64,
}

/// Edge points closer to an inner joint than this many half widths are left out.
const JOINT_HALF_WIDTHS: f64 = 1.5;
/// Neighbouring edge points share pixels, and so their noise.
const CORRELATED_POINTS: f64 = 1.5;
/// What pixel sampling leaves however many points there are, 1 sigma \[px\]; measured on renders.
const FLOOR_PX: f64 = 0.03;
/// Scale at which fits of other outlines are compared \[px\]: what blurred edges leave.
const MISFIT_SCALE_PX: f64 = 0.3;
const MOST_ROUNDS: usize = 40;
/// Half widths within which edge points count at first, and how that shrinks from round to round.
const FIRST_REACH_HALF_WIDTHS: f64 = 2.0;
const REACH_SHRINK_SHARE: f64 = 0.5;
/// Levenberg's damping, relative to the diagonal: almost none, and so much that nothing moves.
const LEAST_DAMPING: f64 = 1e-9;
const MOST_DAMPING: f64 = 1e9;
/// A step below this ends the fit \[px, and rad times link length\].
const SETTLED_PX: f64 = 1e-4;

/// Parameters in order: P0 x, y; n angles; n half widths; the unit of length when it is not known; the overhang when that is free.
struct Pose {
    base: Px,
    angle: Vec<f64>,
    half: Vec<f64>,
    unit: f64,
    overhang: f64,
}

/// A link where a pose puts it.
struct Placed {
    start: Px,
    cos: f64,
    sin: f64,
    half: f64,
    length: f64,
    overhang: f64,
}

/// A point seen from a link.
#[derive(Clone, Copy)]
struct Residual {
    /// Which link.
    link: usize,
    /// Signed distance to its outline, negative inside \[px\].
    value: f64,
    /// Derivatives by the point along and across the link, by the half width, by the length and by the overhang.
    slope: [f64; 5],
    /// The point along and across the link, from its start \[px\].
    at: [f64; 2],
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
            overhang: self.overhang,
        };
        let size = self.size();
        let mut damping = 1e-3;
        let mut rows = self.residuals(edge, &pose)?;
        // A straight chain's sides fit wherever it lies along its line: what its ends say must count until they meet.
        let mut coarse = half / TUKEY_SIGMAS * FIRST_REACH_HALF_WIDTHS;
        let mut scale = robust_sigma(&rows).max(coarse);
        let mut cost = self.cost(&rows, scale, &pose);
        for _ in 0..MOST_ROUNDS {
            let (normal, right) = self.normal(&rows, scale, &pose);
            let settled = loop {
                let mut damped = normal.clone();
                (0..size).for_each(|i| damped[(i, i)] *= 1.0 + damping);
                let step = damped.cholesky()?.solve(&right);
                let next = pose.moved(&step, self);
                // The weights' scale stays while steps are compared, or no two costs would be comparable.
                let next_rows = self.residuals(edge, &next)?;
                if self.cost(&next_rows, scale, &next) <= cost {
                    let length = pose.unit * self.lengths.iter().copied().fold(0.0, f64::max);
                    let size_px =
                        |i: usize| step[i].abs() * if (2..2 + n).contains(&i) { length } else { 1.0 };
                    (pose, rows) = (next, next_rows);
                    damping = (damping / 10.0).max(LEAST_DAMPING);
                    break (0..size).all(|i| size_px(i) < SETTLED_PX);
                }
                damping *= 10.0;
                if damping > MOST_DAMPING {
                    break true;
                }
            };
            let seen = robust_sigma(&rows);
            if settled && seen >= coarse {
                break;
            }
            coarse *= REACH_SHRINK_SHARE;
            scale = seen.max(coarse);
            cost = self.cost(&rows, scale, &pose);
        }
        let (normal, _) = self.normal(&rows, scale, &pose);
        let covariance = normal.cholesky()?.inverse() * CORRELATED_POINTS;
        let std_px = (0..=n).map(|i| self.keypoint_std(i, &pose, &covariance)).collect();
        let overhang_std = if self.overhang_free() { covariance[(size - 1, size - 1)].sqrt() } else { 0.0 };
        let points = pose.points(&self.lengths);
        points.iter().flatten().all(|v| v.is_finite()).then_some(FittedChain {
            points,
            std_px,
            misfit: self.misfit(edge, &pose),
            overhang: (pose.overhang, overhang_std),
            half_width: pose.half,
            scatter_px: scale,
        })
    }

    fn misfit(&self, edge: &[Px], pose: &Pose) -> f64 {
        let rows = self.residuals(edge, pose).unwrap_or_default();
        let rho = |r: f64| 1.0 - (1.0 - (r / (TUKEY_SIGMAS * MISFIT_SCALE_PX)).powi(2).min(1.0)).powi(3);
        rows.iter().map(|row| rho(row.value)).sum::<f64>() / rows.len().max(1) as f64
    }

    /// The chain's silhouette in the rectangle of `like`.
    pub fn drawn(&self, fitted: &FittedChain, like: &Mask) -> Mask {
        let mut mask = Mask::empty(like.left, like.top, like.width, like.height);
        let pose = Pose {
            base: fitted.points[0],
            angle: fitted.points.windows(2).map(|p| (p[1][1] - p[0][1]).atan2(p[1][0] - p[0][0])).collect(),
            half: fitted.half_width.clone(),
            unit: self.unit(&fitted.points),
            overhang: fitted.overhang.0,
        };
        for (i, link) in self.placed(&pose).iter().enumerate() {
            let ends = [-link.overhang, link.length + link.overhang.max(self.tip_overhang)];
            let corners = ends.into_iter().flat_map(|u| [(u, link.half), (u, -link.half)]);
            let corners: Vec<Px> = corners
                .map(|(u, v)| [u * link.cos - v * link.sin, u * link.sin + v * link.cos])
                .map(|[x, y]| [link.start[0] + x, link.start[1] + y])
                .collect();
            let range = |axis: usize, from: usize, size: usize| {
                let all = corners.iter().map(|corner| corner[axis]);
                let least = all.clone().fold(f64::INFINITY, f64::min).max(from as f64);
                let most = all.fold(f64::NEG_INFINITY, f64::max).min((from + size) as f64 - 1.0);
                least.floor() as usize..(most.ceil() + 1.0).max(0.0) as usize
            };
            let columns = range(0, like.left, like.width);
            for row in range(1, like.top, like.height) {
                for column in columns.clone() {
                    if self.seen_from(i, link, [column as f64, row as f64]).value <= 0.0 {
                        mask.set(column as isize, row as isize);
                    }
                }
            }
            if i > 0 {
                mask.draw_disc(link.start, link.half);
            }
        }
        mask
    }

    /// Where `pose` puts the links.
    fn placed(&self, pose: &Pose) -> Vec<Placed> {
        let mut start = pose.base;
        let links = self.lengths.iter().zip(&pose.angle).zip(&pose.half);
        links
            .map(|((length, angle), &half)| {
                let (sin, cos) = angle.sin_cos();
                let length = length * pose.unit;
                let link = Placed { start, cos, sin, half, length, overhang: pose.overhang };
                start = [start[0] + length * cos, start[1] + length * sin];
                link
            })
            .collect()
    }

    /// Scale from [`Self::lengths`] to pixels of a chain from `points[0]` on.
    fn unit(&self, points: &[Px]) -> f64 {
        if self.known {
            return 1.0;
        }
        let seen: f64 = points.windows(2).map(|p| distance(p[0], p[1])).sum();
        seen / self.lengths.iter().sum::<f64>()
    }

    /// Where `p` is for link `i`, which is `link`.
    fn seen_from(&self, i: usize, link: &Placed, p: Px) -> Residual {
        let Placed { start, cos, sin, half, length, overhang } = *link;
        let d = [p[0] - start[0], p[1] - start[1]];
        let (u, v) = (cos * d[0] + sin * d[1], cos * d[1] - sin * d[0]);
        let last = i + 1 == self.lengths.len();
        let front = if last { self.tip_overhang } else { overhang };
        // Only the chain's free ends are rounded.
        let free = if u < length / 2.0 { i == 0 } else { last };
        let corner = if free { self.rounding * half } else { 0.0 };
        let (beyond, side) = if u < length / 2.0 { (-overhang - u, -1.0) } else { (u - length - front, 1.0) };
        let (a, b) = (beyond + corner, v.abs() - half + corner);
        let sign_v = if v < 0.0 { -1.0 } else { 1.0 };
        let (value, by_a, by_b) = if a > 0.0 && b > 0.0 {
            let r = (a * a + b * b).sqrt();
            (r - corner, a / r, b / r)
        } else if a > b {
            (a - corner, 1.0, 0.0)
        } else {
            (b - corner, 0.0, 1.0)
        };
        let by_half = -by_b + if free { self.rounding * (by_a + by_b - 1.0) } else { 0.0 };
        let by_length = if side > 0.0 { -by_a } else { 0.0 };
        let by_overhang = if side > 0.0 && last { 0.0 } else { -by_a };
        let slope = [by_a * side, by_b * sign_v, by_half, by_length, by_overhang];
        Residual { link: i, value, slope, at: [u, v] }
    }

    /// Every edge point that counts, seen from the link it is nearest to; `None` when too few count.
    fn residuals(&self, edge: &[Px], pose: &Pose) -> Option<Vec<Residual>> {
        let links = self.placed(pose);
        let mut rows = Vec::with_capacity(edge.len());
        for &p in edge {
            let near_joint = |pair: &[Placed]| {
                let [dx, dy] = [p[0] - pair[1].start[0], p[1] - pair[1].start[1]];
                dx * dx + dy * dy < (JOINT_HALF_WIDTHS * pair[1].half.max(pair[0].half)).powi(2)
            };
            let near_base = || {
                self.base.is_some() && self.seen_from(0, &links[0], p).at[0] < -pose.overhang + links[0].half
            };
            if links.windows(2).any(near_joint) || near_base() {
                continue;
            }
            let seen = links.iter().enumerate().map(|(i, link)| self.seen_from(i, link, p));
            rows.extend(seen.reduce(|best, next| if next.value < best.value { next } else { best }));
        }
        (rows.len() >= 2 * self.size()).then_some(rows)
    }

    /// Whether a fit moves the overhang.
    fn overhang_free(&self) -> bool {
        self.overhang_std > 0.0
    }

    /// Number of parameters.
    fn size(&self) -> usize {
        2 + 2 * self.lengths.len() + usize::from(!self.known) + usize::from(self.overhang_free())
    }

    /// Derivatives of a residual by all parameters, into `slope`.
    fn slope(&self, row: &Residual, links: &[Placed], slope: &mut [f64]) {
        let (n, i) = (links.len(), row.link);
        let ([by_u, by_v, by_half, by_length, by_overhang], [u, v]) = (row.slope, row.at);
        slope.fill(0.0);
        // Moving the link's start moves the point the other way in the link's frame.
        let Placed { cos, sin, .. } = links[i];
        let by_start = [-(by_u * cos - by_v * sin), -(by_u * sin + by_v * cos)];
        slope[..2].copy_from_slice(&by_start);
        for (j, Placed { cos, sin, length, .. }) in links[..i].iter().enumerate() {
            slope[2 + j] = length * (cos * by_start[1] - sin * by_start[0]);
            if !self.known {
                slope[2 + 2 * n] += self.lengths[j] * (cos * by_start[0] + sin * by_start[1]);
            }
        }
        slope[2 + i] += by_u * v - by_v * u;
        slope[2 + n + i] = by_half;
        if !self.known {
            slope[2 + 2 * n] += by_length * self.lengths[i];
        }
        if self.overhang_free() {
            slope[self.size() - 1] = by_overhang;
        }
    }

    fn cost(&self, rows: &[Residual], scale: f64, pose: &Pose) -> f64 {
        let reach = TUKEY_SIGMAS * scale;
        let rho = |r: f64| {
            let share = 1.0 - (r / reach).powi(2).min(1.0);
            reach * reach / 3.0 * (1.0 - share.powi(3))
        };
        let seen: f64 = rows.iter().map(|row| rho(row.value)).sum();
        let hidden = self.base.map_or(0.0, |(base, sigma)| (distance(base, pose.base) / sigma).powi(2));
        let overhang = match self.overhang_free() {
            true => ((self.overhang - pose.overhang) / self.overhang_std).powi(2),
            false => 0.0,
        };
        seen / (scale * scale) + hidden + overhang
    }

    /// Gauss-Newton's normal matrix, lower half, and right side, in units of sigma.
    fn normal(&self, rows: &[Residual], scale: f64, pose: &Pose) -> (DMatrix<f64>, DVector<f64>) {
        let size = self.size();
        let links = self.placed(pose);
        let mut slope = vec![0.0; size];
        let mut normal = DMatrix::zeros(size, size);
        let mut right = DVector::zeros(size);
        for row in rows {
            let share = 1.0 - (row.value / (TUKEY_SIGMAS * scale)).powi(2);
            if share <= 0.0 {
                continue;
            }
            let weight = (share / scale).powi(2);
            self.slope(row, &links, &mut slope);
            for (a, slope_a) in slope.iter().enumerate().filter(|(_, s)| **s != 0.0) {
                right[a] -= weight * slope_a * row.value;
                // Cholesky reads the lower half alone.
                for (b, slope_b) in slope[..=a].iter().enumerate() {
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
        if self.overhang_free() {
            normal[(size - 1, size - 1)] += self.overhang_std.powi(-2);
            right[size - 1] += (self.overhang - pose.overhang) / self.overhang_std.powi(2);
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

/// Robust sigma of the residuals \[px\].
fn robust_sigma(rows: &[Residual]) -> f64 {
    let mut sizes: Vec<f64> = rows.iter().map(|row| row.value.abs()).collect();
    (MEDIAN_TO_SIGMA * median(&mut sizes, f64::total_cmp).unwrap_or(0.0)).max(FLOOR_PX)
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

    fn moved(&self, step: &DVector<f64>, chain: &Chain) -> Self {
        let n = self.angle.len();
        Self {
            base: [self.base[0] + step[0], self.base[1] + step[1]],
            angle: (0..n).map(|i| self.angle[i] + step[2 + i]).collect(),
            half: (0..n).map(|i| (self.half[i] + step[2 + n + i]).max(0.5)).collect(),
            unit: if chain.known { self.unit } else { (self.unit + step[2 + 2 * n]).max(1e-6) },
            overhang: match chain.overhang_free() {
                true => (self.overhang + step[chain.size() - 1]).max(0.0),
                false => self.overhang,
            },
        }
    }
}

#[cfg(test)]
mod tests;
