//! How far apart two shapes are.
//!
//! A shape is a core and a radius around it: a ball's core is a point, a capsule's a segment, the others have no radius. The
//! distance of two cores is that of the origin from the set of their points' differences, found from the cores' farthest
//! points alone (Gilbert, Johnson and Keerthi, A fast procedure for computing the distance between complex objects in
//! three-dimensional space, 1988).

use crate::math::{Mat3, Vec3};
use crate::model::GeomKind;

/// A shape in its place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Solid {
    pub(super) kind: GeomKind,
    /// See [`GeomKind`].
    pub(super) size: [f64; 3],
    pub(super) at: Vec3<f64>,
    /// `world_from_shape`.
    pub(super) rot: Mat3<f64>,
}

/// Most iterations of the search (chosen); smooth shapes need a few dozen.
const ITERATIONS_MAX: usize = 200;
/// The search ends when the squared distance is known to this share (chosen).
const DISTANCE_TOLERANCE_SHARE: f64 = 1e-9;
/// Cores closer than this count as touching \[m\] (chosen).
const CORE_CONTACT_DISTANCE_M: f64 = 1e-12;

/// A height above a face is not known better than this share of the lengths that it comes from (chosen: some thousand roundings).
const ROUNDING_SHARE: f64 = 1e-12;

impl Solid {
    /// Radius of the ball around `at` that holds it all; infinite for a plane.
    pub(super) fn reach(&self) -> f64 {
        let [a, b, c] = self.size;
        match self.kind {
            GeomKind::Sphere => a,
            GeomKind::Capsule => a + b,
            GeomKind::Cylinder => a.hypot(b),
            GeomKind::Ellipsoid => a.max(b).max(c),
            GeomKind::Box => Vec3(self.size).norm(),
            GeomKind::Plane => f64::INFINITY,
        }
    }

    /// What lies around the core.
    fn radius(&self) -> f64 {
        match self.kind {
            GeomKind::Sphere | GeomKind::Capsule => self.size[0],
            _ => 0.0,
        }
    }

    /// The core's farthest point along `towards`.
    fn support(&self, towards: Vec3<f64>) -> Vec3<f64> {
        let own = self.rot.apply_transposed(towards);
        let [x, y, z] = own.0;
        let [a, b, c] = self.size;
        let far = match self.kind {
            GeomKind::Sphere | GeomKind::Plane => [0.0; 3],
            GeomKind::Capsule => [0.0, 0.0, b.copysign(z)],
            GeomKind::Cylinder => {
                let across = x.hypot(y);
                let share = if across > 0.0 { a / across } else { 0.0 };
                [x * share, y * share, b.copysign(z)]
            }
            GeomKind::Ellipsoid => {
                let scaled = Vec3([a * x, b * y, c * z]);
                let length = scaled.norm();
                let share = if length > 0.0 { 1.0 / length } else { 0.0 };
                [a * scaled[0] * share, b * scaled[1] * share, c * scaled[2] * share]
            }
            GeomKind::Box => [a.copysign(x), b.copysign(y), c.copysign(z)],
        };
        self.at + self.rot.apply(Vec3(far))
    }
}

/// Distance \[m\] of two shapes; 0 or less where they overlap.
pub(super) fn distance(a: &Solid, b: &Solid) -> f64 {
    match (a.kind, b.kind) {
        (GeomKind::Plane, _) => above(a, b),
        (_, GeomKind::Plane) => above(b, a),
        _ => between_cores(a, b) - a.radius() - b.radius(),
    }
}

/// How far `solid` is above the plane, which is solid below.
fn above(plane: &Solid, solid: &Solid) -> f64 {
    let normal = plane.rot.column(2);
    (solid.support(-normal) - plane.at).dot(normal) - solid.radius()
}

/// Distance of the cores; 0 where they overlap.
fn between_cores(a: &Solid, b: &Solid) -> f64 {
    let difference = |towards: Vec3<f64>| a.support(towards) - b.support(-towards);
    let mut simplex = Simplex { points: [Vec3::ZERO; 4], count: 0 };
    let mut nearest = difference(b.at - a.at);
    simplex.push(nearest);
    for _ in 0..ITERATIONS_MAX {
        let squared = nearest.dot(nearest);
        if squared < CORE_CONTACT_DISTANCE_M * CORE_CONTACT_DISTANCE_M {
            return 0.0;
        }
        let next = difference(-nearest);
        // no point of the set lies nearer along this direction than `next` does
        if squared - nearest.dot(next) <= DISTANCE_TOLERANCE_SHARE * squared || simplex.has(next) {
            break;
        }
        simplex.push(next);
        match simplex.reduce() {
            Some(point) if point.dot(point) < squared => nearest = point,
            // no nearer: rounding is all that is left
            Some(_) => break,
            None => return 0.0,
        }
    }
    nearest.norm()
}

