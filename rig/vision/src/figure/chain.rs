//! Rigid links, pivoted at their ends: rectangles with a common overhang past their pivots.
//!
//! Numbers in order: P0's column and row, the unit of length, the overhang, the links' half widths; then the links' angles.

use nalgebra::DMatrix;

use super::edges::Rim;
use super::{Figure, Places};
use crate::spline::{arc_lengths, moved, point_at, unit};
use camera::calibration::Px;

/// What a chain is made of.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Chain {
    /// Pivot-to-pivot lengths, the last to the tip, in units of length.
    pub(crate) lengths: Vec<f64>,
    /// How far the last link reaches past Pn \[px\].
    pub(crate) tip_overhang: f64,
    /// Corner radius of the free ends, as a share of the half width.
    pub(crate) rounding: f64,
}

/// Where the numbers are.
pub(crate) const UNIT: usize = 2;
pub(crate) const OVERHANG: usize = 3;
const HALF: usize = 4;

/// Places on the outline are so far apart \[px\].
const SPACING_PX: f64 = 2.0;
/// How links overlap at an inner joint is not known: so many half widths around it are left out.
const JOINT_HALF_WIDTHS: f64 = 1.5;
/// What lies this near another link is not told from its edge \[px\].
const TOUCHING_PX: f64 = 2.5;
/// Places on a round corner.
const ARC_PLACES: usize = 6;
/// Sides of a drawn one.
const ROUND_CORNERS: usize = 12;

/// A link where a pose puts it.
struct Placed {
    start: Px,
    along: Px,
    across: Px,
    length: f64,
    half: f64,
    /// How far it reaches past its start and its end.
    past: [f64; 2],
}

/// A place seen from its link: `start + a along + b across`, and what moves it there.
#[derive(Clone, Copy, Default)]
struct Local {
    at: [f64; 2],
    outward: [f64; 2],
    by_half: [f64; 2],
    /// Along the link, by the overhang and by the unit of length.
    by_overhang: f64,
    by_unit: f64,
}

impl Chain {
    fn links(&self) -> usize {
        self.lengths.len()
    }

    fn placed(&self, pose: &[f64]) -> Vec<Placed> {
        let n = self.links();
        let mut start = [pose[0], pose[1]];
        (0..n)
            .map(|i| {
                let (sin, cos) = pose[HALF + n + i].sin_cos();
                let (length, half) = (self.lengths[i] * pose[UNIT], pose[HALF + i]);
                let front = if i + 1 == n { self.tip_overhang } else { pose[OVERHANG] };
                let past = [pose[OVERHANG], front];
                let link = Placed { start, along: [cos, sin], across: [-sin, cos], length, half, past };
                start = [start[0] + length * cos, start[1] + length * sin];
                link
            })
            .collect()
    }

    /// Places on link `i` as seen from it.
    fn locals(&self, i: usize, link: &Placed, out: &mut Vec<Local>) {
        let (first, last) = (i == 0, i + 1 == self.links());
        let corner = self.rounding * link.half;
        let from = if first { corner - link.past[0] } else { JOINT_HALF_WIDTHS * link.half };
        let to = match last {
            true => link.length + link.past[1] - corner,
            false => link.length - JOINT_HALF_WIDTHS * link.half,
        };
        for u in evenly(from, to) {
            for side in [-1.0, 1.0] {
                out.push(Local {
                    at: [u, side * link.half],
                    outward: [0.0, side],
                    by_half: [0.0, side],
                    ..Local::default()
                });
            }
        }
        if first {
            self.end(link, -1.0, out);
        }
        if last {
            self.end(link, 1.0, out);
        }
    }

