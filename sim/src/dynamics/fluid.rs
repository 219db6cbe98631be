//! Stage 5: the water's forces on the bodies.

use super::Work;
use super::plant::{FluidBody, FluidGeom, Plant};
use crate::space::{Motion, Space, Wrench};

/// Velocity of the point `at` (from the root), relative to the water, and the angular velocity, both in the
/// axes `rot`.
#[inline(always)]
pub(crate) fn relative<S: Space>(
    motion: Motion<S>,
    wind: S::Vec,
    at: S::Vec,
    rot: &S::Rot,
) -> (S::Spin, S::Vec) {
    let v = motion.lin + S::cross(motion.ang, at) - wind;
    (S::back_spin(rot, motion.ang), S::back(rot, v))
}

/// A torque and a force at `at`, in the axes `rot`, as a wrench about the root.
#[inline(always)]
pub(crate) fn about_root<S: Space>(
    (torque, force): (S::Spin, S::Vec),
    at: S::Vec,
    rot: &S::Rot,
) -> Wrench<S> {
    let force = S::apply(rot, force);
    Wrench { torque: S::apply_spin(rot, torque) + S::moment(at, force), force }
}

/// `world_from_shape` of a shape that is turned by `own` on a body at `rot`.
#[inline(always)]
fn with_own<S: Space>(rot: S::Rot, own: &Option<S::Rot>) -> S::Rot {
    match own {
        Some(own) => S::product(&rot, own),
        None => rot,
    }
}

impl<S: Space> FluidGeom<S> {
    /// Centre from the root, and `world_from_geom`.
    #[inline(always)]
    pub(crate) fn place(&self, plant: &Plant<S>, work: &Work<S>) -> (S::Vec, S::Rot) {
        let rot = work.rot[self.body];
        let at = work.pos[self.body] + S::apply(&rot, self.pos) - work.pos[plant.links[self.body].root];
        (at, with_own::<S>(rot, &self.rot))
    }
}

impl<S: Space> FluidBody<S> {
    /// Centre of mass from the root, and `world_from_principal`.
    #[inline(always)]
    pub(crate) fn place(&self, work: &Work<S>) -> (S::Vec, S::Rot) {
        let rot = work.rot[self.body];
        (work.com[self.body], with_own::<S>(rot, &self.rot))
    }
}

/// Adds the fluid's forces to `work.wrench`.
#[inline(always)]
pub(crate) fn fluid<S: Space>(plant: &Plant<S>, work: &mut Work<S>) {
    for geom in &plant.fluid_geoms {
        on_geom(plant, geom, work);
    }
    for body in &plant.fluid_bodies {
        on_body(plant, body, work);
    }
}

/// The same for one shape alone.
#[inline(always)]
pub(crate) fn on_geom<S: Space>(plant: &Plant<S>, geom: &FluidGeom<S>, work: &mut Work<S>) {
    let (at, rot) = geom.place(plant, work);
    let (w, v) = relative::<S>(work.velocity[geom.body], work.water, at, &rot);
    let push = geom.shape.wrench(plant.density, plant.viscosity, w, v);
    work.wrench[geom.body] += about_root::<S>(push, at, &rot);
}

/// The same for one body without shapes alone.
#[inline(always)]
pub(crate) fn on_body<S: Space>(plant: &Plant<S>, body: &FluidBody<S>, work: &mut Work<S>) {
    let (at, rot) = body.place(work);
    let (w, v) = relative::<S>(work.velocity[body.body], work.water, at, &rot);
    let push = body.shape.wrench(plant.density, plant.viscosity, w, v);
    work.wrench[body.body] += about_root::<S>(push, at, &rot);
}