/// Up to four points of the set of differences.
struct Simplex {
    points: [Vec3<f64>; 4],
    count: usize,
}

impl Simplex {
    fn push(&mut self, point: Vec3<f64>) {
        self.points[self.count] = point;
        self.count += 1;
    }

    fn has(&self, point: Vec3<f64>) -> bool {
        self.points[..self.count].contains(&point)
    }

    /// The nearest point to the origin of what the points span, and of the points only those that span it. `None` where
    /// the origin is inside.
    fn reduce(&mut self) -> Option<Vec3<f64>> {
        let points = self.points;
        let (retained, nearest) = match self.count {
            1 => ([Some(0), None, None], points[0]),
            2 => segment(&points, [0, 1]),
            3 => triangle(&points, [0, 1, 2]),
            _ => {
                let faces = [([0, 1, 2], 3), ([0, 1, 3], 2), ([0, 2, 3], 1), ([1, 2, 3], 0)];
                let outside = faces.into_iter().filter(|&(face, other)| beyond(&points, face, other));
                outside
                    .map(|(face, _)| triangle(&points, face))
                    .min_by(|(_, a), (_, b)| a.dot(*a).total_cmp(&b.dot(*b)))?
            }
        };
        self.count = 0;
        for index in retained.into_iter().flatten() {
            self.push(points[index]);
        }
        Some(nearest)
    }
}

/// Which points span the nearest one, and that.
type Nearest = ([Option<usize>; 3], Vec3<f64>);

/// Whether the origin is on the other side of the face than `other`, or so near it that rounding decides; a flat tetrahedron has it on both.
fn beyond(points: &[Vec3<f64>; 4], [a, b, c]: [usize; 3], other: usize) -> bool {
    let normal = (points[b] - points[a]).cross(points[c] - points[a]);
    let way = points[other] - points[a];
    let (here, there) = (-normal.dot(points[a]), normal.dot(way));
    let rounding = ROUNDING_SHARE * normal.norm();
    here * there <= 0.0 || here.abs() <= rounding * points[a].norm() || there.abs() <= rounding * way.norm()
}

fn segment(points: &[Vec3<f64>; 4], [i, j]: [usize; 2]) -> Nearest {
    let (a, way) = (points[i], points[j] - points[i]);
    let along = -a.dot(way);
    let length = way.dot(way);
    if along <= 0.0 {
        ([Some(i), None, None], a)
    } else if along >= length {
        ([Some(j), None, None], points[j])
    } else {
        ([Some(i), Some(j), None], a + way * (along / length))
    }
}

