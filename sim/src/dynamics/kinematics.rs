//! Stage 1: where everything is, and along which axes it can move.

use super::Work;
use super::plant::Plant;
use crate::space::Space;

/// Fills `work.pos`, `work.rot` (world pose of each body) and `work.axes` (motion of the world-aligned
/// spatial frame at the tree's root per unit rate of each dof) from `qpos`.
#[inline(always)]
pub(crate) fn kinematics<S: Space>(plant: &Plant<S>, qpos: &[S::T], work: &mut Work<S>) {
    for index in 1..plant.links.len() {
        place(plant, index, qpos, work);
    }
}

/// The same for the body `index` alone, whose parent is in place.
#[inline(always)]
pub(crate) fn place<S: Space>(plant: &Plant<S>, index: usize, qpos: &[S::T], work: &mut Work<S>) {
    let link = &plant.links[index];
    let parent_rot = work.rot[link.parent];
    let mut pos = work.pos[link.parent] + S::apply(&parent_rot, link.pos);
    let mut rot = match &link.rot {
        Some(rot) => S::product(&parent_rot, rot),
        None => parent_rot,
    };
    for joint in &plant.joints[link.joints.clone()] {
        joint.place(qpos, &mut pos, &mut rot, &mut work.axes[joint.dof..joint.dof + joint.nv]);
    }
    work.pos[index] = pos;
    work.rot[index] = rot;
    let origin = work.pos[link.root];
    for joint in &plant.joints[link.joints.clone()] {
        joint.finish_axes(&mut work.axes[joint.dof..joint.dof + joint.nv], (pos, &rot), origin);
    }
}
