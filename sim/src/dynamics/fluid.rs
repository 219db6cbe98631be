//! Stage 5: the water's forces on the bodies.

use super::Work;
use super::plant::{FluidBody, FluidGeom, Plant};
use crate::math::{Mat3, Motion, Vec3, Wrench};
use crate::scalar::Scalar;

/// Velocity of the point `at` (from the root), relative to the water, and the angular velocity, both in the
/// axes `rot`.
#[inline(always)]
pub(crate) fn relative<T: Scalar>(
    motion: Motion<T>,
    wind: Vec3<T>,
    at: Vec3<T>,
    rot: &Mat3<T>,
) -> (Vec3<T>, Vec3<T>) {
    let v = motion.lin + motion.ang.cross(at) - wind;
    (rot.apply_transposed(motion.ang), rot.apply_transposed(v))
}

/// A torque and a force at `at`, in the axes `rot`, as a wrench about the root.
#[inline(always)]
fn about_root<T: Scalar>((torque, force): (Vec3<T>, Vec3<T>), at: Vec3<T>, rot: &Mat3<T>) -> Wrench<T> {
    let force = rot.apply(force);
    Wrench { torque: rot.apply(torque) + at.cross(force), force }
}

impl<T: Scalar> FluidGeom<T> {
    /// Centre from the root, and `world_from_geom`.
    #[inline(always)]
    pub(crate) fn place(&self, plant: &Plant<T>, work: &Work<T>) -> (Vec3<T>, Mat3<T>) {
        let rot = work.rot[self.body];
        let at = work.pos[self.body] + rot.apply(self.pos) - work.pos[plant.links[self.body].root];
        (at, self.rot.as_ref().map_or(rot, |own| rot.product(own)))
    }
}

impl<T: Scalar> FluidBody<T> {
    /// Centre of mass from the root, and `world_from_principal`.
    pub(crate) fn place(&self, work: &Work<T>) -> (Vec3<T>, Mat3<T>) {
        (work.com[self.body], work.rot[self.body].product(&self.principal))
    }
}

/// Adds the fluid's forces to `work.wrench`.
pub(crate) fn fluid<T: Scalar>(plant: &Plant<T>, work: &mut Work<T>) {
    let (density, viscosity) = (plant.density, plant.viscosity);
    for geom in &plant.fluid_geoms {
        let (at, rot) = geom.place(plant, work);
        let (w, v) = relative(work.velocity[geom.body], plant.wind, at, &rot);
        work.wrench[geom.body] += about_root(geom.shape.wrench(density, viscosity, w, v), at, &rot);
    }
    for body in &plant.fluid_bodies {
        let (at, rot) = body.place(work);
        let (w, v) = relative(work.velocity[body.body], plant.wind, at, &rot);
        work.wrench[body.body] += about_root(body.shape.wrench(density, viscosity, w, v), at, &rot);
    }
}