fn triangle(points: &[Vec3<f64>; 4], [i, j, k]: [usize; 3]) -> Nearest {
    let (a, b, c) = (points[i], points[j], points[k]);
    let normal = (b - a).cross(c - a);
    let squared = normal.dot(normal);
    // on which side of an edge the origin lies, in the triangle's plane
    let inside = |from: Vec3<f64>, to: Vec3<f64>| (to - from).cross(normal).dot(from) >= 0.0;
    if squared > 0.0 && inside(a, b) && inside(b, c) && inside(c, a) {
        return ([Some(i), Some(j), Some(k)], normal * (normal.dot(a) / squared));
    }
    let edges = [[i, j], [j, k], [k, i]].map(|edge| segment(points, edge));
    let [first, second, third] = edges;
    [second, third].into_iter().fold(
        first,
        |best, edge| {
            if edge.1.dot(edge.1) < best.1.dot(best.1) { edge } else { best }
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Quat;

    /// The search's own share, of distances of centimetres.
    const SEARCH_M: f64 = 1e-9;

    fn solid(kind: GeomKind, size: [f64; 3], at: [f64; 3], quat: [f64; 4]) -> Solid {
        Solid { kind, size, at: Vec3(at), rot: Quat(quat).normalized().matrix() }
    }

    const UPRIGHT: [f64; 4] = [1.0, 0.0, 0.0, 0.0];
    /// A quarter turn about x: z goes to -y.
    const LYING: [f64; 4] = [1.0, 1.0, 0.0, 0.0];

    #[test]
    fn distances_agree_with_those_known_in_closed_form() {
        use GeomKind::{Box, Capsule, Cylinder, Ellipsoid, Plane, Sphere};
        let half = [0.01, 0.02, 0.03];
        let cases = [
            (
                solid(Sphere, [0.01, 0.0, 0.0], [0.0; 3], UPRIGHT),
                solid(Sphere, half, [0.03, 0.04, 0.0], LYING),
                0.03,
            ),
            // crossed capsules
            (
                solid(Capsule, [0.01, 0.05, 0.0], [0.0; 3], UPRIGHT),
                solid(Capsule, [0.005, 0.05, 0.0], [0.04, 0.0, 0.01], LYING),
                0.025,
            ),
            // a capsule's end over a box's corner region
            (
                solid(Box, half, [0.0; 3], UPRIGHT),
                solid(Capsule, [0.002, 0.01, 0.0], [0.04, 0.06, 0.03], UPRIGHT),
                0.05 - 0.002,
            ),
            (solid(Box, half, [0.0; 3], UPRIGHT), solid(Box, half, [0.05, 0.01, 0.02], UPRIGHT), 0.03),
            // edge against edge: z of the second lies along -y
            (
                solid(Box, half, [0.0; 3], UPRIGHT),
                solid(Box, half, [0.05, 0.09, 0.0], LYING),
                f64::hypot(0.03, 0.04),
            ),
            (
                solid(Cylinder, [0.01, 0.03, 0.0], [0.0; 3], UPRIGHT),
                solid(Cylinder, [0.02, 0.03, 0.0], [0.06, 0.0, 0.0], UPRIGHT),
                0.03,
            ),
            // rims one over the other
            (
                solid(Cylinder, [0.01, 0.03, 0.0], [0.0; 3], UPRIGHT),
                solid(Cylinder, [0.02, 0.03, 0.0], [0.06, 0.0, 0.1], UPRIGHT),
                f64::hypot(0.03, 0.04),
            ),
            (
                solid(Ellipsoid, half, [0.0; 3], UPRIGHT),
                solid(Ellipsoid, half, [0.0, 0.0, 0.08], UPRIGHT),
                0.02,
            ),
            (
                solid(Ellipsoid, [0.02; 3], [0.0; 3], UPRIGHT),
                solid(Sphere, half, [0.03, 0.03, 0.03], UPRIGHT),
                0.03 * f64::sqrt(3.0) - 0.03,
            ),
            (
                solid(Plane, [0.0; 3], [0.0, 0.0, -0.1], UPRIGHT),
                solid(Box, half, [0.5, 0.0, 0.0], LYING),
                0.08,
            ),
            (
                solid(Plane, [0.0; 3], [0.0; 3], LYING),
                solid(Capsule, [0.01, 0.05, 0.0], [0.0, -0.2, 0.0], LYING),
                0.14,
            ),
        ];
        for (a, b, expected) in cases {
            for found in [distance(&a, &b), distance(&b, &a)] {
                assert!((found - expected).abs() < SEARCH_M, "{a:?} {b:?}: {found} {expected}");
            }
        }
    }

    /// An ellipsoid far off against a plane's worth of box: nearest point by the ellipsoid's own support.
    #[test]
    fn a_tilted_ellipsoid_stands_over_a_box_as_its_support_says() {
        let ellipsoid =
            solid(GeomKind::Ellipsoid, [0.01, 0.02, 0.04], [0.001, -0.002, 0.08], [0.9, 0.3, -0.2, 0.1]);
        let box_ = solid(GeomKind::Box, [1.0, 1.0, 0.01], [0.0; 3], UPRIGHT);
        let lowest = ellipsoid.support(Vec3([0.0, 0.0, -1.0]))[2];
        assert!((distance(&box_, &ellipsoid) - (lowest - 0.01)).abs() < SEARCH_M);
    }

    #[test]
    fn shapes_inside_each_other_have_no_distance() {
        let kinds =
            [GeomKind::Sphere, GeomKind::Capsule, GeomKind::Cylinder, GeomKind::Ellipsoid, GeomKind::Box];
        for a in kinds {
            for b in kinds {
                let first = solid(a, [0.02, 0.03, 0.01], [0.0; 3], LYING);
                let second = solid(b, [0.01, 0.02, 0.03], [0.004, 0.003, -0.002], [0.7, 0.2, 0.1, 0.4]);
                assert!(distance(&first, &second) <= 0.0, "{a:?} {b:?}");
            }
        }
    }
}
