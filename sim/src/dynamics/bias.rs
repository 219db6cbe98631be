//! Stage 3: velocities, and the forces that gravity and rotation alone call for (recursive Newton-Euler).

use super::Work;
use super::plant::Plant;
use crate::math::Vector;
use crate::space::{Motion, Space, Wrench};

/// Fills `work.velocity` (of each body) and `work.drift` (each body's acceleration with all joint
/// accelerations 0, less gravity).
#[inline(always)]
pub(crate) fn velocities<S: Space>(plant: &Plant<S>, qvel: &[S::T], work: &mut Work<S>) {
    ground(plant, work);
    for index in 1..plant.links.len() {
        velocity(plant, index, qvel, work);
    }
}

/// The world's own velocity and drift: those of the base, where it moves.
#[inline(always)]
pub(crate) fn ground<S: Space>(plant: &Plant<S>, work: &mut Work<S>) {
    let weight = Motion { ang: S::Spin::ZERO, lin: -plant.gravity };
    work.drift[0] = weight;
    if let Some([velocity, acceleration]) = work.base {
        work.velocity[0] = velocity;
        work.drift[0] = acceleration.and(weight);
    }
}

/// Velocity and drift of the body `index` alone, whose parent's are known.
#[inline(always)]
pub(crate) fn velocity<S: Space>(plant: &Plant<S>, index: usize, qvel: &[S::T], work: &mut Work<S>) {
    let link = &plant.links[index];
    let mut velocity = work.velocity[link.parent];
    let mut drift = work.drift[link.parent];
    if link.parent == 0 && work.base.is_some() {
        let from = work.pos[index] - work.pos[0];
        velocity.lin += S::cross(velocity.ang, from);
        drift.lin += S::cross(drift.ang, from);
    }
    for joint in &plant.joints[link.joints.clone()] {
        let staying = joint.staying();
        let axes = &work.axes[joint.dof..joint.dof + joint.nv];
        let rates = &qvel[joint.dof..joint.dof + joint.nv];
        for (axis, &rate) in axes[..staying].iter().zip(&rates[..staying]) {
            velocity = velocity.plus(*axis, rate);
        }
        let mut own = Motion::ZERO;
        for (axis, &rate) in axes[staying..].iter().zip(&rates[staying..]) {
            own = own.plus(*axis, rate);
        }
        drift = drift.and(velocity.cross(own));
        velocity = velocity.and(own);
    }
    work.velocity[index] = velocity;
    work.drift[index] = drift;
}

/// Adds to `work.wrench` the force each body needs for its drift, reversed.
#[inline(always)]
pub(crate) fn bias<S: Space>(plant: &Plant<S>, work: &mut Work<S>) {
    for index in 1..plant.links.len() {
        resist(index, work);
    }
}

/// The same for the body `index` alone.
#[inline(always)]
pub(crate) fn resist<S: Space>(index: usize, work: &mut Work<S>) {
    let inertia = &work.inertia[index];
    let velocity = work.velocity[index];
    work.wrench[index] -= inertia.apply(work.drift[index]);
    work.wrench[index] -= velocity.cross_force(inertia.apply(velocity));
}

/// Adds to `force` what the wrenches on the bodies do to the dofs; `work.wrench` is used up.
#[inline(always)]
pub(crate) fn project<S: Space>(plant: &Plant<S>, work: &mut Work<S>, force: &mut [S::T]) {
    for index in (1..plant.links.len()).rev() {
        let link = &plant.links[index];
        let wrench = work.wrench[index];
        for dof in link.dofs.clone() {
            force[dof] += work.axes[dof].power(wrench);
        }
        if link.parent != 0 {
            work.wrench[link.parent] += wrench;
        }
        work.wrench[index] = Wrench::ZERO;
    }
}
