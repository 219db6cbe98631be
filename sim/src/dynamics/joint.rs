//! How each kind of joint moves its body in a step.

use crate::math::{Quat, Vec3, Vector};
use crate::model::{Body, Joint, JointKind};
use crate::scalar::Scalar;
use crate::space::{Motion, Space};

/// How a joint moves its body, axes in the body's frame.
#[derive(Debug, Clone, Copy)]
enum Moves<S: Space> {
    /// `along`: the body's own axis that it lies on, if on one.
    Hinge {
        axis: S::Spin,
        along: Option<usize>,
    },
    Slide {
        axis: S::Vec,
    },
    Ball(S::AnyTurn),
    Free(S::AnyTurn),
}

/// A joint laid out for stepping.
#[derive(Debug, Clone)]
pub(crate) struct JointPlan<S: Space> {
    moves: Moves<S>,
    /// Degrees of freedom.
    pub(crate) nv: usize,
    pub(crate) q: usize,
    pub(crate) dof: usize,
    /// Anchor in the body's frame; `None` at its origin.
    pos: Option<S::Vec>,
    pub(crate) reference: S::T,
    pub(crate) spring_reference: S::T,
    /// Position and rotation at which springs are slack.
    slack: (Vec3<S::T>, Quat<S::T>),
    pub(crate) stiffness: [S::T; 3],
    pub(crate) springy: bool,
    pub(crate) damping: [S::T; 3],
    pub(crate) damped: bool,
}

impl<S: Space> JointPlan<S> {
    /// Lays out `joint`, which moves `body`.
    pub(crate) fn new(joint: &Joint<S::T>, body: &Body<S::T>, layout: &S::Layout) -> Self {
        let nonzero = |x: S::T| x != S::T::ZERO;
        let moves = match (joint.kind, S::any_turn_possible(layout)) {
            (JointKind::Slide, _) => Moves::Slide { axis: S::vector(layout, joint.body, joint.axis) },
            (JointKind::Ball, Some(possible)) => Moves::Ball(possible),
            (JointKind::Free, Some(possible)) => Moves::Free(possible),
            // a plane is only made for a model without balls and free bodies
            (JointKind::Hinge | JointKind::Ball | JointKind::Free, _) => {
                let axis = S::spin(layout, joint.body, joint.axis);
                Moves::Hinge { axis, along: S::along(axis) }
            }
        };
        Self {
            moves,
            nv: joint.kind.nv(),
            q: joint.qpos_address,
            dof: joint.dof_address,
            pos: (joint.pos != Vec3::ZERO).then(|| S::vector(layout, joint.body, joint.pos)),
            reference: joint.reference,
            spring_reference: joint.spring_reference,
            slack: joint.rest(body),
            stiffness: joint.stiffness,
            springy: joint.stiffness.into_iter().any(nonzero),
            damping: joint.damping,
            damped: joint.damping.into_iter().any(nonzero),
        }
    }

    /// Whether the body floats.
    pub(crate) fn is_free(&self) -> bool {
        matches!(self.moves, Moves::Free(_))
    }

    /// How many of its velocities, the first ones, go along axes of the world, which stay.
    #[inline(always)]
    pub(crate) fn staying(&self) -> usize {
        if self.is_free() { 3 } else { 0 }
    }

    /// Moves a body that stands at `pos` and `rot` by the coordinates in `qpos`. Of its axes of motion the directions are known
    /// then; `lin` of a turn holds the anchor for now.
    #[inline(always)]
    pub(crate) fn place(&self, qpos: &[S::T], pos: &mut S::Vec, rot: &mut S::Rot, axes: &mut [Motion<S>]) {
        let turned = match self.moves {
            Moves::Hinge { axis, along } => {
                let angle = qpos[self.q] - self.reference;
                axes[0].ang = S::apply_spin(rot, axis);
                S::swung(rot, axis, along, angle.sin_cos())
            }
            Moves::Slide { axis } => {
                let axis = S::apply(rot, axis);
                axes[0] = Motion { ang: S::Spin::ZERO, lin: axis };
                *pos += axis * (qpos[self.q] - self.reference);
                return;
            }
            Moves::Ball(possible) => S::product(rot, &S::any_turn(possible, quat_at(qpos, self.q))),
            Moves::Free(possible) => {
                *pos = S::anywhere(possible, [qpos[self.q], qpos[self.q + 1], qpos[self.q + 2]]);
                *rot = S::any_turn(possible, quat_at(qpos, self.q + 3));
                return;
            }
        };
        // the anchor stays where it is
        let anchor = match self.pos {
            Some(at) => {
                let anchor = *pos + S::apply(rot, at);
                *pos = anchor - S::apply(&turned, at);
                anchor
            }
            None => *pos,
        };
        *rot = turned;
        for axis in axes {
            axis.lin = anchor;
        }
    }

    /// Makes `axes`, as [`Self::place`] has left them, motions of the point at `origin`; the body stands at `pos` and `rot`
    /// once all its joints have moved it.
    #[inline(always)]
    pub(crate) fn finish_axes(&self, axes: &mut [Motion<S>], (pos, rot): (S::Vec, &S::Rot), origin: S::Vec) {
        match self.moves {
            Moves::Slide { .. } => {}
            Moves::Hinge { .. } => axes[0].lin = S::cross(axes[0].ang, origin - axes[0].lin),
            Moves::Ball(possible) => turn_axes::<S>(possible, axes, rot, origin),
            Moves::Free(possible) => {
                let (travel, turn) = axes.split_at_mut(3);
                for (k, axis) in travel.iter_mut().enumerate() {
                    *axis = Motion { ang: S::Spin::ZERO, lin: S::travel(possible, k) };
                }
                for axis in turn.iter_mut() {
                    axis.lin = pos;
                }
                turn_axes::<S>(possible, turn, rot, origin);
            }
        }
    }

    /// Adds its spring, -(a x + b x^2 + c x^3), to `force`.
    #[inline(always)]
    pub(crate) fn spring(&self, qpos: &[S::T], force: &mut [S::T]) {
        let [a, b, c] = self.stiffness;
        let (q, dof, (at, slack)) = (self.q, self.dof, self.slack);
        match self.moves {
            Moves::Hinge { .. } | Moves::Slide { .. } => {
                let x = qpos[q] - self.spring_reference;
                force[dof] -= x * (a + x * (b + x * c));
            }
            Moves::Ball(_) => unbend(a, quat_at(qpos, q), slack, &mut force[dof..dof + 3]),
            Moves::Free(_) => {
                unbend(a, quat_at(qpos, q + 3), slack, &mut force[dof + 3..dof + 6]);
                for k in 0..3 {
                    force[dof + k] -= a * (qpos[q + k] - at[k]);
                }
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

/// Adds the spring of a rotation that stands at `now` and is slack at `slack` to the three components of `force`.
#[inline(always)]
fn unbend<T: Scalar>(stiffness: T, now: Quat<T>, slack: Quat<T>, force: &mut [T]) {
    let bend = slack.conjugate().product(now).rotation_vector();
    for k in 0..3 {
        force[k] -= stiffness * bend[k];
    }
}

#[inline(always)]
fn quat_at<T: Scalar>(qpos: &[T], at: usize) -> Quat<T> {
    Quat([qpos[at], qpos[at + 1], qpos[at + 2], qpos[at + 3]]).normalized()
}
