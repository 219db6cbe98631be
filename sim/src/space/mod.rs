//! Where a mechanism moves: in space, or, when all its hinges are parallel, in one plane.
//!
//! Algebra only: no mechanism is known here. The dynamics are written once over a [`Space`]. In a plane a velocity has two components and a turn one, so the
//! same laws cost a fraction.

mod planar;
mod spatial;

use std::fmt::Debug;
use std::ops::{Add, AddAssign, SubAssign};

pub(crate) use planar::{Never, Planar, Plane, tiny};
pub(crate) use spatial::Spatial;

use crate::math::{Quat, Sym3, Vec3, Vector};
use crate::scalar::Scalar;

/// Vectors, turns and rotations of the space that a mechanism moves in.
pub(crate) trait Space: Copy + Debug + Send + Sync + Sized + 'static {
    /// Type of the numbers.
    type T: Scalar;
    /// Positions, velocities and forces.
    type Vec: Vector<Self::T>;
    /// Angular velocities and torques.
    type Spin: Vector<Self::T>;
    /// A rotation `parent_from_child`.
    type Rot: Copy + Debug + Send + Sync;
    /// Rotational inertia.
    type Sym: Copy + Debug + Send + Sync + Add<Output = Self::Sym>;
    /// How the model's own axes lie in this space.
    type Layout: Debug + Clone + Send + Sync;
    /// What a joint with a quaternion holds: where bodies cannot turn every way, nothing can be made of this type.
    type AnyTurn: Copy + Debug + Send + Sync;

    /// No rotation.
    const IDENTITY: Self::Rot;
    /// No rotational inertia.
    const NO_INERTIA: Self::Sym;

    /// `turn` x `arm`: the velocity of a point at `arm` from the axis.
    fn cross(turn: Self::Spin, arm: Self::Vec) -> Self::Vec;
    /// `arm` x `force`: the torque of a force at `arm`.
    fn moment(arm: Self::Vec, force: Self::Vec) -> Self::Spin;
    /// The vector product of two turns; 0 in a plane.
    fn twist(a: Self::Spin, b: Self::Spin) -> Self::Spin;
    /// Rotates a vector.
    fn apply(rot: &Self::Rot, v: Self::Vec) -> Self::Vec;
    /// Rotates a vector back.
    fn back(rot: &Self::Rot, v: Self::Vec) -> Self::Vec;
    /// Rotates an angular velocity or torque.
    fn apply_spin(rot: &Self::Rot, w: Self::Spin) -> Self::Spin;
    /// Rotates a turn back.
    fn back_spin(rot: &Self::Rot, w: Self::Spin) -> Self::Spin;
    /// First `b`, then `a`.
    fn product(a: &Self::Rot, b: &Self::Rot) -> Self::Rot;
    /// Rotation about the unit turn `axis` by the angle with this sine and cosine.
    fn about(axis: Self::Spin, sin_cos: (Self::T, Self::T)) -> Self::Rot;
    /// First a turn about the unit turn `axis` by the angle with this sine and cosine, then `rot`; `along` says which of the
    /// own axes `axis` lies on, if on one.
    #[inline(always)]
    fn swung(
        rot: &Self::Rot,
        axis: Self::Spin,
        _along: Option<usize>,
        sin_cos: (Self::T, Self::T),
    ) -> Self::Rot {
        Self::product(rot, &Self::about(axis, sin_cos))
    }
    /// Which of the own axes a turn lies on, if that makes it cheaper.
    fn along(_axis: Self::Spin) -> Option<usize> {
        None
    }
    /// Rotational inertia times angular velocity.
    fn momentum(inertia: &Self::Sym, w: Self::Spin) -> Self::Spin;
    /// Rotational inertia on rotated axes.
    fn rotated(inertia: &Self::Sym, rot: &Self::Rot) -> Self::Sym;
    /// Rotational inertia of a point mass at `at`, about the origin.
    fn of_point(mass: Self::T, at: Self::Vec) -> Self::Sym;

    /// The rotation of a unit quaternion.
    fn any_turn(possible: Self::AnyTurn, quat: Quat<Self::T>) -> Self::Rot;
    /// A position given by three coordinates.
    fn anywhere(possible: Self::AnyTurn, at: [Self::T; 3]) -> Self::Vec;
    /// Travel along the world's axis `k`.
    fn travel(possible: Self::AnyTurn, k: usize) -> Self::Vec;
    /// A turn about the rotated axis `k`.
    fn turn_axis(possible: Self::AnyTurn, rot: &Self::Rot, k: usize) -> Self::Spin;

    /// Whether joints with quaternions may be here.
    fn any_turn_possible(layout: &Self::Layout) -> Option<Self::AnyTurn>;
    /// A vector in the axes of the model's body `body`.
    fn vector(layout: &Self::Layout, body: usize, v: Vec3<Self::T>) -> Self::Vec;
    /// A turn in the axes of the model's body `body`.
    fn spin(layout: &Self::Layout, body: usize, w: Vec3<Self::T>) -> Self::Spin;
    /// Rotational inertia in the axes of the model's body `body`.
    fn inertia(layout: &Self::Layout, body: usize, inertia: Sym3<Self::T>) -> Self::Sym;
    /// `parent_from_body` at the reference; `None` for the identity.
    fn link_rotation(layout: &Self::Layout, quat: Quat<Self::T>) -> Option<Self::Rot>;
    /// A shape's own axes on a body: its rotation (`None` for the identity), and how they are taken.
    fn shape_axes(layout: &Self::Layout, body: usize, quat: Quat<Self::T>) -> (Option<Self::Rot>, ShapeAxes);
    /// The components of a vector on a shape's axes.
    fn shape_vector(axes: ShapeAxes, v: Vec3<Self::T>) -> Self::Vec;
    /// The components of a turn on a shape's axes.
    fn shape_spin(axes: ShapeAxes, w: Vec3<Self::T>) -> Self::Spin;
    /// A vector of constants, which come in the order of [`ShapeAxes`].
    fn constant(v: [f64; 3]) -> Self::Vec;
    /// A turn of constants, which come in the order of [`ShapeAxes`].
    fn constant_spin(w: [f64; 3]) -> Self::Spin;
    /// World position of the point `v`, fixed to the model's body `body` at `at` in its own axes.
    fn lift(layout: &Self::Layout, body: usize, at: Vec3<Self::T>, v: Self::Vec) -> [Self::T; 3];
}

