//! Which of the stages beside the general ones each space has: a plane none of them.

use super::contact::Contacts;
use super::implicit::FluidSlope;
use super::plant::Plant;
use super::restraint::Solver;
use super::stages::{ContactStage, SlopeStage, Stages};
use super::work::Work;
use crate::model::Model;
use crate::scalar::Scalar;
use crate::space::{Never, Planar, Spatial};

impl<T: Scalar> Stages for Spatial<T> {
    type Slope = FluidSlope<T>;
    type Contacts = Contacts<T>;
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
