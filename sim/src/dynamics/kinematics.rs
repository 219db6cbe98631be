//! Stage 1: where everything is, and along which axes it can move.

use super::Work;
use super::plant::Plant;
use crate::math::{Mat3, Motion, Quat, Vec3};
use crate::model::JointKind;
use crate::scalar::Scalar;

/// Fills `work.pos`, `work.rot` (world pose of each body) and `work.axes` (motion of the world-aligned
/// spatial frame at the tree's root per unit rate of each dof) from `qpos`.
pub(crate) fn kinematics<T: Scalar>(plant: &Plant<T>, qpos: &[T], work: &mut Work<T>) {
    for (index, link) in plant.links.iter().enumerate().skip(1) {
        let parent_rot = work.rot[link.parent];
        let mut pos = work.pos[link.parent] + parent_rot.apply(link.pos);
        let mut rot = match &link.rot {
            Some(rot) => parent_rot.product(rot),
            None => parent_rot,
        };
        for joint in &plant.joints[link.joints.clone()] {
            let turned = match joint.kind {
                JointKind::Hinge => {
                    let angle = qpos[joint.q] - joint.reference;
                    work.axes[joint.dof].ang = rot.apply(joint.axis);
                    Some(rot.product(&Mat3::about(joint.axis, angle.sin_cos())))
                }
                JointKind::Slide => {
                    let axis = rot.apply(joint.axis);
                    work.axes[joint.dof] = Motion { ang: Vec3::ZERO, lin: axis };
                    pos += axis * (qpos[joint.q] - joint.reference);
                    None
                }
                JointKind::Ball => Some(rot.product(&quat_at(qpos, joint.q).matrix())),
                JointKind::Free => {
                    pos = Vec3([qpos[joint.q], qpos[joint.q + 1], qpos[joint.q + 2]]);
                    rot = quat_at(qpos, joint.q + 3).matrix();
                    None
                }
            };
            if let Some(turned) = turned {
                // the anchor stays where it is; the axis's velocity field is left relative to it for now
                let anchor = match joint.pos {
                    Some(at) => {
                        let anchor = pos + rot.apply(at);
                        pos = anchor - turned.apply(at);
                        anchor
                    }
                    None => pos,
                };
                rot = turned;
                for dof in joint.dof..joint.dof + joint.kind.nv() {
                    work.axes[dof].lin = anchor;
                }
            }
        }
        work.pos[index] = pos;
        work.rot[index] = rot;
        let origin = work.pos[link.root];
        for joint in &plant.joints[link.joints.clone()] {
            let axes = &mut work.axes[joint.dof..joint.dof + joint.kind.nv()];
            match joint.kind {
                JointKind::Slide => {}
                JointKind::Hinge => axes[0].lin = axes[0].ang.cross(origin - axes[0].lin),
                JointKind::Ball => turn_axes(axes, &rot, origin),
                JointKind::Free => {
                    let (travel, turn) = axes.split_at_mut(3);
                    for (axis, unit) in travel.iter_mut().zip(Mat3::IDENTITY.0) {
                        *axis = Motion { ang: Vec3::ZERO, lin: Vec3(unit) };
                    }
                    for axis in turn.iter_mut() {
                        axis.lin = pos;
                    }
                    turn_axes(turn, &rot, origin);
                }
            }
        }
    }
}

/// The three axes of a body turning about a point (left in `lin`), as motions at `origin`.
fn turn_axes<T: Scalar>(axes: &mut [Motion<T>], rot: &Mat3<T>, origin: Vec3<T>) {
    for (k, axis) in axes.iter_mut().enumerate() {
        axis.ang = rot.column(k);
        axis.lin = axis.ang.cross(origin - axis.lin);
    }
}

fn quat_at<T: Scalar>(qpos: &[T], at: usize) -> Quat<T> {
    Quat([qpos[at], qpos[at + 1], qpos[at + 2], qpos[at + 3]]).normalized()
}