/// Which of a shape's own axes stand for this space's first, second and, for turns in a plane, third.
pub(crate) type ShapeAxes = [usize; 3];

/// A motion: angular velocity and the velocity of the point at the origin, in world axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion<S: Space> {
    /// Angular part \[rad/s\].
    pub(crate) ang: S::Spin,
    /// Linear part \[m/s\].
    pub(crate) lin: S::Vec,
}

impl<S: Space> Motion<S> {
    /// Zero motion.
    pub(crate) const ZERO: Self = Self { ang: S::Spin::ZERO, lin: S::Vec::ZERO };

    /// The sum with `other` times `k`.
    #[inline(always)]
    pub(crate) fn plus(self, other: Self, k: S::T) -> Self {
        Self { ang: self.ang + other.ang * k, lin: self.lin + other.lin * k }
    }

    /// Sum of both motions.
    #[inline(always)]
    pub(crate) fn and(self, other: Self) -> Self {
        Self { ang: self.ang + other.ang, lin: self.lin + other.lin }
    }

    /// How `other`, riding on `self`, changes: the spatial cross product of motions.
    #[inline(always)]
    pub(crate) fn cross(self, other: Self) -> Self {
        Self {
            ang: S::twist(self.ang, other.ang),
            lin: S::cross(self.ang, other.lin) - S::cross(other.ang, self.lin),
        }
    }

    /// How `force`, riding on `self`, changes: the spatial cross product of motion and force.
    #[inline(always)]
    pub(crate) fn cross_force(self, force: Wrench<S>) -> Wrench<S> {
        Wrench {
            torque: S::twist(self.ang, force.torque) + S::moment(self.lin, force.force),
            force: S::cross(self.ang, force.force),
        }
    }

    /// The power of `wrench` under this motion.
    #[inline(always)]
    pub(crate) fn power(self, wrench: Wrench<S>) -> S::T {
        self.ang.dot(wrench.torque) + self.lin.dot(wrench.force)
    }
}

/// A torque about the origin and a force, in world axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wrench<S: Space> {
    /// Torque \[N m\].
    pub(crate) torque: S::Spin,
    /// Force \[N\].
    pub(crate) force: S::Vec,
}

impl<S: Space> Wrench<S> {
    /// Zero wrench.
    pub(crate) const ZERO: Self = Self { torque: S::Spin::ZERO, force: S::Vec::ZERO };
}

impl<S: Space> AddAssign for Wrench<S> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        self.torque += other.torque;
        self.force += other.force;
    }
}

impl<S: Space> SubAssign for Wrench<S> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        self.torque -= other.torque;
        self.force -= other.force;
    }
}

/// Inertia of a rigid body about the origin, in world axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Inertia<S: Space> {
    /// Mass \[kg\].
    pub(crate) mass: S::T,
    /// Mass times centre of mass \[kg m\].
    pub(crate) moment: S::Vec,
    /// Rotational inertia about the origin \[kg m2\].
    pub(crate) rotational: S::Sym,
}

impl<S: Space> Inertia<S> {
    /// Inertia of an empty body: all 0.
    pub(crate) const ZERO: Self = Self { mass: S::T::ZERO, moment: S::Vec::ZERO, rotational: S::NO_INERTIA };

    /// Momentum under `motion`.
    #[inline(always)]
    pub(crate) fn apply(&self, motion: Motion<S>) -> Wrench<S> {
        Wrench {
            torque: S::momentum(&self.rotational, motion.ang) + S::moment(self.moment, motion.lin),
            force: motion.lin * self.mass + S::cross(motion.ang, self.moment),
        }
    }
}

impl<S: Space> AddAssign for Inertia<S> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        self.mass += other.mass;
        self.moment += other.moment;
        self.rotational = self.rotational + other.rotational;
    }
}
