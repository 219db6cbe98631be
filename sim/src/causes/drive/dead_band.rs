//! `dead_band`: the servo does nothing about small errors.

use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "dead_band",
    kind: Kind::Drive,
    parameters: &[ParameterInfo::size(
        "half_width",
        "rad",
        [0.0, 0.3],
        0.01,
        "error up to which no drive does anything (hobby servos: 2 to 8 us of pulse, 4 to 14 mrad)",
    )],
    aliases: &[],
    sentence: "the servo does nothing about small errors",
    check: "push the horn to either side while the servo holds and measure how far it gives before it fights back",
    formula: "tau = kp (e - clamp(e, -b, b)), e = q_cmd - q; of drives that hold an angle",
    source: "definition; exact. On a slide in m",
    mjcf: None,
    in_picture_plane: false,
};

/// Dead bands of the drives.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    for actuator in &mut model.actuators {
        actuator.gearmotor.get_or_insert_default().dead_band += values.one(0);
    }
}
