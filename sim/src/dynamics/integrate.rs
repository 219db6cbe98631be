//! Stage 8: coordinates along velocities, and between two instants.

use super::plant::{Place, Plant};
use crate::math::{Quat, Vec3};
use crate::scalar::Scalar;
use crate::space::Space;

/// Writes to `out` the coordinates `qpos` moved along `qvel` for `h` \[s\]; quaternions by exponential map.
#[inline(always)]
pub(crate) fn advance<S: Space>(plant: &Plant<S>, qpos: &[S::T], qvel: &[S::T], h: S::T, out: &mut [S::T]) {
    for &Place { q, dof } in &plant.numbers {
        out[q] = qpos[q] + h * qvel[dof];
    }
    for &Place { q, dof } in &plant.rotations {
        turn(qpos, q, qvel, dof, h, out);
    }
}

/// Turns the velocities in `rate` into rates of the rotation vectors in `turned`, by which the balls and free
/// bodies have turned since the step began: u' = w + u x w / 2 + u x (u x w) / 12, body axes. What makes
/// Runge-Kutta fourth order on rotations too (Munthe-Kaas, 1999).
#[inline(always)]
pub(crate) fn follow_turn<S: Space>(plant: &Plant<S>, turned: &[S::T], rate: &mut [S::T]) {
    for &Place { dof: first, .. } in &plant.rotations {
        let u = Vec3([turned[first], turned[first + 1], turned[first + 2]]);
        let w = Vec3([rate[first], rate[first + 1], rate[first + 2]]);
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

/// The cubic through two values with their rates, at one share of the way.
pub(crate) struct Hermite<T>([T; 4]);

impl<T: Scalar> Hermite<T> {
    /// At the share `s` of a way that takes `h` \[s\].
    #[inline(always)]
    pub(crate) fn new(h: T, s: T) -> Self {
        let rest = T::ONE - s;
        Self([
            (T::ONE + s + s) * rest * rest,
            s * rest * rest * h,
            s * s * (T::ONE + rest + rest),
            -(s * s * rest * h),
        ])
    }

    /// Between `a` and `b`.
    #[inline(always)]
    pub(crate) fn blend(&self, a: T, rate_a: T, b: T, rate_b: T) -> T {
        self.0[0] * a + self.0[1] * rate_a + self.0[2] * b + self.0[3] * rate_b
    }

    /// The same for the quaternion at `q`, whose angular velocity stands at `dof`.
    #[inline(always)]
    fn turn(&self, (q0, v0): Instant<'_, T>, (q1, v1): Instant<'_, T>, q: usize, dof: usize, out: &mut [T]) {
        let (r0, r1) = (quat_rate(q0, q, v0, dof), quat_rate(q1, q, v1, dof));
        for k in 0..4 {
            out[q + k] = self.blend(q0[q + k], r0[k], q1[q + k], r1[k]);
        }
        let unit = quat_at(out, q).normalized();
        out[q..q + 4].copy_from_slice(&unit.0);
    }
}

/// How fast the quaternion at `q` changes.
#[inline(always)]
fn quat_rate<T: Scalar>(qpos: &[T], q: usize, v: &[T], dof: usize) -> [T; 4] {
    let half = T::from_f64(0.5);
    quat_at(qpos, q).product(Quat([T::ZERO, v[dof] * half, v[dof + 1] * half, v[dof + 2] * half])).0
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
    let cubic = Hermite::new(S::T::from_f64(h), s);
    for &Place { q, dof } in &plant.numbers {
        out[q] = cubic.blend(q0[q], v0[dof], q1[q], v1[dof]);
    }
    for &Place { q, dof } in &plant.rotations {
        cubic.turn((q0, v0), (q1, v1), q, dof, out);
    }
}
