//! Stage 4: springs, dampers, gravity compensation.

use super::Work;
use super::plant::Plant;
use crate::math::{Quat, Vec3, Wrench};
use crate::model::JointKind;
use crate::scalar::Scalar;

/// Adds the joints' springs, -(a x + b x^2 + c x^3), to `force`.
pub(crate) fn springs<T: Scalar>(plant: &Plant<T>, qpos: &[T], force: &mut [T]) {
    for joint in plant.joints.iter().filter(|joint| joint.springy) {
        let [a, b, c] = joint.stiffness;
        let mut turn = |q: usize, dof: usize, slack: Quat<T>| {
            let now = Quat([qpos[q], qpos[q + 1], qpos[q + 2], qpos[q + 3]]).normalized();
            let bend = slack.conjugate().product(now).rotation_vector();
            for k in 0..3 {
                force[dof + k] -= a * bend[k];
            }
        };
        match joint.kind {
            JointKind::Hinge | JointKind::Slide => {
                let x = qpos[joint.q] - joint.spring_reference;
                force[joint.dof] -= x * (a + x * (b + x * c));
            }
            JointKind::Ball => turn(joint.q, joint.dof, Quat::IDENTITY),
            JointKind::Free => {
                let link = &plant.links[plant.dof_body[joint.dof]];
                turn(joint.q + 3, joint.dof + 3, link.quat);
                for k in 0..3 {
                    force[joint.dof + k] -= a * (qpos[joint.q + k] - link.pos[k]);
                }
            }
        }
    }
}

/// Adds the joints' dampers, -(a v + b v|v| + c v^3), to `force`.
pub(crate) fn dampers<T: Scalar>(plant: &Plant<T>, qvel: &[T], force: &mut [T]) {
    for joint in plant.joints.iter().filter(|joint| joint.damped) {
        let [a, b, c] = joint.damping;
        for dof in joint.dof..joint.dof + joint.kind.nv() {
            let v = qvel[dof];
            force[dof] -= v * (a + b * v.abs() + c * v * v);
        }
    }
}

/// Adds `scale` times the dampers' slope, a + 2 b |v| + 3 c v^2, to the diagonal of `matrix`.
pub(crate) fn add_damping<T: Scalar>(plant: &Plant<T>, qvel: &[T], scale: T, matrix: &mut [T]) {
    for joint in plant.joints.iter().filter(|joint| joint.damped) {
        let [a, b, c] = joint.damping;
        for dof in joint.dof..joint.dof + joint.kind.nv() {
            let v = qvel[dof];
            let slope = a + T::from_f64(2.0) * b * v.abs() + T::from_f64(3.0) * c * v * v;
            matrix[plant.row[dof]] += scale * slope;
        }
    }
}

/// Adds to `work.wrench` the share of each body's weight that is held up at its centre of mass.
pub(crate) fn gravity_compensation<T: Scalar>(plant: &Plant<T>, work: &mut Work<T>) {
    for (index, link) in plant.links.iter().enumerate() {
        if let Some(mass) = link.held_mass {
            let force: Vec3<T> = plant.gravity * -mass;
            work.wrench[index] += Wrench { torque: work.com[index].cross(force), force };
        }
    }
}
