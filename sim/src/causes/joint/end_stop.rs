//! `end_stop`: the joints cannot bend further than an angle.

use crate::causes::hooks::Step;
use crate::causes::joint::axles::{Axle, sizes};
use crate::dynamics::plant::Plant;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Per, Role};
use crate::scalar::Scalar;
use crate::space::Space;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "end_stop",
    kind: Kind::Joint,
    parameters: &[
        ParameterInfo::size(
            "stiffness",
            "N m/rad",
            [0.0, 10.0],
            5e-4,
            "stiffness of the stop of every joint between links",
        ),
        ParameterInfo::size("", "N m/rad", [0.0, 10.0], 5e-4, "the same for one joint alone, added to it")
            .each(Per::Joint)
            .role(Role::Detail, 0.0),
        ParameterInfo::size("angle", "rad", [0.02, 3.0], 0.05, "angle on either side at which it stops")
            .role(Role::Hidden(&[0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.2]), 0.4),
    ],
    aliases: &[],
    sentence: "the joints hit a stop at an angle",
    check: "bend each hinge by hand as far as it goes and measure the angles",
    formula: "tau = -k max(|x| - angle, 0) sign(x), x from springref; joints as for stiffness",
    source: "linear stop without damping",
    mjcf: None,
    in_picture_plane: false,
};

/// The stops.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    axles: Vec<Axle<S::T>>,
    angle: S::T,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, model: &Model<S::T>, _: &Plant<S>) -> Self {
        Self { axles: sizes(values, model, [0, 1], true), angle: values.one(2) }
    }

    #[inline(always)]
    fn forces(&self, qpos: &[S::T], _: &[S::T], force: &mut [S::T]) {
        for axle in &self.axles {
            let x = qpos[axle.q] - axle.slack;
            let beyond = (x - self.angle).max(S::T::ZERO) - (-x - self.angle).max(S::T::ZERO);
            force[axle.dof] -= axle.size * beyond;
        }
    }

    #[inline(always)]
    fn slopes(&self, qpos: &[S::T], _: &[S::T], _: &mut [S::T], stiffness: &mut [S::T]) {
        for axle in &self.axles {
            let pressed = self.angle.less((qpos[axle.q] - axle.slack).abs());
            stiffness[axle.dof] += S::T::select(pressed, axle.size, S::T::ZERO);
        }
    }
}
