//! Stages that a space may have beside the general ones.

use std::fmt::Debug;

use super::Work;
use super::plant::Plant;
use crate::model::Model;
use crate::space::Space;

/// A space with the stages that only some spaces have.
pub(crate) trait Stages: Space {
    /// The water's slopes for implicit integration, where they are to be had.
    type Slope: SlopeStage<Self>;
    /// Dynamics of branches that each move in a plane of their own, where there can be such.
    type Limbs: LimbStage<Self>;
}

/// Adds the slopes of velocity-dependent forces to a matrix.
pub(crate) trait SlopeStage<S: Space>: Debug + Clone + Send + Sync {
    /// Made ready for a plant; `None` where this space has none.
    fn new(plant: &Plant<S>) -> Option<Self>;
    /// Adds -`h` times the slope to `matrix`, stored as the mass matrix is.
    fn add(&mut self, plant: &Plant<S>, work: &Work<S>, h: S::T, matrix: &mut [S::T]);
}

/// Stands in for the general stages where a model suits it.
pub(crate) trait LimbStage<S: Space>: Debug + Clone + Send + Sync {
    /// Made ready for a plant; `None` where it does not suit.
    fn new(model: &Model<S::T>, plant: &Plant<S>) -> Option<Self>;
    /// How many numbers the factors are.
    fn factors(&self) -> usize;
    /// Turns `force`, all that acts on the dofs but for what the bodies exert (inertia, weight, water), into accelerations, shape
    /// (nv); writes the factors of the mass matrix, to the diagonal of which `shift` is added, shape (nv).
    #[expect(clippy::too_many_arguments, reason = "one stage's inputs")]
    fn accelerate(
        &mut self,
        plant: &Plant<S>,
        qpos: &[S::T],
        qvel: &[S::T],
        work: &mut Work<S>,
        shift: Option<&[S::T]>,
        factors: &mut [S::T],
        force: &mut [S::T],
    );
    /// Solves for the right-hand side in `x`, in place.
    fn solve(&mut self, factors: &[S::T], x: &mut [S::T]);
}
