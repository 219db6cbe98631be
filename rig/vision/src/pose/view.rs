//! Where the camera shows the outline: through the calibration of the plane, and for solids of some depth by perspective.

use camera::calibration::{Plane, Px};

use super::mechanism::{Mechanism, OutlinePoint, Strips};
use super::place::{Place, across, dot, minus, plus, scaled, unit};
use super::shared::{IN_FRONT, Shared};

/// Refractive index of water.
const WATER: f64 = 1.333;

/// The camera before the plane of motion.
#[derive(Debug, Clone)]
pub(super) struct Camera {
    pub(super) plane: Plane,
    /// What the camera's distance would be in air for the same perspective \[m\], and the foot of its view on the plane; none: solids are
    /// taken as flat.
    perspective: Option<(f64, Place)>,
    /// Of a pixel in the middle of the picture \[m\].
    pub(super) scale_m: f64,
    /// Width and height of the picture \[px\].
    pub(super) size: [usize; 2],
}

/// A point of the outline in the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// Where \[px\].
    pub(super) px: Px,
    /// Outward in the picture, unit length.
    pub(super) normal: Px,
    /// How far it moves along `normal` in the picture for each metre that it moves to the right and up in the plane \[px/m\].
    along: Place,
    /// How far along its own normal the solid's depth pushes it, for a depth factor of 1 \[m\], and which factor that is.
    by_depth: f64,
    depth_factor: usize,
    /// How far along its own normal it is seen for each metre that its link is in front of the plane.
    by_front: f64,
    /// Where its edge is seen in the plane \[m\], and by which share that is farther from the camera's foot than the edge itself.
    at: Place,
    farther: f64,
}

impl Camera {
    /// Before `plane` in pictures of `size` (width, height), at the effective distance `distance_m` (air + glass/1.52 + water/1.333).
    pub(super) fn new(plane: &Plane, size: [usize; 2], distance_m: Option<f64>) -> Self {
        let middle = [(size[0] as f64 - 1.0) / 2.0, (size[1] as f64 - 1.0) / 2.0];
        let scale_m = plane.metres_per_pixel(middle);
        let perspective = distance_m.map(|distance| {
            // The horizon of the plane says where the camera looks straight at it.
            let map = plane.metres_from_pixels();
            let weight = map[(2, 0)] * middle[0] + map[(2, 1)] * middle[1] + map[(2, 2)];
            let tilt = [map[(2, 0)] / weight, map[(2, 1)] / weight];
            let focal_px = distance / scale_m;
            let foot = [middle[0] + focal_px * focal_px * tilt[0], middle[1] + focal_px * focal_px * tilt[1]];
            (distance, plane.metres(foot))
        });
        Self { plane: plane.clone(), perspective, scale_m, size }
    }

    /// Where `points` of the outline are seen.
    pub(super) fn sees(&self, points: &[OutlinePoint], shared: &Shared) -> Vec<Seen> {
        points.iter().map(|point| self.sees_one(point, shared)).collect()
    }

    /// Where `solid` is seen \[px\], its depth left out.
    pub(super) fn shows(&self, solid: Strips) -> Strips {
        let axis = solid.axis.map(|end| self.plane.pixel(end));
        Strips::about(axis, solid.half_width.map(|half| half / self.scale_m), solid.rounding)
    }

    fn sees_one(&self, point: &OutlinePoint, shared: &Shared) -> Seen {
        // how far in front an edge is makes it larger about the camera's foot
        let (off, per_metre) = self.perspective.map_or((0.0, 0.0), |(distance, foot)| {
            (dot(minus(point.at, foot), point.normal), 1.0 / (WATER * distance))
        });
        // whichever face protrudes is seen: the near one looks larger, the far one smaller
        let depth_factor = usize::from(off < 0.0);
        let depth = shared.depth[depth_factor];
        let in_front = shared.in_front_m.get(point.link).copied().unwrap_or_default();
        let by_depth = point.half_depth * per_metre * off.abs();
        let by_front = per_metre * off;
        let farther = per_metre * (depth * point.half_depth.copysign(off) + in_front);
        let at = plus(point.at, scaled(point.normal, depth * by_depth + in_front * by_front));
        let px = self.plane.pixel(at);
        // A small step both ways in the plane, for the slope of the picture there.
        let step = self.scale_m / 2.0;
        let slope = |way: Place| {
            let ahead = self.plane.pixel(plus(at, scaled(way, step)));
            let behind = self.plane.pixel(plus(at, scaled(way, -step)));
            scaled(minus(ahead, behind), 0.5 / step)
        };
        let columns = [slope([1.0, 0.0]), slope([0.0, 1.0])];
        let seen = |way: Place| plus(scaled(columns[0], way[0]), scaled(columns[1], way[1]));
        // at right angles to the tangent as it is seen, outward
        let tangent = seen(across(point.normal));
        let mut normal = unit([-tangent[1], tangent[0]]);
        if dot(normal, seen(point.normal)) < 0.0 {
            normal = scaled(normal, -1.0);
        }
        Seen {
            px,
            normal,
            along: columns.map(|column| dot(column, normal)),
            by_depth,
            depth_factor,
            by_front,
            at,
            farther,
        }
    }

