//! One plane: a mechanism whose hinges are all parallel, seen along them.
//!
//! The hinges carry every force out of the plane and every torque about an axis in it, so that two components of
//! a velocity and one of a turn are all there is. A body's planar axes are those of the plane at the reference, so that
//! at the reference no body is rotated.

use std::marker::PhantomData;

use super::{ShapeAxes, Space};
use crate::math::{Mat3, Quat, Sym3, Vec1, Vec2, Vec3};
use crate::scalar::{Mask, Scalar};

/// A plane, over the numbers `T`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Planar<T>(PhantomData<T>);

/// A rotation in the plane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Turn<T> {
    pub(crate) cos: T,
    pub(crate) sin: T,
}

/// Where nothing can be of this kind.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Never {}

/// The plane of a mechanism in the world.
#[derive(Debug, Clone)]
pub(crate) struct Plane<T> {
    /// Two axes in the plane and the one across it, by rows: `plane_from_body` at the reference, shape (bodies).
    pub(crate) axes: Vec<Mat3<T>>,
    /// How far out of the plane each body's origin is \[m\], shape (bodies).
    pub(crate) depth: Vec<T>,
}

/// Directions this close count as the same: rounding in a chain of rotations is less.
const PARALLEL_TOLERANCE: f64 = 1e-12;

/// Whether `x` counts as 0.
pub(crate) fn tiny<T: Scalar>(x: T) -> bool {
    x.abs().less(T::from_f64(PARALLEL_TOLERANCE)).all()
}

impl<T: Scalar> Plane<T> {
    /// How far out of the plane a point fixed to `body` at `at`, in the body's axes, is.
    #[inline(always)]
    pub(crate) fn level(&self, body: usize, at: Vec3<T>) -> T {
        self.depth[body] + Vec3(self.axes[body].0[2]).dot(at)
    }

    /// Which own axis of a shape on `body` points across the plane.
    pub(crate) fn across(&self, body: usize, quat: Quat<T>) -> Option<usize> {
        let own = self.axes[body].product(&quat.matrix());
        let along = |k: usize| tiny(own.0[0][k]) && tiny(own.0[1][k]);
        (0..3).find(|&k| along(k))
    }
}

impl<T: Scalar> Space for Planar<T> {
    type T = T;
    type Vec = Vec2<T>;
    type Spin = Vec1<T>;
    type Rot = Turn<T>;
    type Sym = T;
    type Layout = Plane<T>;
    type AnyTurn = Never;

    const IDENTITY: Turn<T> = Turn { cos: T::ONE, sin: T::ZERO };
    const NO_INERTIA: T = T::ZERO;

    #[inline(always)]
    fn cross(Vec1([w]): Vec1<T>, Vec2([x, y]): Vec2<T>) -> Vec2<T> {
        Vec2([-(w * y), w * x])
    }

    #[inline(always)]
    fn moment(Vec2([x, y]): Vec2<T>, Vec2([fx, fy]): Vec2<T>) -> Vec1<T> {
        Vec1([x * fy - y * fx])
    }

    #[inline(always)]
    fn twist(_: Vec1<T>, _: Vec1<T>) -> Vec1<T> {
        Vec1::ZERO
    }

    #[inline(always)]
    fn apply(rot: &Turn<T>, Vec2([x, y]): Vec2<T>) -> Vec2<T> {
        Vec2([rot.cos * x - rot.sin * y, rot.sin * x + rot.cos * y])
    }

    #[inline(always)]
    fn back(rot: &Turn<T>, Vec2([x, y]): Vec2<T>) -> Vec2<T> {
        Vec2([rot.cos * x + rot.sin * y, rot.cos * y - rot.sin * x])
    }

    #[inline(always)]
    fn apply_spin(_: &Turn<T>, w: Vec1<T>) -> Vec1<T> {
        w
    }

    #[inline(always)]
    fn back_spin(_: &Turn<T>, w: Vec1<T>) -> Vec1<T> {
        w
    }

