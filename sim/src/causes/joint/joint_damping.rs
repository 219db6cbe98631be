//! `joint_damping`: the hinges resist in proportion to their rate.

use crate::causes::joint::axles::sizes;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, Mjcf, ParameterInfo, Per, Role};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "joint_damping",
    kind: Kind::Joint,
    parameters: &[
        ParameterInfo::size("damping", "N m s/rad", [0.0, 1e-2], 1e-6, "added damping of every hinge"),
        ParameterInfo::size("", "N m s/rad", [0.0, 1e-2], 1e-6, "the same for one hinge alone, added to it")
            .each(Per::Joint)
            .role(Role::Detail, 0.0),
    ],
    aliases: &[],
    sentence: "the hinges are more viscous than the model says",
    check: "swing each hinge alone in air and watch it die away",
    formula: "tau = -d w",
    source: "linear damper; w is the rate between the two bodies, not against the water",
    mjcf: Some(Mjcf { how: "joint damping", exact: |_| true, fold: alter }),
    in_picture_plane: false,
};

/// The joints' linear damping.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    for axle in sizes(values, model, [0, 1], false) {
        let [linear, ..] = &mut model.joints[axle.joint].damping;
        *linear += axle.size;
    }
}
