//! One plane: a mechanism whose hinges are all parallel, seen along them.
//!
//! The hinges carry every force out of the plane and every torque about an axis in it, so that two components of
//! a velocity and one of a turn are all there is. A body's planar axes are those of the plane at the reference, so that
//! at the reference no body is rotated.

use std::marker::PhantomData;

use super::{LimbStage, ShapeAxes, SlopeStage, Space};
use crate::dynamics::Work;
use crate::dynamics::plant::Plant;
use crate::math::{Mat3, Quat, Sym3, Vec1, Vec2, Vec3};
use crate::model::{JointKind, Model};
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
    axes: Vec<Mat3<T>>,
    /// How far out of the plane each body's origin is \[m\], shape (bodies).
    depth: Vec<T>,
}

/// Directions this close count as the same: rounding in a chain of rotations is less.
const PARALLEL: f64 = 1e-12;

fn tiny<T: Scalar>(x: T) -> bool {
    x.abs().less(T::from_f64(PARALLEL)).all()
}

/// Axes, by rows, of which the third is `across`; the axis farthest from it comes first in the plane.
fn upright<T: Scalar>(across: Vec3<T>) -> Mat3<T> {
    let [x, y, z] = Mat3::IDENTITY.0;
    let slanted = |v: [T; 3]| across.dot(Vec3(v)).abs();
    let nearer = slanted(z).less(slanted(x));
    let first = Vec3(if nearer.all() { z } else { x });
    let first = if slanted(y).less(slanted(first.0)).all() { Vec3(y) } else { first };
    let first = first - across * across.dot(first);
    let first = first * (T::ONE / first.norm());
    Mat3([first.0, across.cross(first).0, across.0])
}

impl<T: Scalar> Plane<T> {
    /// The plane that `model` moves in, if it does: hinges parallel, slides and wind at right angles to them, every
    /// shape that feels the water with one axis along them.
    pub(crate) fn of(model: &Model<T>) -> Option<Self> {
        if model.joints.iter().any(|joint| matches!(joint.kind, JointKind::Ball | JointKind::Free)) {
            return None;
        }
        let mut world: Vec<Mat3<T>> = vec![Mat3::IDENTITY; model.bodies.len()];
        for (index, body) in model.bodies.iter().enumerate().skip(1) {
            world[index] = world[body.parent].product(&body.quat.matrix());
        }
        let hinge = model.joints.iter().find(|joint| joint.kind == JointKind::Hinge)?;
        let across = world[hinge.body].apply(hinge.axis);
        let plane = upright(across);
        let mut depth = vec![T::ZERO; model.bodies.len()];
        for (index, body) in model.bodies.iter().enumerate().skip(1) {
            depth[index] = depth[body.parent] + across.dot(world[body.parent].apply(body.pos));
        }
        let plane = Self { axes: world.iter().map(|rot| plane.product(rot)).collect(), depth };
        plane.holds(model).then_some(plane)
    }

    /// The plane that the bodies of `branch` move in relative to the body they hang from, each after its parent:
    /// hinges alone move them, all parallel and one a body at most; masses and wet shapes lie even in one plane. That
    /// plane is fixed to the carrier, whose own axes count as the world's; it goes through the carrier's origin but for a
    /// distance along the hinges \[m\], which comes second.
    pub(crate) fn riding(model: &Model<T>, branch: &[usize]) -> Option<(Self, T)> {
        let joints = || model.joints.iter().filter(|joint| branch.contains(&joint.body));
        let hinge = joints().next()?;
        let mut carried: Vec<Mat3<T>> = vec![Mat3::IDENTITY; model.bodies.len()];
        let mut origin = vec![Vec3::ZERO; model.bodies.len()];
        for &index in branch {
            let body = &model.bodies[index];
            origin[index] = origin[body.parent] + carried[body.parent].apply(body.pos);
            carried[index] = carried[body.parent].product(&body.quat.matrix());
        }
        let across = carried[hinge.body].apply(hinge.axis);
        let plane = upright(across);
        let depth: Vec<T> = origin.into_iter().map(|origin| across.dot(origin)).collect();
        let plane = Self { axes: carried.iter().map(|rot| plane.product(rot)).collect(), depth };

        let level = plane.level(branch[0], model.bodies[branch[0]].com);
        let even = |index: usize, at: Vec3<T>| tiny(plane.level(index, at) - level);
        let hinges = joints().all(|joint| {
            let [x, y, _] = plane.axes[joint.body].apply(joint.axis).0;
            joint.kind == JointKind::Hinge && tiny(x) && tiny(y)
        });
        let bodies = branch.iter().all(|&index| {
            let body = &model.bodies[index];
            let single = joints().filter(|joint| joint.body == index).count() <= 1;
            single && even(index, body.com) && plane.across(index, body.principal).is_some()
        });
        let wet = plane.shapes_stand_upright(model, branch.iter().copied());
        let shapes = model.geoms.iter().filter(|geom| branch.contains(&geom.body) && geom.fluid.is_some());
        let even = shapes.into_iter().all(|geom| even(geom.body, geom.pos));
        (hinges && bodies && wet && even).then_some((plane, level))
    }

