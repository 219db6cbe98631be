//! Which of the stages beside the general ones each space has: a plane none of them.

use super::implicit::FluidSlope;
use super::plant::Plant;
use super::stages::{SlopeStage, Stages};
use super::work::Work;
use crate::scalar::Scalar;
use crate::space::{Never, Planar, Spatial};

impl<T: Scalar> Stages for Spatial<T> {
    type Slope = FluidSlope<T>;
}

impl<T: Scalar> Stages for Planar<T> {
    type Slope = Never;
}

impl<T: Scalar> SlopeStage<Planar<T>> for Never {
    fn new(_: &Plant<Planar<T>>) -> Option<Self> {
        None
    }

    fn add(&mut self, _: &Plant<Planar<T>>, _: &Work<Planar<T>>, _: T, _: &mut [T]) {
        match *self {}
    }
}
