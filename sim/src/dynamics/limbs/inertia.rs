//! Inertia in space of a body with all that it carries, articulated.

use crate::math::{Mat3, Sym3, Vec3};
use crate::scalar::Scalar;
use crate::space::{Motion, Spatial, Wrench};

/// Symmetric, from motions in space to wrenches: torque = rotational w + coupling v, force = coupling^T w + linear v.
#[derive(Debug, Clone, Copy)]
pub(super) struct Articulated<T> {
    pub(super) rotational: Sym3<T>,
    pub(super) coupling: Mat3<T>,
    pub(super) linear: Sym3<T>,
}

impl<T: Scalar> Articulated<T> {
    /// Of a rigid body about its origin: `inertia` about the centre of mass at `com`.
    pub(super) fn of_body(mass: T, com: Vec3<T>, inertia: Sym3<T>) -> Self {
        let [x, y, z] = (com * mass).0;
        let zero = T::ZERO;
        Self {
            rotational: inertia + Sym3::of_point(mass, com),
            coupling: Mat3([[zero, -z, y], [z, zero, -x], [-y, x, zero]]),
            linear: Sym3([mass, mass, mass, zero, zero, zero]),
        }
    }

    #[inline(always)]
    pub(super) fn apply(&self, motion: Motion<Spatial<T>>) -> Wrench<Spatial<T>> {
        Wrench {
            torque: self.rotational.apply(motion.ang) + self.coupling.apply(motion.lin),
            force: self.coupling.apply_transposed(motion.ang) + self.linear.apply(motion.lin),
        }
    }
}