    /// `plane_from_body` at the reference, by rows.
    pub(crate) fn axes(&self, body: usize) -> &Mat3<T> {
        &self.axes[body]
    }

    /// How far out of the plane a point fixed to `body` at `at`, in the body's axes, is.
    #[inline(always)]
    fn level(&self, body: usize, at: Vec3<T>) -> T {
        self.depth[body] + Vec3(self.axes[body].0[2]).dot(at)
    }

    fn holds(&self, model: &Model<T>) -> bool {
        let joints = model.joints.iter().all(|joint| {
            let [x, y, z] = self.axes[joint.body].apply(joint.axis).0;
            match joint.kind {
                JointKind::Hinge => tiny(x) && tiny(y),
                JointKind::Slide => tiny(z),
                JointKind::Ball | JointKind::Free => false,
            }
        });
        let shapes = self.shapes_stand_upright(model, 1..model.bodies.len());
        // vectors in the picture's plane, x and z, must lie in the plane of motion
        let [x, _, z] = [0, 1, 2].map(|k| self.axes[0].column(k)[2]);
        let pictured = !model.effects().iter().any(|effect| effect.cause().info().in_picture_plane)
            || tiny(x) && tiny(z);
        joints && shapes && pictured && tiny(self.axes[0].apply(model.settings.wind)[2])
    }

    /// Whether every shape by which these bodies feel the water has an axis across the plane.
    fn shapes_stand_upright(&self, model: &Model<T>, mut bodies: impl Iterator<Item = usize>) -> bool {
        bodies.all(|index| {
            let mut wet =
                model.geoms.iter().filter(|geom| geom.body == index && geom.fluid.is_some()).peekable();
            if wet.peek().is_some() {
                return wet.all(|geom| self.across(index, geom.quat).is_some());
            }
            let body = &model.bodies[index];
            !T::ZERO.less(body.mass).any() || self.across(index, body.principal).is_some()
        })
    }

    /// Which own axis of a shape on `body` points across the plane.
    fn across(&self, body: usize, quat: Quat<T>) -> Option<usize> {
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
    type Slope = Never;
    type Limbs = Never;

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

impl<T: Scalar> SlopeStage<Planar<T>> for Never {
    fn new(_: &Plant<Planar<T>>) -> Option<Self> {
        None
    }

    fn add(&mut self, _: &Plant<Planar<T>>, _: &Work<Planar<T>>, _: T, _: &mut [T]) {
        match *self {}
    }
}

impl<T: Scalar> LimbStage<Planar<T>> for Never {
    fn new(_: &Model<T>, _: &Plant<Planar<T>>) -> Option<Self> {
        None
    }

    fn factors(&self) -> usize {
        match *self {}
    }

    fn accelerate(
        &mut self,
        _: &Plant<Planar<T>>,
        _: &[T],
        _: &[T],
        _: &mut Work<Planar<T>>,
        _: Option<&[T]>,
        _: &mut [T],
        _: &mut [T],
    ) {
        match *self {}
    }

    fn solve(&mut self, _: &[T], _: &mut [T]) {
        match *self {}
    }
}
