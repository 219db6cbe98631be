//! Stage 4: springs, dampers, gravity compensation.

use super::Work;
use super::plant::{JointPlanKind, Plant};
use crate::math::Quat;
use crate::scalar::Scalar;
use crate::space::{Space, Wrench};

/// Adds the joints' springs, -(a x + b x^2 + c x^3), to `force`.
#[inline(always)]
pub(crate) fn springs<S: Space>(plant: &Plant<S>, qpos: &[S::T], force: &mut [S::T]) {
    for joint in plant.joints.iter().filter(|joint| joint.springy) {
        let [a, b, c] = joint.stiffness;
        let mut turn = |q: usize, dof: usize, slack: Quat<S::T>| {
            let now = Quat([qpos[q], qpos[q + 1], qpos[q + 2], qpos[q + 3]]).normalized();
            let bend = slack.conjugate().product(now).rotation_vector();
            for k in 0..3 {
                force[dof + k] -= a * bend[k];
            }
        };
        match joint.kind {
            JointPlanKind::Hinge { .. } | JointPlanKind::Slide { .. } => {
                let x = qpos[joint.q] - joint.spring_reference;
                force[joint.dof] -= x * (a + x * (b + x * c));
            }
            JointPlanKind::Ball(_) => turn(joint.q, joint.dof, Quat::IDENTITY),
            JointPlanKind::Free(_) => {
                let link = &plant.links[plant.dof_body[joint.dof]];
                turn(joint.q + 3, joint.dof + 3, link.quat);
                for k in 0..3 {
                    force[joint.dof + k] -= a * (qpos[joint.q + k] - link.reference[k]);
                }
            }
        }
    }
}

/// Adds the joints' dampers, -(a v + b v|v| + c v^3), to `force`.
#[inline(always)]
pub(crate) fn dampers<S: Space>(plant: &Plant<S>, qvel: &[S::T], force: &mut [S::T]) {
    for joint in plant.joints.iter().filter(|joint| joint.damped) {
        let [a, b, c] = joint.damping;
        for dof in joint.dof..joint.dof + joint.nv {
            let v = qvel[dof];
            force[dof] -= v * (a + b * v.abs() + c * v * v);
        }
    }
}

/// Adds `scale` times the dampers' slope, a + 2 b |v| + 3 c v^2, to the diagonal of `matrix`.
#[inline(always)]
pub(crate) fn add_damping<S: Space>(plant: &Plant<S>, qvel: &[S::T], scale: S::T, matrix: &mut [S::T]) {
    for joint in plant.joints.iter().filter(|joint| joint.damped) {
        let [a, b, c] = joint.damping;
        for dof in joint.dof..joint.dof + joint.nv {
            let v = qvel[dof];
            let slope = a + S::T::from_f64(2.0) * b * v.abs() + S::T::from_f64(3.0) * c * v * v;
            matrix[plant.row[dof]] += scale * slope;
        }
    }
}

/// Adds to `work.wrench` the share of each body's weight that is held up at its centre of mass.
#[inline(always)]
pub(crate) fn gravity_compensation<S: Space>(plant: &Plant<S>, work: &mut Work<S>) {
    for (index, link) in plant.links.iter().enumerate() {
        if let Some(mass) = link.held_mass {
            let force = plant.gravity * -mass;
            work.wrench[index] += Wrench { torque: S::moment(work.com[index], force), force };
        }
    }
}
