//! What the stages of a step compute.

use super::plant::Plant;
use crate::math::Vector;
use crate::scalar::Scalar;
use crate::space::{Inertia, Motion, Space, Wrench};

/// Everything the stages compute, allocated once.
#[derive(Debug, Clone)]
pub(crate) struct Work<S: Space> {
    /// Origin of each body \[m\].
    pub(crate) pos: Vec<S::Vec>,
    /// `world_from_body`.
    pub(crate) rot: Vec<S::Rot>,
    /// Centre of mass from the tree's root \[m\].
    pub(crate) com: Vec<S::Vec>,
    /// Motion per unit rate of each dof.
    pub(crate) axes: Vec<Motion<S>>,
    pub(crate) inertia: Vec<Inertia<S>>,
    /// Inertia of each body with all it carries.
    pub(crate) composite: Vec<Inertia<S>>,
    /// Of each body; the world's own, which is the base's, is about the base's origin.
    pub(crate) velocity: Vec<Motion<S>>,
    /// Acceleration of each body with all joint accelerations 0, less gravity.
    pub(crate) drift: Vec<Motion<S>>,
    /// Velocity and spatial acceleration of the base, about its own origin; `None` where it stands.
    pub(crate) base: Option<[Motion<S>; 2]>,
    /// External and inertial wrench on each body; 0 between uses.
    pub(crate) wrench: Vec<Wrench<S>>,
    /// Velocity of the water, world axes \[m/s\].
    pub(crate) water: S::Vec,
    /// The mass matrix, rows as in [`Plant::chain`].
    pub(crate) mass: Vec<S::T>,
}

impl<S: Space> Work<S> {
    pub(crate) fn new(plant: &Plant<S>) -> Self {
        let bodies = plant.links.len();
        Self {
            pos: vec![S::Vec::ZERO; bodies],
            rot: vec![S::IDENTITY; bodies],
            com: vec![S::Vec::ZERO; bodies],
            axes: vec![Motion::ZERO; plant.nv],
            inertia: vec![Inertia::ZERO; bodies],
            composite: vec![Inertia::ZERO; bodies],
            velocity: vec![Motion::ZERO; bodies],
            drift: vec![Motion::ZERO; bodies],
            base: None,
            wrench: vec![Wrench::ZERO; bodies],
            water: plant.wind,
            mass: vec![S::T::ZERO; plant.chain.len()],
        }
    }
}
