//! One arm, or several that the camera sees as one: its joints' turns, by the edges beside it.

use nalgebra::{DMatrix, DVector};
use sim::math::Vec3;

use super::hub::{Hub, in_picture, turned};
use super::settle::{Outline, Settled, settle};
use super::shape::Arm;
use crate::figure::edges::{Rim, View};
use crate::spline::{distance, moved, unit};
use camera::calibration::{Plane, Px};

/// An arm's outline; a pose is how far each joint has turned \[rad\].
pub(super) struct Branch<'a> {
    pub(super) arm: &'a Arm,
    pub(super) plane: &'a Plane,
    /// The body that it hangs on, and that body's pose.
    pub(super) hub: (&'a Hub<'a>, &'a [f64]),
    /// Size of a pixel \[m\].
    pub(super) scale_m: f64,
    /// What lies where other arms were found.
    pub(super) others: Vec<Band>,
    pub(super) steps: Vec<f64>,
}

/// Where an arm lies in the picture: its line and half its width at each segment \[px\].
#[derive(Debug, Clone)]
pub(super) struct Band {
    line: Vec<Px>,
    half: Vec<f64>,
}

/// Places of the outline are so far apart \[px\].
const SPACING_PX: f64 = 4.0;
/// Around a body or another arm nothing is believed \[px\].
const MARGIN_PX: f64 = 1.5;
/// What joints do by themselves, 1 sigma \[rad\]: the first one is driven anywhere, the others bend, about as much as their neighbours.
const DRIVEN_STD: f64 = 1.5;
const BENT_STD: f64 = 0.35;
const UNEVEN_STD: f64 = 0.06;
/// Starts that are tried: turns of the first joint and bends of the rest together \[rad\].
const FIRST_TURNS: (f64, f64) = (1.5, 0.075);
const BENDS: (f64, f64) = (1.8, 0.2);
/// Least share of an arm's places where a start or an end shows its two sides.
const LEAST_START: f64 = 0.55;
const LEAST_FOUND: f64 = 0.6;
/// Least share of its places that nothing covers.
const LEAST_OPEN: f64 = 0.25;
/// Edges farther off than this are something else's \[px\].
const MOST_SCATTER_PX: f64 = 1.2;

