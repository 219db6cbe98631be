//! `drive_offset`: the drives push beside what they are told.

use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Per, Role};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "drive_offset",
    kind: Kind::Drive,
    parameters: &[
        ParameterInfo::size(
            "torque",
            "N m",
            [-100.0, 100.0],
            1e-3,
            "torque of every drive beside its command",
        )
        .may_differ(),
        ParameterInfo::size("", "N m", [-100.0, 100.0], 1e-3, "the same for one drive alone, added to it")
            .each(Per::Drive)
            .role(Role::Detail, 0.0)
            .may_differ(),
    ],
    aliases: &[],
    sentence: "the drives push beside what they are told",
    check: "command no torque, or hold each joint where it balances, and read the current",
    formula: "tau = tau_cmd + offset, on the joint; on a slide in N",
    source: "definition: an amplifier's or a current sensor's zero; none where the motor is off",
    mjcf: None,
    in_picture_plane: false,
};

/// Offsets of the drives.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    for (actuator, &own) in model.actuators.iter_mut().zip(values.each(1)) {
        actuator.gearmotor.get_or_insert_default().offset += values.one(0) + own;
    }
}