    #[inline(always)]
    fn product(a: &Turn<T>, b: &Turn<T>) -> Turn<T> {
        Turn { cos: a.cos * b.cos - a.sin * b.sin, sin: a.sin * b.cos + a.cos * b.sin }
    }

    #[inline(always)]
    fn about(Vec1([axis]): Vec1<T>, (sin, cos): (T, T)) -> Turn<T> {
        Turn { cos, sin: axis * sin }
    }

    #[inline(always)]
    fn momentum(inertia: &T, Vec1([w]): Vec1<T>) -> Vec1<T> {
        Vec1([*inertia * w])
    }

    #[inline(always)]
    fn rotated(inertia: &T, _: &Turn<T>) -> T {
        *inertia
    }

    #[inline(always)]
    fn of_point(mass: T, at: Vec2<T>) -> T {
        mass * at.dot(at)
    }

    #[inline(always)]
    fn any_turn(possible: Never, _: Quat<T>) -> Turn<T> {
        match possible {}
    }

    #[inline(always)]
    fn anywhere(possible: Never, _: [T; 3]) -> Vec2<T> {
        match possible {}
    }

    #[inline(always)]
    fn travel(possible: Never, _: usize) -> Vec2<T> {
        match possible {}
    }

    #[inline(always)]
    fn turn_axis(possible: Never, _: &Turn<T>, _: usize) -> Vec1<T> {
        match possible {}
    }

    fn any_turn_possible(_: &Plane<T>) -> Option<Never> {
        None
    }

    fn vector(plane: &Plane<T>, body: usize, v: Vec3<T>) -> Vec2<T> {
        let [x, y, _] = plane.axes[body].apply(v).0;
        Vec2([x, y])
    }

    fn spin(plane: &Plane<T>, body: usize, w: Vec3<T>) -> Vec1<T> {
        Vec1([plane.axes[body].apply(w)[2]])
    }

    fn inertia(plane: &Plane<T>, body: usize, inertia: Sym3<T>) -> T {
        let across = Vec3(plane.axes[body].0[2]);
        across.dot(inertia.apply(across))
    }

    fn link_rotation(_: &Plane<T>, _: Quat<T>) -> Option<Turn<T>> {
        None
    }

    fn shape_axes(plane: &Plane<T>, body: usize, quat: Quat<T>) -> (Option<Turn<T>>, ShapeAxes) {
        // a plane is only made where every shape has such an axis
        let across = plane.across(body, quat).unwrap_or(2);
        let own = plane.axes[body].product(&quat.matrix());
        let level = |k: usize| own.0[1][k] == T::ZERO;
        let (a, b) = ((across + 1) % 3, (across + 2) % 3);
        // shapes are symmetric, so either of the two may come first: best the one that already lies level
        let [a, b] = if level(b) { [b, a] } else { [a, b] };
        let rot = (!level(a)).then_some(Turn { cos: own.0[0][a], sin: own.0[1][a] });
        (rot, [a, b, across])
    }

    fn shape_vector([a, b, _]: ShapeAxes, v: Vec3<T>) -> Vec2<T> {
        Vec2([v[a], v[b]])
    }

    fn shape_spin([.., across]: ShapeAxes, w: Vec3<T>) -> Vec1<T> {
        Vec1([w[across]])
    }

    #[inline(always)]
    fn constant([a, b, _]: [f64; 3]) -> Vec2<T> {
        Vec2::constant([a, b])
    }

    #[inline(always)]
    fn constant_spin([.., across]: [f64; 3]) -> Vec1<T> {
        Vec1::constant([across])
    }

    #[inline(always)]
    fn lift(plane: &Plane<T>, body: usize, at: Vec3<T>, Vec2([x, y]): Vec2<T>) -> [T; 3] {
        let depth = plane.level(body, at);
        plane.axes[0].apply_transposed(Vec3([x, y, depth])).0
    }
}
