//! Fixed tendons in stage 4: springs and dampers along sums of coordinates.

use super::plant::Plant;
use crate::model::{Model, Tendon};
use crate::scalar::Scalar;
use crate::space::Space;

/// One joint of a sum of coordinates: where it stands, and its coefficient.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Term<T> {
    pub(crate) q: usize,
    pub(crate) dof: usize,
    pub(crate) coefficient: T,
}

/// The terms of a sum over joints of `model`.
pub(crate) fn terms<T: Scalar>(model: &Model<T>, sum: &[(usize, f64)]) -> Vec<Term<T>> {
    let term = |&(joint, coefficient): &(usize, f64)| {
        let joint = &model.joints[joint];
        let coefficient = T::from_f64(coefficient);
        Term { q: joint.qpos_address, dof: joint.dof_address, coefficient }
    };
    sum.iter().map(term).collect()
}

/// A fixed tendon that pulls.
#[derive(Debug, Clone)]
pub(crate) struct TendonPlan<T> {
    terms: Vec<Term<T>>,
    stiffness: [T; 3],
    pub(crate) damping: [T; 3],
    slack: [T; 2],
}

impl<T: Scalar> TendonPlan<T> {
    pub(crate) fn new(model: &Model<T>, tendon: &Tendon<T>) -> Self {
        Self {
            terms: terms(model, &tendon.terms),
            stiffness: tendon.stiffness,
            damping: tendon.damping,
            slack: tendon.slack.map(T::from_f64),
        }
    }

    /// By how much it is longer than it is slack, or, below 0, shorter; and the rate of its length.
    #[inline(always)]
    fn stretch(&self, qpos: &[T], qvel: &[T]) -> [T; 2] {
        let (mut length, mut rate) = (T::ZERO, T::ZERO);
        for term in &self.terms {
            length += term.coefficient * qpos[term.q];
            rate += term.coefficient * qvel[term.dof];
        }
        [(length - self.slack[1]).max(T::ZERO) + (length - self.slack[0]).min(T::ZERO), rate]
    }
}

/// Adds what tendons pull to `force`.
#[inline(always)]
pub(crate) fn tendons<S: Space>(plant: &Plant<S>, qpos: &[S::T], qvel: &[S::T], force: &mut [S::T]) {
    for tendon in &plant.tendons {
        let [x, v] = tendon.stretch(qpos, qvel);
        let ([a, b, c], [d, e, f]) = (tendon.stiffness, tendon.damping);
        let pull = x * (a + x * (b + c * x)) + v * (d + e * v.abs() + f * v * v);
        for term in &tendon.terms {
            force[term.dof] -= term.coefficient * pull;
        }
    }
}

/// Adds the slopes of tendons against each joint's own rate and coordinate to `damping` and `stiffness`, shape (nv) each.
#[inline(always)]
pub(crate) fn slopes<S: Space>(
    plant: &Plant<S>,
    qpos: &[S::T],
    qvel: &[S::T],
    damping: &mut [S::T],
    stiffness: &mut [S::T],
) {
    let (two, three) = (S::T::from_f64(2.0), S::T::from_f64(3.0));
    for tendon in &plant.tendons {
        let [x, v] = tendon.stretch(qpos, qvel);
        let ([a, b, c], [d, e, f]) = (tendon.stiffness, tendon.damping);
        for term in &tendon.terms {
            let squared = term.coefficient * term.coefficient;
            stiffness[term.dof] += squared * (a + x * (two * b + three * c * x));
            damping[term.dof] += squared * (d + two * e * v.abs() + three * f * v * v);
        }
    }
}
