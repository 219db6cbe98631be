//! Which of the stages beside the general ones each space has: a plane none of them.

use super::contact::Contacts;
use super::friction_and_limits::Solver;
use super::implicit::FluidSlope;
use super::plant::Plant;
use super::stages::{ContactStage, SlopeStage, Stages};
use super::work::Work;
use crate::model::Model;
use crate::scalar::Scalar;
use crate::space::{Never, Planar, Spatial};

impl<T: Scalar> Stages for Spatial<T> {
    type Slope = OneByOne<FluidSlope<T>>;
    type Contacts = OneByOne<Contacts<T>>;
}

/// A stage for numbers that are computed one by one: there is none for those side by side in lanes, and nothing of it is compiled for
/// them (see [`one_by_one`](crate::simulator::one_by_one)).
#[derive(Debug, Clone)]
pub(crate) struct OneByOne<Stage>(Stage);

impl<T: Scalar, K: SlopeStage<Spatial<T>>> SlopeStage<Spatial<T>> for OneByOne<K> {
    fn new(plant: &Plant<Spatial<T>>) -> Option<Self> {
        if const { T::LANES == 1 } { K::new(plant).map(Self) } else { None }
    }

    fn add(&mut self, plant: &Plant<Spatial<T>>, work: &Work<Spatial<T>>, h: T, matrix: &mut [T]) {
        if const { T::LANES == 1 } {
            self.0.add(plant, work, h, matrix);
        }
    }

    fn alone(
        &self,
        place: (&Plant<Spatial<T>>, &Work<Spatial<T>>),
        qvel: &[T],
        h: T,
        matrix: &[T],
        force: &[T],
    ) -> Vec<(usize, [T; 6])> {
        if const { T::LANES == 1 } { self.0.alone(place, qvel, h, matrix, force) } else { Vec::new() }
    }
}

impl<T: Scalar, K: ContactStage<Spatial<T>>> ContactStage<Spatial<T>> for OneByOne<K> {
    fn new(model: &Model<T>, plant: &Plant<Spatial<T>>) -> Option<Self> {
        if const { T::LANES == 1 } { K::new(model, plant).map(Self) } else { None }
    }

    fn weigh(&mut self, model: &Model<T>, plant: &Plant<Spatial<T>>, work: &Work<Spatial<T>>, factors: &[T]) {
        if const { T::LANES == 1 } {
            self.0.weigh(model, plant, work, factors);
        }
    }

    fn find(&mut self, work: &Work<Spatial<T>>) -> bool {
        if const { T::LANES == 1 } { self.0.find(work) } else { false }
    }

    fn resolve(
        &mut self,
        place: (&Plant<Spatial<T>>, &Work<Spatial<T>>),
        held: (&[bool], f64),
        state: (&[T], &[T]),
        restraints: Option<&mut Solver<T>>,
        force: &mut [T],
    ) {
        if const { T::LANES == 1 } {
            self.0.resolve(place, held, state, restraints, force);
        }
    }

    fn watch(&mut self, first: bool) {
        if const { T::LANES == 1 } {
            self.0.watch(first);
        }
    }

    fn changed(&self) -> bool {
        self.0.changed()
    }

    fn longest_step_s(&self) -> f64 {
        self.0.longest_step_s()
    }
}

impl<T: Scalar> Stages for Planar<T> {
    type Slope = Never;
    type Contacts = Never;
}

impl<T: Scalar> SlopeStage<Planar<T>> for Never {
    fn new(_: &Plant<Planar<T>>) -> Option<Self> {
        None
    }

    fn add(&mut self, _: &Plant<Planar<T>>, _: &Work<Planar<T>>, _: T, _: &mut [T]) {
        match *self {}
    }

    fn alone(
        &self,
        _: (&Plant<Planar<T>>, &Work<Planar<T>>),
        _: &[T],
        _: T,
        _: &[T],
        _: &[T],
    ) -> Vec<(usize, [T; 6])> {
        match *self {}
    }
}

impl<T: Scalar> ContactStage<Planar<T>> for Never {
    fn new(_: &Model<T>, _: &Plant<Planar<T>>) -> Option<Self> {
        None
    }

    fn weigh(&mut self, _: &Model<T>, _: &Plant<Planar<T>>, _: &Work<Planar<T>>, _: &[T]) {
        match *self {}
    }

    fn find(&mut self, _: &Work<Planar<T>>) -> bool {
        match *self {}
    }

    fn resolve(
        &mut self,
        _: (&Plant<Planar<T>>, &Work<Planar<T>>),
        _: (&[bool], f64),
        _: (&[T], &[T]),
        _: Option<&mut Solver<T>>,
        _: &mut [T],
    ) {
        match *self {}
    }

    fn watch(&mut self, _: bool) {
        match *self {}
    }

    fn changed(&self) -> bool {
        match *self {}
    }

    fn longest_step_s(&self) -> f64 {
        match *self {}
    }
}
