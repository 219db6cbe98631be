//! What a cause may do in a step.

use std::fmt::Debug;

use crate::dynamics::Work;
use crate::dynamics::plant::Plant;
use crate::model::Model;
use crate::model::cause::CauseValues;
use crate::space::Space;

/// When the forces are asked for.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Moment {
    /// Time \[s\].
    pub(crate) time_s: f64,
    /// Since the step began \[s\]; 0 at the state that the last step ended in.
    pub(crate) elapsed_s: f64,
    /// Length of the last step \[s\], when this is the first look at the state that it ended in; infinite where a run
    /// begins.
    pub(crate) arrived_s: Option<f64>,
}

/// What a cause does in a step. Each hook does nothing unless the cause has it, and is inlined into the step.
pub(crate) trait Step<S: Space>: Sized + Debug + Clone + Send + Sync {
    /// The cause with these values, laid out for `plant`.
    fn new(values: &CauseValues<S::T>, model: &Model<S::T>, plant: &Plant<S>) -> Self;

    /// How many vectors of memory it keeps from step to step, 0 at first.
    fn memory(&self) -> usize {
        0
    }

    /// Adds to the velocity of the water, world axes \[m/s\]; `clock` is by how much a lane's clock is ahead \[s\].
    #[inline(always)]
    fn water(&self, _moment: Moment, _clock: S::T, _plant: &Plant<S>, _velocity: &mut S::Vec) {}

    /// Adds to the mass matrix.
    #[inline(always)]
    fn inertia(&self, _plant: &Plant<S>, _work: &mut Work<S>) {}

    /// Adds to the wrenches on the bodies; velocities are known.
    #[inline(always)]
    fn wrenches(&self, _moment: Moment, _plant: &Plant<S>, _work: &mut Work<S>, _memory: &mut [S::Vec]) {}

    /// Adds to the forces on the degrees of freedom.
    #[inline(always)]
    fn forces(&self, _qpos: &[S::T], _qvel: &[S::T], _force: &mut [S::T]) {}

    /// Adds how fast its force on each degree of freedom falls with the rate and with the coordinate, for implicit steps: about,
    /// where it may be stiff. Exact or not, motions are the same in the limit of short steps.
    #[inline(always)]
    fn slopes(&self, _qpos: &[S::T], _qvel: &[S::T], _damping: &mut [S::T], _stiffness: &mut [S::T]) {}
}
