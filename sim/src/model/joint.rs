//! Joints: all that is particular to a kind of joint but for how a step treats it (`dynamics/joint.rs`) and what MJCF lets
//! stand beside it.

use super::{Body, Softness};
use crate::math::{Quat, Vec3};
use crate::scalar::Scalar;

/// The kinds of joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Turns about an axis: one angle \[rad\].
    Hinge,
    /// Slides along an axis: one travel \[m\].
    Slide,
    /// Turns about a point: a unit quaternion, three rates.
    Ball,
    /// Floats: position and unit quaternion, six rates.
    Free,
}

/// Coordinates of a joint that belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coordinates {
    /// An angle or a travel, and its rate.
    Axis,
    /// A position, world axes, and its velocity.
    Position,
    /// A unit quaternion `w x y z`, and the angular velocity in the body's axes.
    Rotation,
}

impl Coordinates {
    /// Number of coordinates.
    pub fn nq(self) -> usize {
        match self {
            Self::Axis => 1,
            Self::Position => 3,
            Self::Rotation => 4,
        }
    }

    /// Number of velocities.
    pub fn nv(self) -> usize {
        match self {
            Self::Axis => 1,
            Self::Position | Self::Rotation => 3,
        }
    }
}

impl JointKind {
    /// All of them, by their names in MJCF.
    pub(crate) const NAMED: [(&'static str, Self); 4] =
        [("hinge", Self::Hinge), ("slide", Self::Slide), ("ball", Self::Ball), ("free", Self::Free)];

    /// What its coordinates are, in order.
    pub fn coordinates(self) -> &'static [Coordinates] {
        match self {
            Self::Hinge | Self::Slide => &[Coordinates::Axis],
            Self::Ball => &[Coordinates::Rotation],
            Self::Free => &[Coordinates::Position, Coordinates::Rotation],
        }
    }

    /// Its name in MJCF.
    pub(crate) fn mjcf_name(self) -> &'static str {
        Self::NAMED.into_iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }

    /// Whether it has one axis, along or about which it moves. Others have neither end stops nor springs and dampers of more
    /// than one term.
    pub fn is_axle(self) -> bool {
        matches!(self, Self::Hinge | Self::Slide)
    }

    /// Number of coordinates.
    pub fn nq(self) -> usize {
        self.coordinates().iter().map(|coordinates| coordinates.nq()).sum()
    }

    /// Number of velocities.
    pub fn nv(self) -> usize {
        self.coordinates().iter().map(|coordinates| coordinates.nv()).sum()
    }
}

/// A joint between a body and its parent.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint<T> {
    /// Its name, or `joint#` and its place in the file.
    pub name: String,
    /// Whether the file names it.
    pub named: bool,
    /// Kind.
    pub kind: JointKind,
    /// The body it moves.
    pub body: usize,
    /// First coordinate in `qpos`.
    pub qpos_address: usize,
    /// First velocity in `qvel`.
    pub dof_address: usize,
    /// Anchor in the body's frame \[m\].
    pub pos: Vec3<T>,
    /// Axis in the body's frame, unit length.
    pub axis: Vec3<T>,
    /// Coordinate of a hinge or slide at which the body stands as the file places it.
    pub reference: T,
    /// Coordinate of a hinge or slide at which its spring is slack.
    pub spring_reference: T,
    /// Spring -(a x + b x^2 + c x^3), x from `spring_reference`: a, b, c \[N m/rad, ...\].
    pub stiffness: [T; 3],
    /// Damper -(a v + b v|v| + c v^3): a, b, c \[N m s/rad, ...\].
    pub damping: [T; 3],
    /// Added to the inertia on this joint's axes \[kg m2\] or \[kg\].
    pub armature: T,
    /// Friction loss \[N m\] or \[N\], on each axis.
    pub friction_loss: T,
    /// End stops of a hinge \[rad\] or slide \[m\].
    pub limit: Option<[T; 2]>,
    /// So far before its end stops they begin to push \[rad\] or \[m\].
    pub limit_margin: f64,
    /// How soft its end stops are.
    pub limit_softness: Softness,
    /// How soft its friction loss is.
    pub friction_softness: Softness,
}

impl<T: Scalar> Joint<T> {
    /// Its coordinates where they belong together, each with the places of the first in `qpos` and `qvel`.
    pub fn coordinates(&self) -> impl Iterator<Item = (Coordinates, usize, usize)> + use<T> {
        let (mut q, mut dof) = (self.qpos_address, self.dof_address);
        self.kind.coordinates().iter().map(move |&coordinates| {
            let here = (coordinates, q, dof);
            (q, dof) = (q + coordinates.nq(), dof + coordinates.nv());
            here
        })
    }

    /// Position and rotation at which it holds `body` as the file places it, and where its springs are slack: a free joint
    /// counts from the world.
    pub(crate) fn rest(&self, body: &Body<T>) -> (Vec3<T>, Quat<T>) {
        match self.kind {
            JointKind::Free => (body.pos, body.quat),
            JointKind::Hinge | JointKind::Slide | JointKind::Ball => (Vec3::ZERO, Quat::IDENTITY),
        }
    }

    pub(crate) fn map<U>(&self, f: impl Fn(T) -> U + Copy) -> Joint<U> {
        Joint {
            name: self.name.clone(),
            named: self.named,
            kind: self.kind,
            body: self.body,
            qpos_address: self.qpos_address,
            dof_address: self.dof_address,
            pos: self.pos.map(f),
            axis: self.axis.map(f),
            reference: f(self.reference),
            spring_reference: f(self.spring_reference),
            stiffness: self.stiffness.map(f),
            damping: self.damping.map(f),
            armature: f(self.armature),
            friction_loss: f(self.friction_loss),
            limit: self.limit.map(|range| range.map(f)),
            limit_margin: self.limit_margin,
            limit_softness: self.limit_softness,
            friction_softness: self.friction_softness,
        }
    }
}
