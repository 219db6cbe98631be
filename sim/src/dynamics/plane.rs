//! Whether a mechanism, or a branch of it, moves in one plane.

use crate::math::{Mat3, Vec3};
use crate::model::{JointKind, Model};
use crate::scalar::{Mask, Scalar};
use crate::space::{Plane, tiny};

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
        if model.joints.iter().any(|joint| !joint.kind.is_axle()) {
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
        let pictured = !model.causes().iter().any(|carried| carried.cause().info().in_picture_plane)
            || self.is_pictured();
        joints && shapes && pictured && tiny(self.axes[0].apply(model.settings.wind)[2])
    }

    /// Whether vectors in the picture's plane, x and z, lie in the plane of motion.
    pub(crate) fn is_pictured(&self) -> bool {
        let [x, _, z] = [0, 1, 2].map(|k| self.axes[0].column(k)[2]);
        tiny(x) && tiny(z)
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
}
