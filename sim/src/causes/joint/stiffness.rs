//! `stiffness`: the joints between links spring back.

use crate::causes::joint::axles::sizes;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, Mjcf, ParameterInfo, Per, Role};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "stiffness",
    kind: Kind::Joint,
    parameters: &[
        ParameterInfo::size(
            "stiffness",
            "N m/rad",
            [0.0, 1.0],
            5e-5,
            "added stiffness of every joint between links",
        ),
        ParameterInfo::size("", "N m/rad", [0.0, 1.0], 5e-5, "the same for one joint alone, added to it")
            .each(Per::Joint)
            .role(Role::Detail, 0.0),
    ],
    aliases: &[],
    sentence: "something springs the joints back: a cable, a cover, glue",
    check: "turn each hinge by hand in air and see whether it springs back",
    formula: "tau = -k x, x from springref; without the joints on the tank's frame, where there are others",
    source: "linear spring",
    mjcf: Some(Mjcf { how: "joint stiffness", exact: |_| true, fold: alter }),
    in_picture_plane: false,
};

/// The joints' linear stiffness.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    for axle in sizes(values, model, [0, 1], true) {
        let [linear, ..] = &mut model.joints[axle.joint].stiffness;
        *linear += axle.size;
    }
}