    /// How far each point of the outline moves along its normal \[px\] with each number: the pose's angles, then what is shared; shape
    /// (points, numbers), row after row.
    pub(super) fn slopes(
        &self,
        mechanism: &Mechanism,
        pose: &[f64],
        shared: &Shared,
        points: &[OutlinePoint],
        seen: &[Seen],
    ) -> Vec<f64> {
        let (pivots, _) = mechanism.pivots(pose, shared.base);
        let foot = self.perspective.map_or([0.0; 2], |(_, foot)| foot);
        let mut rows = Vec::with_capacity(points.len() * (pose.len() + IN_FRONT + shared.in_front_m.len()));
        for (point, seen) in points.iter().zip(seen) {
            let by = |way: Place| dot(seen.along, way);
            let outward = by(point.normal);
            for (joint, pivot) in pivots[..pose.len()].iter().enumerate() {
                let pivot = plus(*pivot, scaled(minus(*pivot, foot), seen.farther));
                rows.push(if joint <= point.link { by(across(minus(seen.at, pivot))) } else { 0.0 });
            }
            rows.extend(seen.along.map(|along| along * (1.0 + seen.farther)));
            rows.extend(point.by_width.map(|by| outward * by * (1.0 + seen.farther)));
            rows.extend(
                [0, 1].map(|factor| if factor == seen.depth_factor { outward * seen.by_depth } else { 0.0 }),
            );
            rows.push(outward * point.by_beyond * (1.0 + seen.farther));
            let front = |link: usize| if link == point.link { outward * seen.by_front } else { 0.0 };
            rows.extend((0..shared.in_front_m.len()).map(front));
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;
    use camera::calibration::View;

    fn shipped(name: &str) -> sim::Model {
        let path = format!("{}/../../configs/models/{name}", env!("CARGO_MANIFEST_DIR"));
        sim::Model::from_mjcf(&std::fs::read_to_string(path).unwrap()).unwrap()
    }

    fn tilted() -> Plane {
        let map = Matrix3::new(2.5e-4, 1e-6, -0.08, -2e-6, -2.6e-4, 0.04, 1e-5, 2e-5, 1.0);
        Plane::new(map, [320.0, 240.0], -2e-7).unwrap()
    }

    #[test]
    fn slopes_are_those_of_small_steps() {
        for (name, soft) in [("chain-passive.xml", false), ("arm8.xml", true)] {
            let mechanism = Mechanism::of(&shipped(name), View::Xz, soft).unwrap().laid_out(0.003);
            let camera = Camera::new(&tilted(), [640, 480], Some(0.5));
            let pose: Vec<f64> = (0..mechanism.links()).map(|i| 0.3 - 0.1 * i as f64).collect();
            let in_front_m = if soft { Vec::new() } else { vec![0.002, -0.001, 0.001] };
            let shared = Shared {
                base: [0.002, -0.001],
                width: [1.1, 1.3],
                depth: [0.8, 0.5],
                beyond_m: 1e-4,
                in_front_m,
            };
            let numbers: Vec<f64> = pose.iter().copied().chain(shared.numbers()).collect();
            let n = pose.len();
            let seen = |numbers: &[f64]| {
                let shared = Shared::of(&numbers[n..]);
                camera.sees(&mechanism.outline(&numbers[..n], &shared), &shared)
            };
            let outline = mechanism.outline(&pose, &shared);
            let here = seen(&numbers);
            let slopes = camera.slopes(&mechanism, &pose, &shared, &outline, &here);
            for k in 0..numbers.len() {
                let step = if (n..n + 2).contains(&k) { 1e-6 } else { 1e-4 };
                let moved = |sign: f64| {
                    let mut numbers = numbers.clone();
                    numbers[k] += sign * step;
                    seen(&numbers)
                };
                let (ahead, behind) = (moved(1.0), moved(-1.0));
                for i in 0..here.len() {
                    let by = scaled(minus(ahead[i].px, behind[i].px), 0.5 / step);
                    let (wanted, got) = (dot(by, here[i].normal), slopes[i * numbers.len() + k]);
                    assert!(
                        (wanted - got).abs() < 0.02 * (1.0 + wanted.abs()),
                        "{name} {k} {i}: {wanted} {got}"
                    );
                }
            }
        }
    }

    #[test]
    fn keypoints_are_the_models_at_rest_and_move_by_their_slopes() {
        let model = shipped("arm8.xml");
        let mechanism = Mechanism::of(&model, View::Xz, true).unwrap();
        let rest = mechanism.keypoints(&[0.0; 8], [0.0; 2]);
        for (place, wanted) in rest.iter().zip([[0.0, 0.0], [0.0, -0.08], [0.0, -0.16]]) {
            assert!((place[0] - wanted[0]).hypot(place[1] - wanted[1]) < 1e-9, "{place:?}");
        }
        let mut pose = [0.1; 8];
        let slopes = mechanism.keypoint_slopes(&pose, [0.0; 2]);
        let before = mechanism.keypoints(&pose, [0.0; 2]);
        pose[3] += 1e-6;
        let after = mechanism.keypoints(&pose, [0.0; 2]);
        for axis in 0..2 {
            assert!(((after[2][axis] - before[2][axis]) / 1e-6 - slopes[2][3][axis]).abs() < 1e-5);
        }
    }
}
