//! Stage 4: springs, dampers, gravity compensation.

use super::Work;
use super::plant::Plant;
use crate::scalar::Scalar;
use crate::space::{Space, Wrench};

/// Adds the joints' springs to `force`.
#[inline(always)]
pub(crate) fn springs<S: Space>(plant: &Plant<S>, qpos: &[S::T], force: &mut [S::T]) {
    for joint in plant.joints.iter().filter(|joint| joint.springy) {
        joint.spring(qpos, force);
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

/// Adds the slopes of dampers, a + 2 b |v| + 3 c v^2, and of the springs of hinges and slides,
/// a + 2 b x + 3 c x^2, to `damping` and `stiffness`, shape (nv) each.
#[inline(always)]
pub(crate) fn slopes<S: Space>(
    plant: &Plant<S>,
    qpos: &[S::T],
    qvel: &[S::T],
    damping: &mut [S::T],
    stiffness: &mut [S::T],
) {
    let (two, three) = (S::T::from_f64(2.0), S::T::from_f64(3.0));
    for joint in &plant.joints {
        if joint.damped {
            let [a, b, c] = joint.damping;
            for dof in joint.dof..joint.dof + joint.nv {
                let v = qvel[dof];
                damping[dof] += a + two * b * v.abs() + three * c * v * v;
            }
        }
        if joint.springy && joint.nv == 1 {
            let [a, b, c] = joint.stiffness;
            let x = qpos[joint.q] - joint.spring_reference;
            stiffness[joint.dof] += a + x * (two * b + three * c * x);
        }
    }
}

/// Adds to `work.wrench` the share of each body's weight that is held up at its centre of mass.
#[inline(always)]
pub(crate) fn gravity_compensation<S: Space>(plant: &Plant<S>, work: &mut Work<S>) {
    for index in 1..plant.links.len() {
        hold_up(plant, index, work);
    }
}

/// The same for the body `index` alone.
#[inline(always)]
pub(crate) fn hold_up<S: Space>(plant: &Plant<S>, index: usize, work: &mut Work<S>) {
    if let Some(mass) = plant.links[index].held_mass {
        let force = plant.gravity * -mass;
        work.wrench[index] += Wrench { torque: S::moment(work.com[index], force), force };
    }
}
