//! Shapes in the water, as the causes there take them.

use crate::dynamics::Work;
use crate::dynamics::fluid::relative;
use crate::dynamics::plant::{FluidGeom, Plant};
use crate::space::{Space, Wrench};

/// A shape in the water at one instant.
pub(crate) struct Wet<S: Space> {
    /// Its centre from the root \[m\].
    pub(crate) at: S::Vec,
    /// `world_from_geom`.
    pub(crate) rot: S::Rot,
    /// Angular velocity and velocity against the water, in the shape's axes.
    pub(crate) moving: (S::Spin, S::Vec),
}

/// Where `geom` is and how it moves.
#[inline(always)]
pub(crate) fn wet<S: Space>(geom: &FluidGeom<S>, plant: &Plant<S>, work: &Work<S>) -> Wet<S> {
    let (at, rot) = geom.place(plant, work);
    Wet { at, rot, moving: relative::<S>(work.velocity[geom.body], work.water, at, &rot) }
}

/// The velocity of `geom`'s centre against the water, world axes, and the centre from the root.
#[inline(always)]
pub(crate) fn drift<S: Space>(geom: &FluidGeom<S>, plant: &Plant<S>, work: &Work<S>) -> (S::Vec, S::Vec) {
    let at = work.pos[geom.body] + S::apply(&work.rot[geom.body], geom.pos)
        - work.pos[plant.links[geom.body].root];
    let motion = work.velocity[geom.body];
    (motion.lin + S::cross(motion.ang, at) - work.water, at)
}

/// A force at a point as a wrench about the root, world axes.
#[inline(always)]
pub(crate) fn force_at<S: Space>(force: S::Vec, at: S::Vec) -> Wrench<S> {
    Wrench { torque: S::moment(at, force), force }
}