    /// The chain's free end at a link's start (`way` -1) or end (1).
    fn end(&self, link: &Placed, way: f64, out: &mut Vec<Local>) {
        let (r, half) = (self.rounding, link.half);
        let at = if way < 0.0 { -link.past[0] } else { link.length + link.past[1] };
        let moved = Local {
            by_overhang: if way < 0.0 { -1.0 } else { 0.0 },
            by_unit: if way < 0.0 { 0.0 } else { link.length },
            ..Local::default()
        };
        let flat = (1.0 - r) * half;
        for v in evenly(-flat, flat) {
            out.push(Local { at: [at, v], outward: [way, 0.0], ..moved });
        }
        if r <= 0.0 {
            return;
        }
        for k in 0..ARC_PLACES {
            let turn = std::f64::consts::FRAC_PI_2 * (k as f64 + 0.5) / ARC_PLACES as f64;
            for side in [-1.0, 1.0] {
                let outward = [way * turn.cos(), side * turn.sin()];
                let by_half = [r * (outward[0] - way), side * (1.0 - r) + r * outward[1]];
                let place = [at + half * by_half[0], half * by_half[1]];
                out.push(Local { at: place, outward, by_half, ..moved });
            }
        }
    }
}

/// From `from` to `to` about [`SPACING_PX`] apart, half a step inside; nothing where there is no way between.
fn evenly(from: f64, to: f64) -> impl Iterator<Item = f64> {
    let count = if to > from { ((to - from) / SPACING_PX).ceil() as usize } else { 0 };
    (0..count).map(move |k| from + (to - from) * (k as f64 + 0.5) / count as f64)
}

impl Placed {
    fn on(&self, [a, b]: [f64; 2]) -> Px {
        [0, 1].map(|k| self.start[k] + a * self.along[k] + b * self.across[k])
    }

    /// Whether `p` lies on it, or as near as cannot be told from that.
    fn holds(&self, p: Px) -> bool {
        let d = [p[0] - self.start[0], p[1] - self.start[1]];
        let (u, v) = (dot(d, self.along), dot(d, self.across));
        u > -self.past[0] - TOUCHING_PX
            && u < self.length + self.past[1] + TOUCHING_PX
            && v.abs() < self.half + TOUCHING_PX
    }
}

fn dot(a: Px, b: Px) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

impl Figure for Chain {
    fn size(&self) -> usize {
        self.shared() + self.links()
    }

    fn shared(&self) -> usize {
        HALF + self.links()
    }

    fn parts(&self) -> usize {
        self.links()
    }

    fn places(&self, pose: &[f64]) -> Places {
        let (n, size) = (self.links(), self.size());
        let links = self.placed(pose);
        let mut places = Places::default();
        let mut locals = Vec::new();
        for (i, link) in links.iter().enumerate() {
            locals.clear();
            self.locals(i, link, &mut locals);
            for local in &locals {
                let at = link.on(local.at);
                if links.iter().enumerate().any(|(j, other)| j != i && other.holds(at)) {
                    continue;
                }
                let [o_along, o_across] = local.outward;
                let outward = [0, 1].map(|k| o_along * link.along[k] + o_across * link.across[k]);
                places.rims.push(Rim { at, outward, part: i });
                let from = places.slopes.len();
                places.slopes.resize(from + size, 0.0);
                let slope = &mut places.slopes[from..];
                slope[..2].copy_from_slice(&outward);
                for (j, before) in links[..i].iter().enumerate() {
                    slope[UNIT] += self.lengths[j] * dot(outward, before.along);
                    slope[HALF + n + j] = before.length * dot(outward, before.across);
                }
                slope[UNIT] += o_along * local.by_unit / pose[UNIT];
                slope[OVERHANG] = o_along * local.by_overhang;
                slope[HALF + i] = o_along * local.by_half[0] + o_across * local.by_half[1];
                // Turned by a small angle, (a, b) goes by (-b, a).
                slope[HALF + n + i] = o_across * local.at[0] - o_along * local.at[1];
            }
        }
        places
    }

    fn points(&self, pose: &[f64]) -> (Vec<Px>, Vec<f64>) {
        let (n, size) = (self.links(), self.size());
        let mut points = vec![[pose[0], pose[1]]];
        let mut slopes = vec![0.0; 2 * (n + 1) * size];
        (slopes[0], slopes[size + 1]) = (1.0, 1.0);
        for (i, link) in self.placed(pose).iter().enumerate() {
            points.push(link.on([link.length, 0.0]));
            for axis in 0..2 {
                let from = (2 * i + axis) * size;
                let to = (2 * (i + 1) + axis) * size;
                slopes.copy_within(from..from + size, to);
                slopes[to + UNIT] += self.lengths[i] * link.along[axis];
                slopes[to + HALF + n + i] = link.length * link.across[axis];
            }
        }
        (points, slopes)
    }

