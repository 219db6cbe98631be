//! Stage 5: the water's forces on the bodies.

use super::Work;
use super::plant::Plant;
use crate::math::{Mat3, Motion, Vec3, Wrench};
use crate::scalar::Scalar;

/// Velocity of the point `at` (from the root), relative to the water, and the angular velocity, both in the
/// axes `rot`.
#[inline(always)]
fn relative<T: Scalar>(motion: Motion<T>, wind: Vec3<T>, at: Vec3<T>, rot: &Mat3<T>) -> (Vec3<T>, Vec3<T>) {
    let v = motion.lin + motion.ang.cross(at) - wind;
    (rot.apply_transposed(motion.ang), rot.apply_transposed(v))
}

/// A torque and a force at `at`, in the axes `rot`, as a wrench about the root.
#[inline(always)]
fn about_root<T: Scalar>((torque, force): (Vec3<T>, Vec3<T>), at: Vec3<T>, rot: &Mat3<T>) -> Wrench<T> {
    let force = rot.apply(force);
    Wrench { torque: rot.apply(torque) + at.cross(force), force }
}

/// Adds the fluid's forces to `work.wrench`.
pub(crate) fn fluid<T: Scalar>(plant: &Plant<T>, work: &mut Work<T>) {
    let (density, viscosity) = (plant.density, plant.viscosity);
    for geom in &plant.fluid_geoms {
        let body = geom.body;
        let (body_rot, root) = (&work.rot[body], plant.links[body].root);
        let at = work.pos[body] + body_rot.apply(geom.pos) - work.pos[root];
        let turned;
        let rot = match &geom.rot {
            Some(rot) => {
                turned = body_rot.product(rot);
                &turned
            }
            None => body_rot,
        };
        let (w, v) = relative(work.velocity[body], plant.wind, at, rot);
        work.wrench[body] += about_root(geom.shape.wrench(density, viscosity, w, v), at, rot);
    }
    for boxed in &plant.fluid_bodies {
        let rot = work.rot[boxed.body].product(&boxed.principal);
        let at = work.com[boxed.body];
        let (w, v) = relative(work.velocity[boxed.body], plant.wind, at, &rot);
        work.wrench[boxed.body] += about_root(boxed.shape.wrench(density, viscosity, w, v), at, &rot);
    }
}
