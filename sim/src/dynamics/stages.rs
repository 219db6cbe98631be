//! Stages that a space may have beside the general ones.

use std::fmt::Debug;

use super::Work;
use super::friction_and_limits::Solver;
use super::plant::Plant;
use crate::model::Model;
use crate::space::Space;

/// A space with the stages that only some spaces have.
pub(crate) trait Stages: Space {
    /// The water's slopes for implicit integration, where they are to be had.
    type Slope: SlopeStage<Self>;
    /// Contact, where geoms can meet.
    type Contacts: ContactStage<Self>;
}

/// Adds the slopes of velocity-dependent forces to a matrix.
pub(crate) trait SlopeStage<S: Space>: Debug + Clone + Send + Sync {
    /// Made ready for a plant; `None` where this space has none.
    fn new(plant: &Plant<S>) -> Option<Self>;
    /// Adds -`h` times the slope to `matrix`, stored as the mass matrix is.
    fn add(&mut self, plant: &Plant<S>, work: &Work<S>, h: S::T, matrix: &mut [S::T]);
    /// After [`Self::add`], the accelerations of [`Plant::lone`] with all slopes as they are, each with its first dof: `matrix` leaves
    /// out what is not symmetric. `force`: on all dofs.
    fn alone(
        &self,
        place: (&Plant<S>, &Work<S>),
        qvel: &[S::T],
        h: S::T,
        matrix: &[S::T],
        force: &[S::T],
    ) -> Vec<(usize, [S::T; 6])>;
}

/// The forces of geoms on each other.
pub(crate) trait ContactStage<S: Space>: Debug + Clone + Send + Sync {
    /// Made ready for a model; `None` where none of its geoms meet in this space.
    fn new(model: &Model<S::T>, plant: &Plant<S>) -> Option<Self>;
    /// Takes from the state at the reference how easily bodies move; `factors` are the mass matrix's.
    fn weigh(&mut self, model: &Model<S::T>, plant: &Plant<S>, work: &Work<S>, factors: &[S::T]);
    /// Looks for points where geoms meet; whether there are any.
    fn find(&mut self, work: &Work<S>) -> bool;
    /// Adds the forces at the points found, and of `restraints`, to `force`, which comes in as the sum of all others. Which dofs
    /// are held, the time step that softness is for \[s\]; coordinates and velocities.
    fn resolve(
        &mut self,
        place: (&Plant<S>, &Work<S>),
        held: (&[bool], f64),
        state: (&[S::T], &[S::T]),
        restraints: Option<&mut Solver<S::T>>,
        force: &mut [S::T],
    );
    /// Notes which points there are and on which side of its bounds each force is; `first` in a step.
    fn watch(&mut self, first: bool);
    /// Whether that has changed since the step began: accelerations have a corner there.
    fn changed(&self) -> bool;
    /// Longest step of our own that they bear \[s\].
    fn longest_step_s(&self) -> f64;
}
