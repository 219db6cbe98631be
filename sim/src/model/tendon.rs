//! Fixed tendons: what couples hinges and slides by a sum of their coordinates.

use super::Joint;
use crate::scalar::Scalar;

/// A spring and damper along a sum of coordinates, its length: MuJoCo's `<fixed>`.
#[derive(Debug, Clone, PartialEq)]
pub struct Tendon<T> {
    /// Its name, or `tendon#` and its place in the file.
    pub name: String,
    /// Whether the file names it.
    pub named: bool,
    /// The joints it runs over, hinges and slides, each with its coefficient in the length.
    pub terms: Vec<(usize, f64)>,
    /// Spring -(a x + b x^2 + c x^3), x beyond the lengths at which it is slack: a, b, c.
    pub stiffness: [T; 3],
    /// Damper -(a v + b v|v| + c v^3), v the rate of the length: a, b, c.
    pub damping: [T; 3],
    /// From where to where it is slack; where both are the same, that is its rest.
    pub slack: [f64; 2],
}

impl<T: Scalar> Tendon<T> {
    /// Whether it exerts any force of its own.
    pub(crate) fn pulls(&self) -> bool {
        self.stiffness.iter().chain(&self.damping).any(|x| *x != T::ZERO)
    }

    pub(crate) fn map<U>(&self, f: impl Fn(T) -> U + Copy) -> Tendon<U> {
        Tendon {
            name: self.name.clone(),
            named: self.named,
            terms: self.terms.clone(),
            stiffness: self.stiffness.map(f),
            damping: self.damping.map(f),
            slack: self.slack,
        }
    }
}

/// What the terms of a tendon are at the springs' references of `joints`.
pub(crate) fn reference_length(terms: &[(usize, f64)], joints: &[Joint<f64>]) -> f64 {
    terms.iter().map(|&(joint, coefficient)| coefficient * joints[joint].spring_reference).sum()
}
