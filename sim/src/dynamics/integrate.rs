//! Stage 8: coordinates along velocities, and between two instants.

use super::plant::{JointPlanKind, Plant};
use crate::math::{Quat, Vec3};
use crate::scalar::Scalar;
use crate::space::Space;

/// Writes to `out` the coordinates `qpos` moved along `qvel` for `h` \[s\]; quaternions by exponential map.
#[inline(always)]
pub(crate) fn advance<S: Space>(plant: &Plant<S>, qpos: &[S::T], qvel: &[S::T], h: S::T, out: &mut [S::T]) {
    for joint in &plant.joints {
        let (q, dof) = (joint.q, joint.dof);
        match joint.kind {
            JointPlanKind::Hinge { .. } | JointPlanKind::Slide { .. } => out[q] = qpos[q] + h * qvel[dof],
            JointPlanKind::Ball(_) => turn(qpos, q, qvel, dof, h, out),
            JointPlanKind::Free(_) => {
                for k in 0..3 {
                    out[q + k] = qpos[q + k] + h * qvel[dof + k];
                }
                turn(qpos, q + 3, qvel, dof + 3, h, out);
            }
        }
    }
}

/// Turns the velocities in `rate` into rates of the rotation vectors in `turned`, by which the balls and free
/// bodies have turned since the step began: u' = w + u x w / 2 + u x (u x w) / 12, body axes. What makes
/// Runge-Kutta fourth order on rotations too (Munthe-Kaas, 1999).
#[inline(always)]
pub(crate) fn follow_turn<S: Space>(plant: &Plant<S>, turned: &[S::T], rate: &mut [S::T]) {
    for joint in &plant.joints {
        let first = match joint.kind {
            JointPlanKind::Hinge { .. } | JointPlanKind::Slide { .. } => continue,
            JointPlanKind::Ball(_) => joint.dof,
            JointPlanKind::Free(_) => joint.dof + 3,
        };
        let at = |v: &[S::T]| Vec3([v[first], v[first + 1], v[first + 2]]);
        let (u, w) = (at(turned), at(rate));
        let once = u.cross(w);
        let follows = w + once * S::T::from_f64(0.5) + u.cross(once) * S::T::from_f64(1.0 / 12.0);
        rate[first..first + 3].copy_from_slice(&follows.0);
    }
}

#[inline(always)]
fn quat_at<T: Scalar>(qpos: &[T], at: usize) -> Quat<T> {
    Quat([qpos[at], qpos[at + 1], qpos[at + 2], qpos[at + 3]])
}

#[inline(always)]
fn turn<T: Scalar>(qpos: &[T], q: usize, qvel: &[T], dof: usize, h: T, out: &mut [T]) {
    let by = Quat::from_rotation_vector(Vec3([qvel[dof], qvel[dof + 1], qvel[dof + 2]]) * h);
    out[q..q + 4].copy_from_slice(&quat_at(qpos, q).product(by).normalized().0);
}

/// Scales the quaternions among the coordinates to unit length.
pub(crate) fn normalise<S: Space>(plant: &Plant<S>, qpos: &mut [S::T]) {
    for joint in &plant.joints {
        let first = match joint.kind {
            JointPlanKind::Hinge { .. } | JointPlanKind::Slide { .. } => continue,
            JointPlanKind::Ball(_) => joint.q,
            JointPlanKind::Free(_) => joint.q + 3,
        };
        let unit = quat_at(qpos, first).normalized();
        qpos[first..first + 4].copy_from_slice(&unit.0);
    }
}

/// One instant: coordinates and velocities.
pub(crate) type Instant<'a, T> = (&'a [T], &'a [T]);

/// Writes to `out` the coordinates at the share `s` of the way between two instants `h` \[s\] apart: cubic
/// Hermite in each coordinate, quaternions scaled back to unit length.
#[inline(always)]
pub(crate) fn between<S: Space>(
    plant: &Plant<S>,
    (q0, v0): Instant<'_, S::T>,
    (q1, v1): Instant<'_, S::T>,
    h: f64,
    s: S::T,
    out: &mut [S::T],
) {
    let (h, rest) = (S::T::from_f64(h), S::T::ONE - s);
    let weights = [
        (S::T::ONE + s + s) * rest * rest,
        s * rest * rest * h,
        s * s * (S::T::ONE + rest + rest),
        -(s * s * rest * h),
    ];
    let blend = |a: S::T, rate_a: S::T, b: S::T, rate_b: S::T| {
        weights[0] * a + weights[1] * rate_a + weights[2] * b + weights[3] * rate_b
    };
    let turned = |q: usize, dof: usize, out: &mut [S::T]| {
        let rate = |qpos: &[S::T], v: &[S::T]| {
            let half = S::T::from_f64(0.5);
            quat_at(qpos, q)
                .product(Quat([S::T::ZERO, v[dof] * half, v[dof + 1] * half, v[dof + 2] * half]))
                .0
        };
        let (r0, r1) = (rate(q0, v0), rate(q1, v1));
        let mixed = std::array::from_fn(|k| blend(q0[q + k], r0[k], q1[q + k], r1[k]));
        out[q..q + 4].copy_from_slice(&Quat(mixed).normalized().0);
    };
    for joint in &plant.joints {
        let (q, dof) = (joint.q, joint.dof);
        match joint.kind {
            JointPlanKind::Hinge { .. } | JointPlanKind::Slide { .. } => {
                out[q] = blend(q0[q], v0[dof], q1[q], v1[dof])
            }
            JointPlanKind::Ball(_) => turned(q, dof, out),
            JointPlanKind::Free(_) => {
                for k in 0..3 {
                    out[q + k] = blend(q0[q + k], v0[dof + k], q1[q + k], v1[dof + k]);
                }
                turned(q + 3, dof + 3, out);
            }
        }
    }
}