    fn start(&self, shared: &[f64], line: &[Px]) -> Vec<f64> {
        let lengths = arc_lengths(line);
        let seen = lengths.last().copied().unwrap_or(0.0);
        let ahead = line[(shared[HALF].round().max(1.0) as usize).min(line.len() - 1)];
        let backwards = unit(ahead, line[0]);
        // From the tip back; beyond the line's beginning straight on.
        let mut s = seen - self.tip_overhang - self.lengths.iter().sum::<f64>() * shared[UNIT];
        let mut points = Vec::with_capacity(self.links() + 1);
        for i in 0..=self.links() {
            let seen = if s < 0.0 { moved(line[0], backwards, -s) } else { point_at(line, &lengths, s) };
            points.push(if i == 0 { [shared[0], shared[1]] } else { seen });
            s += self.lengths.get(i).map_or(0.0, |length| length * shared[UNIT]);
        }
        let angles = points.windows(2).map(|p| (p[1][1] - p[0][1]).atan2(p[1][0] - p[0][0]));
        shared.iter().copied().chain(angles).collect()
    }

    fn stiffness(&self) -> DMatrix<f64> {
        DMatrix::zeros(self.size(), self.size())
    }

    fn line(&self, pose: &[f64]) -> Vec<Px> {
        self.points(pose).0
    }

    fn polygons(&self, pose: &[f64]) -> Vec<Vec<Px>> {
        let links = self.placed(pose);
        let last = links.len() - 1;
        let corner = |link: &Placed, way: f64, side: f64, round: bool| -> Vec<Px> {
            let end = if way < 0.0 { -link.past[0] } else { link.length + link.past[1] };
            let r = if round { self.rounding } else { 0.0 };
            let turns = if r > 0.0 { ROUND_CORNERS } else { 0 };
            let at = |k: usize| {
                let turn = if turns == 0 { 0.0 } else { k as f64 / turns as f64 };
                let (sin, cos) = (std::f64::consts::FRAC_PI_2 * turn).sin_cos();
                // From the side towards the end, on a circle of radius r about the corner's centre.
                link.on([end + way * r * link.half * (sin - 1.0), side * link.half * (1.0 - r + r * cos)])
            };
            (0..=turns).map(at).collect()
        };
        let of = |(i, link): (usize, &Placed)| {
            let backwards = |mut points: Vec<Px>| {
                points.reverse();
                points
            };
            let (first, last) = (i == 0, i == last);
            [
                corner(link, 1.0, -1.0, last),
                backwards(corner(link, 1.0, 1.0, last)),
                corner(link, -1.0, 1.0, first),
                backwards(corner(link, -1.0, -1.0, first)),
            ]
            .concat()
        };
        links.iter().enumerate().map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::tests::slopes_are_the_derivatives;

    #[test]
    fn slopes_are_those_of_the_outline() {
        for rounding in [0.0, 0.5, 1.0] {
            let chain = Chain { lengths: vec![60.0, 50.0, 70.0], tip_overhang: 3.0, rounding };
            let pose = [100.0, 40.0, 1.1, 6.1, 11.3, 10.2, 9.1, 1.2, 1.9, 1.4];
            slopes_are_the_derivatives(&chain, &pose);
        }
    }

    #[test]
    fn a_line_gives_its_pose_again() {
        let chain = Chain { lengths: vec![60.0, 50.0, 70.0], tip_overhang: 0.0, rounding: 0.0 };
        let pose = [100.0, 40.0, 1.0, 6.0, 11.0, 10.0, 9.0, 1.2, 1.9, 1.4];
        let start = chain.start(&pose[..7], &chain.line(&pose));
        assert!(start.iter().zip(&pose).all(|(a, b)| (a - b).abs() < 1e-9), "{start:?}");
    }
}
