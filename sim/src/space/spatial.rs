//! Space: three components for everything.

use std::marker::PhantomData;

use super::{ShapeAxes, Space};
use crate::math::{Mat3, Quat, Sym3, Vec3};
use crate::scalar::Scalar;

/// Space, over the numbers `T`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spatial<T>(PhantomData<T>);

impl<T: Scalar> Space for Spatial<T> {
    type T = T;
    type Vec = Vec3<T>;
    type Spin = Vec3<T>;
    type Rot = Mat3<T>;
    type Sym = Sym3<T>;
    type Layout = ();
    type AnyTurn = ();

    const IDENTITY: Mat3<T> = Mat3::IDENTITY;
    const NO_INERTIA: Sym3<T> = Sym3::ZERO;

    #[inline(always)]
    fn cross(turn: Vec3<T>, arm: Vec3<T>) -> Vec3<T> {
        turn.cross(arm)
    }

    #[inline(always)]
    fn moment(arm: Vec3<T>, force: Vec3<T>) -> Vec3<T> {
        arm.cross(force)
    }

    #[inline(always)]
    fn twist(a: Vec3<T>, b: Vec3<T>) -> Vec3<T> {
        a.cross(b)
    }

    #[inline(always)]
    fn apply(rot: &Mat3<T>, v: Vec3<T>) -> Vec3<T> {
        rot.apply(v)
    }

    #[inline(always)]
    fn back(rot: &Mat3<T>, v: Vec3<T>) -> Vec3<T> {
        rot.apply_transposed(v)
    }

    #[inline(always)]
    fn apply_spin(rot: &Mat3<T>, w: Vec3<T>) -> Vec3<T> {
        rot.apply(w)
    }

    #[inline(always)]
    fn back_spin(rot: &Mat3<T>, w: Vec3<T>) -> Vec3<T> {
        rot.apply_transposed(w)
    }

    #[inline(always)]
    fn product(a: &Mat3<T>, b: &Mat3<T>) -> Mat3<T> {
        a.product(b)
    }

    #[inline(always)]
    fn about(axis: Vec3<T>, sin_cos: (T, T)) -> Mat3<T> {
        Mat3::about(axis, sin_cos)
    }

    #[inline(always)]
    fn swung(rot: &Mat3<T>, axis: Vec3<T>, along: Option<usize>, (sin, cos): (T, T)) -> Mat3<T> {
        match along {
            Some(0) => rot.turned_in::<1, 2>(sin * axis[0], cos),
            Some(1) => rot.turned_in::<2, 0>(sin * axis[1], cos),
            Some(2) => rot.turned_in::<0, 1>(sin * axis[2], cos),
            _ => rot.product(&Mat3::about(axis, (sin, cos))),
        }
    }

    fn along(axis: Vec3<T>) -> Option<usize> {
        (0..3).find(|&k| axis[k].abs() == T::ONE)
    }

    #[inline(always)]
    fn momentum(inertia: &Sym3<T>, w: Vec3<T>) -> Vec3<T> {
        inertia.apply(w)
    }

    #[inline(always)]
    fn rotated(inertia: &Sym3<T>, rot: &Mat3<T>) -> Sym3<T> {
        inertia.rotated(rot)
    }

    #[inline(always)]
    fn of_point(mass: T, at: Vec3<T>) -> Sym3<T> {
        Sym3::of_point(mass, at)
    }

    #[inline(always)]
    fn any_turn((): (), quat: Quat<T>) -> Mat3<T> {
        quat.matrix()
    }

    #[inline(always)]
    fn anywhere((): (), at: [T; 3]) -> Vec3<T> {
        Vec3(at)
    }

    #[inline(always)]
    fn travel((): (), k: usize) -> Vec3<T> {
        Vec3(Mat3::IDENTITY.0[k])
    }

    #[inline(always)]
    fn turn_axis((): (), rot: &Mat3<T>, k: usize) -> Vec3<T> {
        rot.column(k)
    }

    fn any_turn_possible((): &()) -> Option<()> {
        Some(())
    }

    fn vector((): &(), _: usize, v: Vec3<T>) -> Vec3<T> {
        v
    }

    fn spin((): &(), _: usize, w: Vec3<T>) -> Vec3<T> {
        w
    }

    fn inertia((): &(), _: usize, inertia: Sym3<T>) -> Sym3<T> {
        inertia
    }

    fn link_rotation((): &(), quat: Quat<T>) -> Option<Mat3<T>> {
        (quat != Quat::IDENTITY).then(|| quat.matrix())
    }

    fn shape_axes((): &(), _: usize, quat: Quat<T>) -> (Option<Mat3<T>>, ShapeAxes) {
        (Self::link_rotation(&(), quat), [0, 1, 2])
    }

    fn shape_vector(_: ShapeAxes, v: Vec3<T>) -> Vec3<T> {
        v
    }

    fn shape_spin(_: ShapeAxes, w: Vec3<T>) -> Vec3<T> {
        w
    }

    #[inline(always)]
    fn constant(v: [f64; 3]) -> Vec3<T> {
        Vec3::constant(v)
    }

    #[inline(always)]
    fn constant_spin(w: [f64; 3]) -> Vec3<T> {
        Vec3::constant(w)
    }

    #[inline(always)]
    fn lift((): &(), _: usize, _: Vec3<T>, v: Vec3<T>) -> [T; 3] {
        v.0
    }
}
