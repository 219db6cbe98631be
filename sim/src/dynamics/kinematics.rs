//! Stage 1: where everything is, and along which axes it can move.

use super::Work;
use super::plant::{JointPlanKind, Plant};
use crate::math::{Quat, Vector};
use crate::scalar::Scalar;
use crate::space::{Motion, Space};

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
        let turned = match joint.kind {
            JointPlanKind::Hinge { axis, along } => {
                let angle = qpos[joint.q] - joint.reference;
                work.axes[joint.dof].ang = S::apply_spin(&rot, axis);
                Some(S::swung(&rot, axis, along, angle.sin_cos()))
            }
            JointPlanKind::Slide { axis } => {
                let axis = S::apply(&rot, axis);
                work.axes[joint.dof] = Motion { ang: S::Spin::ZERO, lin: axis };
                pos += axis * (qpos[joint.q] - joint.reference);
                None
            }
            JointPlanKind::Ball(possible) => {
                Some(S::product(&rot, &S::any_turn(possible, quat_at(qpos, joint.q))))
            }
            JointPlanKind::Free(possible) => {
                pos = S::anywhere(possible, [qpos[joint.q], qpos[joint.q + 1], qpos[joint.q + 2]]);
                rot = S::any_turn(possible, quat_at(qpos, joint.q + 3));
                None
            }
        };
        if let Some(turned) = turned {
            // the anchor stays where it is; the axis's velocity field is left relative to it for now
            let anchor = match joint.pos {
                Some(at) => {
                    let anchor = pos + S::apply(&rot, at);
                    pos = anchor - S::apply(&turned, at);
                    anchor
                }
                None => pos,
            };
            rot = turned;
            for dof in joint.dof..joint.dof + joint.nv {
                work.axes[dof].lin = anchor;
            }
        }
    }
    work.pos[index] = pos;
    work.rot[index] = rot;
    let origin = work.pos[link.root];
    for joint in &plant.joints[link.joints.clone()] {
        let axes = &mut work.axes[joint.dof..joint.dof + joint.nv];
        match joint.kind {
            JointPlanKind::Slide { .. } => {}
            JointPlanKind::Hinge { .. } => axes[0].lin = S::cross(axes[0].ang, origin - axes[0].lin),
            JointPlanKind::Ball(possible) => turn_axes::<S>(possible, axes, &rot, origin),
            JointPlanKind::Free(possible) => {
                let (travel, turn) = axes.split_at_mut(3);
                for (k, axis) in travel.iter_mut().enumerate() {
                    *axis = Motion { ang: S::Spin::ZERO, lin: S::travel(possible, k) };
                }
                for axis in turn.iter_mut() {
                    axis.lin = pos;
                }
                turn_axes::<S>(possible, turn, &rot, origin);
            }
        }
    }
}

/// The three axes of a body turning about a point (left in `lin`), as motions at `origin`.
#[inline(always)]
fn turn_axes<S: Space>(possible: S::AnyTurn, axes: &mut [Motion<S>], rot: &S::Rot, origin: S::Vec) {
    for (k, axis) in axes.iter_mut().enumerate() {
        axis.ang = S::turn_axis(possible, rot, k);
        axis.lin = S::cross(axis.ang, origin - axis.lin);
    }
}

#[inline(always)]
fn quat_at<T: Scalar>(qpos: &[T], at: usize) -> Quat<T> {
    Quat([qpos[at], qpos[at + 1], qpos[at + 2], qpos[at + 3]]).normalized()
}
