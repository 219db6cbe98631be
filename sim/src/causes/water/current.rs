//! `current`: the water moves past steadily.

use crate::math::Vec3;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, Mjcf, ParameterInfo};
use crate::scalar::Scalar;

const BOUNDS_M_PER_S: [f64; 2] = [-0.5, 0.5];

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "current",
    kind: Kind::Physics,
    parameters: &[
        ParameterInfo::size("x", "m/s", BOUNDS_M_PER_S, 0.01, "velocity of the water to the right")
            .may_differ(),
        ParameterInfo::size("z", "m/s", BOUNDS_M_PER_S, 0.01, "velocity of the water upwards").may_differ(),
    ],
    aliases: &[],
    sentence: "the water flows past at a steady speed",
    check: "hang a thread or let a drop of dye fall beside the mechanism: still water leaves it straight",
    formula: "v -> v - u in every force of the water",
    source: "MuJoCo's `wind`; one velocity everywhere, no boundary layer",
    mjcf: Some(Mjcf { how: "option wind", exact: |_| true, fold: alter }),
    in_picture_plane: true,
};

/// The water's velocity.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    model.settings.wind += Vec3([values.one(0), T::ZERO, values.one(1)]);
}
