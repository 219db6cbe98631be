//! Stages that a space may have beside the general ones.

use std::fmt::Debug;

use super::Work;
use super::plant::Plant;
use crate::space::Space;

/// A space with the stages that only some spaces have.
pub(crate) trait Stages: Space {
    /// The water's slopes for implicit integration, where they are to be had.
    type Slope: SlopeStage<Self>;
}

/// Adds the slopes of velocity-dependent forces to a matrix.
pub(crate) trait SlopeStage<S: Space>: Debug + Clone + Send + Sync {
    /// Made ready for a plant; `None` where this space has none.
    fn new(plant: &Plant<S>) -> Option<Self>;
    /// Adds -`h` times the slope to `matrix`, stored as the mass matrix is.
    fn add(&mut self, plant: &Plant<S>, work: &Work<S>, h: S::T, matrix: &mut [S::T]);
}
