//! `one_sided_stiffness`: a joint springs back from one side only.

use crate::causes::hooks::Step;
use crate::causes::joint::axles::{Axle, sizes};
use crate::dynamics::plant::Plant;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Per, Role};
use crate::scalar::Scalar;
use crate::space::Space;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "one_sided_stiffness",
    kind: Kind::Joint,
    parameters: &[
        ParameterInfo::size(
            "stiffness",
            "N m/rad",
            [0.0, 1.0],
            5e-5,
            "stiffness of every joint between links",
        ),
        ParameterInfo::size("", "N m/rad", [0.0, 1.0], 5e-5, "the same for one joint alone, added to it")
            .each(Per::Joint)
            .role(Role::Detail, 0.0),
        ParameterInfo::size(
            "side",
            "1",
            [-1.0, 1.0],
            1.0,
            "1: springs back from positive angles, -1: from negative",
        )
        .role(Role::Choice(&[1.0, -1.0]), 1.0),
    ],
    aliases: &[],
    sentence: "the joints spring back from one side only: a film hinge, a cable on one side",
    check: "bend each hinge by hand to either side and feel which is harder",
    formula: "tau = -k max(side x, 0) side, x from springref; joints as for stiffness",
    source: "linear spring that only pulls",
    mjcf: None,
    in_picture_plane: false,
};

/// The springs.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    axles: Vec<Axle<S::T>>,
    side: S::T,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, model: &Model<S::T>, _: &Plant<S>) -> Self {
        Self { axles: sizes(values, model, [0, 1], true), side: values.one(2) }
    }

    #[inline(always)]
    fn forces(&self, qpos: &[S::T], _: &[S::T], force: &mut [S::T]) {
        for axle in &self.axles {
            let deflection = (self.side * (qpos[axle.q] - axle.slack)).max(S::T::ZERO);
            force[axle.dof] -= axle.size * deflection * self.side;
        }
    }

    #[inline(always)]
    fn slopes(&self, qpos: &[S::T], _: &[S::T], _: &mut [S::T], stiffness: &mut [S::T]) {
        for axle in &self.axles {
            let pulls = S::T::ZERO.less(self.side * (qpos[axle.q] - axle.slack));
            stiffness[axle.dof] += S::T::select(pulls, axle.size, S::T::ZERO);
        }
    }
}
