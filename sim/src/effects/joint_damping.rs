//! `joint_damping`: the hinges resist in proportion to their rate.

use super::joints::sizes;
use super::{Effect, Info, Kind, Mjcf, ParameterInfo, Per, Role};
use crate::model::Model;
use crate::scalar::Scalar;

pub(crate) const INFO: Info = Info {
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
    formula: "tau = -d w",
    source: "linear damper; w is the rate between the two bodies, not against the water",
    mjcf: Some(Mjcf { how: "joint damping", exact: |_| true, fold: alter }),
    in_picture_plane: false,
};

/// The joints' linear damping.
pub(crate) fn alter<T: Scalar>(effect: &Effect<T>, model: &mut Model<T>) {
    for axle in sizes(effect, model, [0, 1], false) {
        let [linear, ..] = &mut model.joints[axle.joint].damping;
        *linear += axle.size;
    }
}