impl Branch<'_> {
    fn seen(&self, at: Vec3<f64>) -> Px {
        self.plane.pixel(Hub::place(self.hub.1, [at[0], at[2]]))
    }

    /// Half of what is seen of segment `i`'s width where it goes `way` \[m\], and the direction across it, `[x, z]` of the body at rest.
    fn side(&self, i: usize, way: Vec3<f64>) -> (f64, [f64; 2]) {
        let length = way[0].hypot(way[2]).max(f64::MIN_POSITIVE);
        let aside = [-way[2] / length, way[0] / length];
        let flat = Vec3([aside[0], 0.0, aside[1]]);
        let [thick, broad] = self.arm.half_m[i];
        let thin = self.arm.axis.cross(way);
        (thick * thin.dot(flat).abs() + broad * self.arm.axis.dot(flat).abs(), aside)
    }

    /// Where it lies with its joints turned by `pose`.
    pub(super) fn band(&self, pose: &[f64]) -> Band {
        let (places, ways) = self.arm.line(pose);
        let half = ways.iter().enumerate().map(|(i, way)| self.side(i, *way).0 / self.scale_m).collect();
        Band { line: places.iter().map(|at| self.seen(*at)).collect(), half }
    }

    /// Where all of it lies in any pose, where the camera looks along its plane.
    pub(super) fn strip(&self) -> Band {
        let length: f64 = self.arm.lengths_m.iter().sum();
        let (root, along, across) = (self.arm.root_m, self.arm.along, self.arm.across);
        // Both directions of the plane are seen along one line; the longer one tells it better.
        let seen = |way: Vec3<f64>| way[0].hypot(way[2]);
        let way = if seen(along) > seen(across) { along } else { across };
        let way = way * (length / seen(way).max(f64::MIN_POSITIVE));
        let half = self.arm.half_m.iter().map(|[thick, broad]| thick + broad).fold(0.0, f64::max);
        Band { line: vec![self.seen(root - way), self.seen(root + way)], half: vec![half / self.scale_m] }
    }

    /// Keypoint `segment`, `along` \[m\], of the arm in the picture.
    fn keypoint(&self, pose: &[f64], (segment, along): (usize, f64)) -> Px {
        let (places, ways) = self.arm.line(pose);
        self.seen(places[segment] + ways[segment] * along)
    }

    /// A keypoint and its sigma, of turns as `settled`, on a body whose pose has the covariance `of_hub`.
    pub(super) fn placed(
        &self,
        (segment, along): (usize, f64),
        settled: Option<&Settled>,
        of_hub: (&DMatrix<f64>, &[f64]),
    ) -> (Px, f64) {
        let still = vec![0.0; self.arm.lengths_m.len()];
        let pose = settled.map_or(&still, |settled| &settled.pose);
        let at = self.keypoint(pose, (segment, along));
        let moves = |other: Px, step: f64| [(other[0] - at[0]) / step, (other[1] - at[1]) / step];
        let variance = |covariance: &DMatrix<f64>, moves: &[Px]| -> f64 {
            let of = |axis: usize| {
                let row = DVector::from_iterator(moves.len(), moves.iter().map(|by| by[axis]));
                (row.transpose() * covariance * row)[(0, 0)]
            };
            of(0).max(of(1))
        };
        let turn = |k: usize| {
            let mut other = pose.clone();
            other[k] += self.steps[k];
            moves(self.keypoint(&other, (segment, along)), self.steps[k])
        };
        let own = settled.map_or(0.0, |settled| {
            let moves: Vec<Px> = (0..pose.len()).map(turn).collect();
            variance(&settled.covariance, &moves)
        });
        let (covariance, steps) = of_hub;
        let carried: Vec<Px> = (0..3)
            .map(|k| {
                let mut hub = self.hub.1.to_vec();
                hub[k] += steps[k];
                let place = self.arm.line(pose);
                let at = place.0[segment] + place.1[segment] * along;
                moves(self.plane.pixel(Hub::place(&hub, [at[0], at[2]])), steps[k])
            })
            .collect();
        (at, (own + variance(covariance, &carried)).sqrt())
    }

    /// The arm's turns, from where they were `before`, or from anywhere.
    pub(super) fn find(&self, view: &View, before: Option<&[f64]>) -> Option<Settled> {
        let near = before.and_then(|before| self.settled(view, before));
        near.or_else(|| self.settled(view, &self.start(view)?))
    }

    fn settled(&self, view: &View, start: &[f64]) -> Option<Settled> {
        let all = self.rims(start).len() as f64;
        settle(view, self, start).filter(|settled| {
            settled.found as f64 >= LEAST_FOUND * settled.open as f64
                && settled.open as f64 >= LEAST_OPEN * all
                && settled.scatter_px < MOST_SCATTER_PX
                && self.shows(view, &settled.pose) >= LEAST_START
        })
    }

    fn start(&self, view: &View) -> Option<Vec<f64>> {
        let grid = |(most, step): (f64, f64)| {
            let count = (most / step).round() as i32;
            (-count..=count).map(move |k| f64::from(k) * step)
        };
        let count = self.arm.lengths_m.len();
        let bent = (count.max(2) - 1) as f64;
        let poses = grid(FIRST_TURNS).flat_map(|first| {
            grid(BENDS).map(move |bend| {
                (0..count).map(|i| if i == 0 { first } else { bend / bent }).collect::<Vec<f64>>()
            })
        });
        let (best, pose) =
            poses.map(|pose| (self.shows(view, &pose), pose)).max_by(|(a, one), (b, other)| {
                // Of two that show as much the less bent one.
                let bend = |pose: &[f64]| pose.iter().map(|turn| turn.abs()).sum::<f64>();
                a.total_cmp(b).then(bend(other).total_cmp(&bend(one)))
            })?;
        (best >= LEAST_START).then_some(pose)
    }

    /// Share of the places along the arm's outer part where it is dark inside and light beside it.
    fn shows(&self, view: &View, pose: &[f64]) -> f64 {
        /// Beside an arm, and before its tip, it is light so far off \[px\].
        const BESIDE_PX: f64 = 3.0;
        const INSIDE: f64 = 0.6;
        let half = f64::from(view.contrast.level) / 2.0;
        let dark = |px: Px| view.contrast.at(px) > half;
        let band = self.band(pose);
        let (mut shown, mut places) = (0, 0);
        let first = band.half.len() / 4;
        for (i, pair) in band.line.windows(2).enumerate().skip(first) {
            let [dx, dy] = unit(pair[0], pair[1]);
            for share in [0.25, 0.75] {
                let at = moved(pair[0], unit(pair[0], pair[1]), share * distance(pair[0], pair[1]));
                if self.hub.0.holds(self.hub.1, at, 0.0) {
                    continue;
                }
                for side in [[-dy, dx], [dy, -dx]] {
                    places += 1;
                    let inside = dark(at) && dark(moved(at, side, INSIDE * band.half[i]));
                    shown += usize::from(inside && !dark(moved(at, side, band.half[i] + BESIDE_PX)));
                }
            }
        }
        let last = band.line.len() - 1;
        let (tip, ahead) = (band.line[last], unit(band.line[last - 1], band.line[last]));
        let ends = dark(moved(tip, ahead, -BESIDE_PX)) && !dark(moved(tip, ahead, 2.0 * BESIDE_PX));
        (shown + 4 * usize::from(ends)) as f64 / (places + 4) as f64
    }
}

