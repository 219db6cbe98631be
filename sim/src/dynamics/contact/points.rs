//! Where two shapes meet, as MuJoCo's own functions for each pair of shapes find it.
//!
//! A point lies midway between the two surfaces; its normal goes from the first shape to the second; its distance is negative
//! where they overlap.

use super::boxes;
use crate::math::{Mat3, Vec3};
use crate::model::GeomKind;
use crate::scalar::{Mask, Scalar};

/// A shape in its place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed<T> {
    /// See [`GeomKind`].
    pub(crate) size: [f64; 3],
    pub(crate) at: Vec3<T>,
    /// `world_from_shape`.
    pub(crate) rot: Mat3<T>,
}

/// Where two shapes meet.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point<T> {
    pub(crate) at: Vec3<T>,
    /// Of length 1, from the first shape to the second.
    pub(crate) normal: Vec3<T>,
    /// Along which friction is taken first, where the shapes say so.
    pub(crate) along: Option<Vec3<T>>,
    /// Below 0 where they overlap \[m\].
    pub(crate) distance: T,
}

/// Smallest divisor, as in MuJoCo.
const DIVISOR_MIN: f64 = 1e-15;

/// `a < b` of a number with one lane.
#[inline(always)]
pub(super) fn less<T: Scalar>(a: T, b: T) -> bool {
    a.less(b).any()
}

/// The order in which a pair's shapes are taken.
pub(super) fn rank(kind: GeomKind) -> u8 {
    match kind {
        GeomKind::Plane => 0,
        GeomKind::Sphere => 1,
        GeomKind::Capsule => 2,
        GeomKind::Ellipsoid => 3,
        GeomKind::Cylinder => 4,
        GeomKind::Box => 5,
    }
}

/// What finds the points of a pair.
pub(super) type Meet<T> = fn(&Placed<T>, &Placed<T>, T, &mut Vec<Point<T>>);

/// What finds the points of `first` and `second`, the lower [`rank`] first; `None` where this pair of shapes is not done.
pub(super) fn meeting<T: Scalar>(first: GeomKind, second: GeomKind) -> Option<Meet<T>> {
    Some(match (first, second) {
        (GeomKind::Plane, GeomKind::Sphere) => plane_sphere,
        (GeomKind::Plane, GeomKind::Capsule) => plane_capsule,
        (GeomKind::Plane, GeomKind::Ellipsoid) => plane_ellipsoid,
        (GeomKind::Plane, GeomKind::Cylinder) => plane_cylinder,
        (GeomKind::Plane, GeomKind::Box) => plane_box,
        (GeomKind::Sphere, GeomKind::Sphere) => sphere_sphere,
        (GeomKind::Sphere, GeomKind::Capsule) => sphere_capsule,
        (GeomKind::Capsule, GeomKind::Capsule) => capsule_capsule,
        (GeomKind::Box, GeomKind::Box) => boxes::meet,
        _ => return None,
    })
}

/// Adds the point of `plane` below the surface point `lowest`, if it is within `reach`.
fn above<T: Scalar>(plane: &Placed<T>, lowest: Vec3<T>, reach: T, out: &mut Vec<Point<T>>) -> bool {
    let normal = plane.rot.column(2);
    let distance = (lowest - plane.at).dot(normal);
    let near = !less(reach, distance);
    if near {
        let at = lowest - normal * (distance * T::from_f64(0.5));
        out.push(Point { at, normal, along: None, distance });
    }
    near
}

fn plane_sphere<T: Scalar>(plane: &Placed<T>, ball: &Placed<T>, reach: T, out: &mut Vec<Point<T>>) {
    above(plane, ball.at - plane.rot.column(2) * T::from_f64(ball.size[0]), reach, out);
}

fn plane_capsule<T: Scalar>(plane: &Placed<T>, capsule: &Placed<T>, reach: T, out: &mut Vec<Point<T>>) {
    let axis = capsule.rot.column(2);
    let below = plane.rot.column(2) * T::from_f64(capsule.size[0]);
    for half in [capsule.size[1], -capsule.size[1]] {
        if above(plane, capsule.at + axis * T::from_f64(half) - below, reach, out)
            && let Some(point) = out.last_mut()
        {
            point.along = Some(axis);
        }
    }
}

fn plane_ellipsoid<T: Scalar>(plane: &Placed<T>, shape: &Placed<T>, reach: T, out: &mut Vec<Point<T>>) {
    let size = Vec3::constant(shape.size);
    let down = shape.rot.apply_transposed(-plane.rot.column(2));
    let scaled = size.times(down);
    let lowest = size.times(scaled) * (T::ONE / scaled.norm());
    above(plane, shape.at + shape.rot.apply(lowest), reach, out);
}

/// Up to four points: the lowest of the lower rim, the one of the upper rim over it, and two more of the lower rim that make an
/// equilateral triangle with the first.
fn plane_cylinder<T: Scalar>(plane: &Placed<T>, shape: &Placed<T>, reach: T, out: &mut Vec<Point<T>>) {
    let normal = plane.rot.column(2);
    let mut axis = shape.rot.column(2);
    if less(T::ZERO, axis.dot(normal)) {
        axis = -axis;
    }
    let [radius, half] = [shape.size[0], shape.size[1]].map(T::from_f64);
    // straight down, less what of it is along the axis
    let mut outward = axis * axis.dot(normal) - normal;
    let length = outward.norm();
    if less(length, T::from_f64(DIVISOR_MIN)) {
        outward = shape.rot.column(0) * radius;
    } else {
        outward = outward * (radius / length);
    }
    let (lower, upper) = (shape.at + axis * half, shape.at - axis * half);
    if !above(plane, lower + outward, reach, out) {
        return;
    }
    above(plane, upper + outward, reach, out);
    let sideways = outward.cross(axis);
    let sideways = sideways * (radius * T::from_f64(f64::sqrt(3.0) / 2.0) / sideways.norm());
    let behind = lower - outward * T::from_f64(0.5);
    above(plane, behind + sideways, reach, out);
    above(plane, behind - sideways, reach, out);
}

