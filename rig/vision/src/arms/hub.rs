//! The free body: an ellipse of known size, found by its free rim.

use super::settle::{Outline, Settled, settle};
use super::shape::Swimmer;
use crate::Mask;
use crate::figure::edges::{Rim, View};
use crate::thin::radii;
use camera::calibration::{Plane, Px};

/// The body's outline; a pose is where P0 is, `[x, z]` \[m\], and how far the body is turned from how the model rests \[rad\].
pub(super) struct Hub<'a> {
    swimmer: &'a Swimmer,
    plane: &'a Plane,
    /// Directions of the outline's places from the ellipse's centre, in its own axes \[rad\].
    places: Vec<f64>,
    steps: [f64; 3],
}

/// Places of the rim are so far apart \[px\].
const SPACING_PX: f64 = 2.0;
/// Rim that faces the arms' way more than so is theirs.
const ARMS_SIDE: f64 = 0.25;
/// A start is looked for on so coarse a grid \[px, rad\].
const GRID_PX: usize = 4;
const GRID_RAD: f64 = 0.2;
/// Least share of the rim that shows a start; and where an edge is in the end.
const LEAST_STARTED: f64 = 0.6;
const LEAST_FOUND: f64 = 0.7;
/// Edges farther off than this are another body's \[px\].
const MOST_SCATTER_PX: f64 = 1.5;

impl<'a> Hub<'a> {
    /// Of a swimmer seen through `plane` near `px`.
    pub(super) fn new(swimmer: &'a Swimmer, plane: &'a Plane, px: Px) -> Self {
        let scale = plane.metres_per_pixel(px);
        let [long, short] = swimmer.axes_m;
        let count = (std::f64::consts::TAU * long / scale / SPACING_PX).ceil().max(12.0) as usize;
        // Where the arms go, as far as they all go one way.
        let ways = swimmer.arms.iter().map(|arm| [arm.along[0], arm.along[2]]);
        let mean = ways.fold([0.0; 2], |sum, way| [sum[0] + way[0], sum[1] + way[1]]);
        let mean = mean.map(|sum| sum / swimmer.arms.len() as f64);
        let free = |place: &f64| {
            let outward = turned([place.cos() / long, place.sin() / short], swimmer.turn_rad);
            let towards = (outward[0] * mean[0] + outward[1] * mean[1]) / outward[0].hypot(outward[1]);
            towards < ARMS_SIDE * mean[0].hypot(mean[1])
        };
        let all = (0..count).map(|i| std::f64::consts::TAU * (i as f64 + 0.5) / count as f64);
        let places = all.filter(free).collect();
        Self { swimmer, plane, places, steps: [scale, scale, scale / long] }
    }

    /// Where `at` on the body at rest is with it at `pose`, both from P0's place at rest \[m\].
    pub(super) fn place(pose: &[f64], at: [f64; 2]) -> [f64; 2] {
        let [x, z] = turned(at, pose[2]);
        [pose[0] + x, pose[1] + z]
    }

    fn rim(&self, pose: &[f64], place: f64, share: f64) -> Px {
        let [long, short] = self.swimmer.axes_m;
        let [x, z] = turned([share * long * place.cos(), share * short * place.sin()], self.swimmer.turn_rad);
        let [dx, dz] = self.swimmer.centre_m;
        self.plane.pixel(Self::place(pose, [x + dx, z + dz]))
    }

    /// Whether `px` is inside the ellipse of `pose` grown by `margin_m`.
    pub(super) fn holds(&self, pose: &[f64], px: Px, margin_m: f64) -> bool {
        let [x, z] = self.plane.metres(px);
        let [x, z] = turned([x - pose[0], z - pose[1]], -pose[2]);
        let [dx, dz] = self.swimmer.centre_m;
        let [u, v] = turned([x - dx, z - dz], -self.swimmer.turn_rad);
        let [long, short] = self.swimmer.axes_m.map(|axis| axis + margin_m);
        (u / long).hypot(v / short) < 1.0
    }

    /// The body in a picture whose silhouette is `mask`: near `before`, or anywhere.
    pub(super) fn find(&self, view: &View, mask: &Mask, before: Option<&[f64]>) -> Option<Settled> {
        let near = before.and_then(|before| self.settled(view, before));
        near.or_else(|| self.settled(view, &self.start(view, mask)?))
    }

