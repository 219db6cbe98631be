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
        ParameterInfo::size(
            "loss",
            "s/rad",
            [0.0, 5.0],
            0.2,
            "by how much of itself the stop pushes back harder per rate at which it is pressed, and less as it is left",
        )
        .role(Role::Hidden(&[0.0]), 0.0),
    ],
    aliases: &[],
    sentence: "the joints hit a stop at an angle",
    check: "bend each hinge by hand as far as it goes and measure the angles",
    formula: "tau = -k max(|x| - angle, 0) max(1 + loss d|x|/dt, 0) sign(x), x from springref; joints as for stiffness",
    source: "K. H. Hunt, F. R. E. Crossley, Journal of Applied Mechanics 42 (1975) 440-445: a linear stop that loses energy",
    mjcf: None,
    in_picture_plane: false,
};

/// The stops.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    axles: Vec<Axle<S::T>>,
    angle: S::T,
    loss: S::T,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, model: &Model<S::T>, _: &Plant<S>) -> Self {
        Self { axles: sizes(values, model, [0, 1], true), angle: values.one(2), loss: values.one(3) }
    }

    #[inline(always)]
    fn forces(&self, qpos: &[S::T], qvel: &[S::T], force: &mut [S::T]) {
        for axle in &self.axles {
            let [above, below] = self.pressed(axle, qpos);
            let [rising, falling] = self.pushes(axle, qvel);
            force[axle.dof] -= axle.size * (above * rising - below * falling);
        }
    }

    #[inline(always)]
    fn slopes(&self, qpos: &[S::T], qvel: &[S::T], damping: &mut [S::T], stiffness: &mut [S::T]) {
        let zero = S::T::ZERO;
        for axle in &self.axles {
            let pressed = self.pressed(axle, qpos);
            for (pressed, push) in pressed.into_iter().zip(self.pushes(axle, qvel)) {
                stiffness[axle.dof] += S::T::select(zero.less(pressed), axle.size * push, zero);
                damping[axle.dof] += S::T::select(zero.less(push), axle.size * pressed * self.loss, zero);
            }
        }
    }
}

impl<S: Space> Term<S> {
    /// How far the stops above and below are pressed \[rad\].
    #[inline(always)]
    fn pressed(&self, axle: &Axle<S::T>, qpos: &[S::T]) -> [S::T; 2] {
        let x = qpos[axle.q] - axle.slack;
        [x - self.angle, -x - self.angle].map(|beyond| beyond.max(S::T::ZERO))
    }

    /// How much harder than at rest they push.
    #[inline(always)]
    fn pushes(&self, axle: &Axle<S::T>, qvel: &[S::T]) -> [S::T; 2] {
        let w = qvel[axle.dof] * self.loss;
        [S::T::ONE + w, S::T::ONE - w].map(|push| push.max(S::T::ZERO))
    }
}
