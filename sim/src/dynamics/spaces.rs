//! Which of the stages beside the general ones each space has: a plane none of them.

use super::implicit::FluidSlope;
use super::limbs::Limbs;
use super::plant::Plant;
use super::stages::{LimbStage, SlopeStage, Stages};
use super::work::Work;
use crate::model::Model;
use crate::scalar::Scalar;
use crate::space::{Never, Planar, Spatial};

impl<T: Scalar> Stages for Spatial<T> {
    type Slope = FluidSlope<T>;
    type Limbs = Limbs<T>;
}

impl<T: Scalar> Stages for Planar<T> {
    type Slope = Never;
    type Limbs = Never;
}

impl<T: Scalar> SlopeStage<Planar<T>> for Never {
    fn new(_: &Plant<Planar<T>>) -> Option<Self> {
        None
    }

    fn add(&mut self, _: &Plant<Planar<T>>, _: &Work<Planar<T>>, _: T, _: &mut [T]) {
        match *self {}
    }
}

impl<T: Scalar> LimbStage<Planar<T>> for Never {
    fn new(_: &Model<T>, _: &Plant<Planar<T>>) -> Option<Self> {
        None
    }

    fn factors(&self) -> usize {
        match *self {}
    }

    fn accelerate(
        &mut self,
        _: &Plant<Planar<T>>,
        _: &[T],
        _: &[T],
        _: &mut Work<Planar<T>>,
        _: Option<&[T]>,
        _: &mut [T],
        _: &mut [T],
    ) {
        match *self {}
    }

    fn solve(&mut self, _: &[T], _: &mut [T]) {
        match *self {}
    }
}