    fn settled(&self, view: &View, start: &[f64]) -> Option<Settled> {
        settle(view, self, start).filter(|settled| {
            settled.found as f64 >= LEAST_FOUND * settled.open as f64
                && settled.open as f64 >= LEAST_FOUND * self.places.len() as f64
                && settled.scatter_px < MOST_SCATTER_PX
        })
    }

    /// Where most of the free rim is dark inside and light outside.
    fn start(&self, view: &View, mask: &Mask) -> Option<Vec<f64>> {
        const INSIDE: f64 = 0.88;
        const OUTSIDE: f64 = 1.14;
        /// Places of the rim that tell a start.
        const TOLD: usize = 24;
        let scale = self.steps[0];
        let short_px = self.swimmer.axes_m[1] / scale;
        let pixels: Vec<Px> = mask
            .pixels()
            .filter(|(column, row)| column.is_multiple_of(GRID_PX) && row.is_multiple_of(GRID_PX))
            .map(|(column, row)| [column as f64, row as f64])
            .collect();
        let deep = radii(mask, &pixels);
        let half = f64::from(view.contrast.level) / 2.0;
        let stride = (self.places.len() / TOLD).max(1);
        let told: Vec<f64> = self.places.iter().step_by(stride).copied().collect();
        // How many show it; nothing as soon as too many do not.
        let score = |pose: &[f64]| {
            let mut missed = 0;
            let shows = |&place: &f64| {
                view.contrast.at(self.rim(pose, place, OUTSIDE)) < half
                    && view.contrast.at(self.rim(pose, place, INSIDE)) > half
            };
            for place in &told {
                missed += usize::from(!shows(place));
                if missed as f64 > (1.0 - LEAST_STARTED) * told.len() as f64 {
                    return 0;
                }
            }
            told.len() - missed
        };
        let turns = (std::f64::consts::TAU / GRID_RAD) as usize;
        let centres = pixels.iter().zip(&deep).filter(|(_, deep)| **deep > 0.8 * short_px).map(|(px, _)| *px);
        let poses = centres.flat_map(|px| {
            (0..turns).map(move |turn| {
                // Of two turns alike, as of an ellipse's half turn, the one nearer to rest.
                let turn = (turn as f64 - turns as f64 / 2.0) * GRID_RAD;
                let [x, z] = self.plane.metres(px);
                let [dx, dz] = turned(self.swimmer.centre_m, turn);
                vec![x - dx, z - dz, turn]
            })
        });
        let best = poses.max_by_key(|pose| (score(pose), -(pose[2].abs() / GRID_RAD) as i64))?;
        (score(&best) > 0).then_some(best)
    }
}

/// `[x, z]` turned counter-clockwise by `angle`.
pub(super) fn turned([x, z]: [f64; 2], angle: f64) -> [f64; 2] {
    let (sin, cos) = angle.sin_cos();
    [cos * x - sin * z, sin * x + cos * z]
}

impl Outline for Hub<'_> {
    fn rims(&self, pose: &[f64]) -> Vec<Rim> {
        let [long, short] = self.swimmer.axes_m;
        let rim = |&place: &f64| {
            let at = self.rim(pose, place, 1.0);
            let outward = turned([place.cos() / long, place.sin() / short], self.swimmer.turn_rad + pose[2]);
            Rim { at, outward: in_picture(self.plane, at, outward), part: 0 }
        };
        self.places.iter().map(rim).collect()
    }

    fn steps(&self) -> &[f64] {
        &self.steps
    }

    fn covered(&self, _: Px) -> bool {
        false
    }
}

/// The unit vector in the picture, at `px`, of `way`, `[x, z]`.
pub(super) fn in_picture(plane: &Plane, px: Px, [x, z]: [f64; 2]) -> Px {
    let [from_x, from_z] = plane.metres(px);
    let by = plane.metres_per_pixel(px) / x.hypot(z);
    let [column, row] = plane.pixel([from_x + by * x, from_z + by * z]);
    let (dx, dy) = (column - px[0], row - px[1]);
    let length = dx.hypot(dy).max(f64::MIN_POSITIVE);
    [dx / length, dy / length]
}