/// The corners that are on the plane's side of the centre, no more than four.
fn plane_box<T: Scalar>(plane: &Placed<T>, shape: &Placed<T>, reach: T, out: &mut Vec<Point<T>>) {
    let normal = plane.rot.column(2);
    let mut found = 0;
    for corner in 0..8 {
        let own = std::array::from_fn(|k| if corner >> k & 1 == 1 { shape.size[k] } else { -shape.size[k] });
        let corner = shape.rot.apply(Vec3::constant(own));
        if less(T::ZERO, corner.dot(normal)) {
            continue;
        }
        found += usize::from(above(plane, shape.at + corner, reach, out));
        if found == 4 {
            return;
        }
    }
}

/// Two balls.
fn balls<T: Scalar>(a: Vec3<T>, b: Vec3<T>, radii: [f64; 2], reach: T, out: &mut Vec<Point<T>>) -> bool {
    let way = b - a;
    let length = way.norm();
    let distance = length - T::from_f64(radii[0]) - T::from_f64(radii[1]);
    if less(reach, distance) {
        return false;
    }
    // where the centres coincide no direction is better than another
    let normal = if less(length, T::from_f64(DIVISOR_MIN)) {
        Vec3::constant([1.0, 0.0, 0.0])
    } else {
        way * (T::ONE / length)
    };
    let at = a + normal * (T::from_f64(radii[0]) + distance * T::from_f64(0.5));
    out.push(Point { at, normal, along: None, distance });
    true
}

fn sphere_sphere<T: Scalar>(a: &Placed<T>, b: &Placed<T>, reach: T, out: &mut Vec<Point<T>>) {
    balls(a.at, b.at, [a.size[0], b.size[0]], reach, out);
}

fn sphere_capsule<T: Scalar>(ball: &Placed<T>, capsule: &Placed<T>, reach: T, out: &mut Vec<Point<T>>) {
    let axis = capsule.rot.column(2);
    let half = T::from_f64(capsule.size[1]);
    let nearest = axis * axis.dot(ball.at - capsule.at).clamp(-half, half);
    balls(ball.at, capsule.at + nearest, [ball.size[0], capsule.size[0]], reach, out);
}

/// The nearest points of both segments, a + x u and b + y w with x and y between -1 and 1; of parallel ones up to two pairs of
/// points, from the ends of either.
fn capsule_capsule<T: Scalar>(one: &Placed<T>, two: &Placed<T>, reach: T, out: &mut Vec<Point<T>>) {
    let (u, w) = (one.rot.column(2) * T::from_f64(one.size[1]), two.rot.column(2) * T::from_f64(two.size[1]));
    let radii = [one.size[0], two.size[0]];
    let between = one.at - two.at;
    let (uu, uw, ww) = (u.dot(u), u.dot(w), w.dot(w));
    let (along_u, along_w) = (-u.dot(between), w.dot(between));
    let unit = |x: T| x.clamp(-T::ONE, T::ONE);
    // the nearest place on the other one's line
    let on_two = |x: T| (along_w + x * uw) / ww;
    let on_one = |y: T| (along_u + y * uw) / uu;
    let determinant = uu * ww - uw * uw;
    let mut pair = |x: T, y: T| usize::from(balls(one.at + u * x, two.at + w * y, radii, reach, out));
    if !less(determinant.abs(), T::from_f64(DIVISOR_MIN)) {
        let mut x = (ww * along_u + uw * along_w) / determinant;
        let mut y = (uu * along_w + uw * along_u) / determinant;
        if less(T::ONE, x.abs()) {
            x = unit(x);
            y = on_two(x);
        }
        if less(T::ONE, y.abs()) {
            y = unit(y);
            x = unit(on_one(y));
        }
        pair(x, y);
        return;
    }
    let mut found = 0;
    for end in [T::ONE, -T::ONE] {
        found += pair(end, unit(on_two(end)));
    }
    for end in [T::ONE, -T::ONE] {
        if found < 2 {
            found += pair(unit(on_one(end)), end);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::PossibleContact;

    #[test]
    fn the_pairs_that_a_model_calls_simulated_are_those_that_are_done() {
        let kinds = [
            GeomKind::Plane,
            GeomKind::Sphere,
            GeomKind::Capsule,
            GeomKind::Ellipsoid,
            GeomKind::Cylinder,
            GeomKind::Box,
        ];
        let mut done = 0;
        for (index, &a) in kinds.iter().enumerate() {
            for &b in &kinds[index..] {
                let found = meeting::<f64>(a, b).is_some();
                assert_eq!(PossibleContact::is_simulated(a, b), found, "{a:?} {b:?}");
                assert_eq!(PossibleContact::is_simulated(b, a), found, "{b:?} {a:?}");
                done += usize::from(found);
            }
        }
        assert_eq!(done, 9);
    }
}
