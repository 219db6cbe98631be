//! `slosh`: the water in the tank swings to and fro.

use std::f64::consts::TAU;

use crate::causes::hooks::{Moment, Step};
use crate::dynamics::plant::Plant;
use crate::math::Vec3;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Role};
use crate::scalar::Scalar;
use crate::space::Space;

const BOUNDS_M_PER_S: [f64; 2] = [-0.2, 0.2];
/// From tanks of 2 m to beakers of 10 cm.
const FREQUENCIES_HZ: &[f64] = &[0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.4, 1.6, 1.8, 2.1, 2.4, 2.7];

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "slosh",
    kind: Kind::Physics,
    parameters: &[
        ParameterInfo::size(
            "sin",
            "m/s",
            BOUNDS_M_PER_S,
            0.005,
            "velocity to the right in phase with sin(2 pi f t)",
        )
        .each_run(),
        ParameterInfo::size(
            "cos",
            "m/s",
            BOUNDS_M_PER_S,
            0.005,
            "velocity to the right in phase with cos(2 pi f t)",
        )
        .each_run(),
        ParameterInfo::size("frequency", "Hz", [0.2, 5.0], 0.1, "frequency of the tank's waves")
            .role(Role::Hidden(FREQUENCIES_HZ), 1.0),
    ],
    aliases: &[],
    sentence: "the water in the tank sways at its own frequency",
    check: "wait longer before the run, and film a float beside the mechanism",
    formula: "u = sin sin(2 pi f t) + cos cos(2 pi f t) to the right, t since the run's start",
    source: "first mode of a tank of length L and depth h: f = sqrt(g pi / L tanh(pi h / L)) / (2 pi). The same velocity \
             everywhere; the pressure of the swaying water itself is not counted",
    mjcf: None,
    in_picture_plane: true,
};

/// The water's swing.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    right: S::Vec,
    sin: S::T,
    cos: S::T,
    frequency: S::T,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, _: &Model<S::T>, plant: &Plant<S>) -> Self {
        let right = S::vector(&plant.layout, 0, Vec3::constant([1.0, 0.0, 0.0]));
        Self { right, sin: values.one(0), cos: values.one(1), frequency: values.one(2) }
    }

    #[inline(always)]
    fn water(&self, moment: Moment, clock: S::T, _: &Plant<S>, velocity: &mut S::Vec) {
        let time_s = S::T::from_f64(moment.time_s) + clock;
        let (sin, cos) = (self.frequency * time_s * S::T::from_f64(TAU)).sin_cos();
        *velocity += self.right * (self.sin * sin + self.cos * cos);
    }
}