impl Band {
    /// Whether `px` lies in it or within `margin` \[px\].
    pub(super) fn holds(&self, px: Px, margin: f64) -> bool {
        self.line.windows(2).zip(&self.half).any(|(pair, half)| {
            let [dx, dy] = unit(pair[0], pair[1]);
            let (x, y) = (px[0] - pair[0][0], px[1] - pair[0][1]);
            let (along, across) = (x * dx + y * dy, y * dx - x * dy);
            (-margin..=distance(pair[0], pair[1]) + margin).contains(&along) && across.abs() <= half + margin
        })
    }

    /// Whether more than half of its outer part lies in `other`.
    pub(super) fn lies_in(&self, other: &Self) -> bool {
        let outer = &self.line[self.line.len() / 2..];
        2 * outer.iter().filter(|px| other.holds(**px, 0.0)).count() > outer.len()
    }

    /// Its line \[px\].
    pub(super) fn line(&self) -> &[Px] {
        &self.line
    }
}

impl Outline for Branch<'_> {
    fn rims(&self, pose: &[f64]) -> Vec<Rim> {
        let (places, ways) = self.arm.line(pose);
        let mut rims = Vec::new();
        for (i, way) in ways.iter().enumerate() {
            let (half_m, aside) = self.side(i, *way);
            // As many in every pose: by the whole length, not by what is seen of it.
            let count = (self.arm.lengths_m[i] / self.scale_m / SPACING_PX).ceil().max(1.0) as usize;
            for k in 0..count {
                let along = (k as f64 + 0.5) / count as f64 * self.arm.lengths_m[i];
                let centre = places[i] + *way * along;
                for side in [1.0, -1.0] {
                    let off = [side * half_m * aside[0], side * half_m * aside[1]];
                    let at =
                        self.plane.pixel(Hub::place(self.hub.1, [centre[0] + off[0], centre[2] + off[1]]));
                    let outward = turned([side * aside[0], side * aside[1]], self.hub.1[2]);
                    rims.push(Rim { at, outward: in_picture(self.plane, at, outward), part: i });
                }
            }
        }
        rims
    }

    fn steps(&self) -> &[f64] {
        &self.steps
    }

    fn prior(&self, pose: &[f64]) -> Vec<(Vec<f64>, f64)> {
        let count = pose.len();
        let row = |entries: &[(usize, f64)]| {
            let mut row = vec![0.0; count];
            entries.iter().for_each(|&(k, weight)| row[k] = weight);
            let off = row.iter().zip(pose).map(|(weight, turn)| weight * turn).sum();
            (row, off)
        };
        let single = (0..count).map(|k| row(&[(k, 1.0 / if k == 0 { DRIVEN_STD } else { BENT_STD })]));
        let even =
            (1..count.saturating_sub(1)).map(|k| row(&[(k, 1.0 / UNEVEN_STD), (k + 1, -1.0 / UNEVEN_STD)]));
        single.chain(even).collect()
    }

    fn covered(&self, px: Px) -> bool {
        self.hub.0.holds(self.hub.1, px, MARGIN_PX * self.scale_m)
            || self.others.iter().any(|other| other.holds(px, MARGIN_PX))
    }
}
