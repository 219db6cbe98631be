//! `tether`: a cable pulls at the tip.

use crate::causes::hooks::{Moment, Step};
use crate::causes::water::shapes::force_at;
use crate::dynamics::Work;
use crate::dynamics::plant::Plant;
use crate::math::Vec3;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Role};
use crate::scalar::Scalar;
use crate::space::Space;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "tether",
    kind: Kind::Tether,
    parameters: &[
        ParameterInfo::size("stiffness", "N/m", [0.0, 10.0], 5e-3, "stiffness of the cable"),
        ParameterInfo::size("x", "m", [-1.0, 1.0], 0.02, "where it is anchored, to the right of the origin")
            .role(Role::Hidden(&[-0.1, -0.05, 0.0, 0.05, 0.1]), 0.05),
        ParameterInfo::size("z", "m", [-1.0, 1.0], 0.02, "where it is anchored, above the origin")
            .role(Role::Hidden(&[-0.1, 0.0, 0.05, 0.1]), 0.05),
    ],
    aliases: &[],
    sentence: "a cable pulls at the tip",
    check: "look for a cable, line or hair that pulls, and cut or loosen it",
    formula: "F = k (anchor - tip), at the last keypoint",
    source: "linear spring of no length; the cable's own drag is not counted",
    mjcf: None,
    in_picture_plane: true,
};

/// The cable; nothing in a model without keypoints.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    /// Body and place on it.
    tip: Option<(usize, S::Vec)>,
    stiffness: S::T,
    anchor: S::Vec,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, model: &Model<S::T>, plant: &Plant<S>) -> Self {
        let tip = model.keypoint_sites().last().map(|&site| &model.sites[site]);
        Self {
            tip: tip.map(|site| (site.body, S::vector(&plant.layout, site.body, site.pos))),
            stiffness: values.one(0),
            anchor: S::vector(&plant.layout, 0, Vec3([values.one(1), S::T::ZERO, values.one(2)])),
        }
    }

    #[inline(always)]
    fn wrenches(&self, _: Moment, plant: &Plant<S>, work: &mut Work<S>, _: &mut [S::Vec]) {
        if let Some((body, own)) = self.tip {
            let tip = work.pos[body] + S::apply(&work.rot[body], own);
            let force = (self.anchor - tip) * self.stiffness;
            work.wrench[body] += force_at(force, tip - work.pos[plant.links[body].root]);
        }
    }
}
