//! `drive_offset`: the motors push beside what they are told.

use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Per};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "drive_offset",
    kind: Kind::Drive,
    parameters: &[ParameterInfo::size(
        "",
        "N m",
        [-100.0, 100.0],
        1e-3,
        "torque of a motor beside its command, on its joint",
    )
    .each(Per::Motor)
    .may_differ()],
    aliases: &[],
    sentence: "a motor pushes beside what it is told",
    check: "command no torque, or hold the joint where it balances, and read the current",
    formula: "tau = tau_cmd + offset, on the joint; on a slide in N",
    source: "definition: an amplifier's or a current sensor's zero; none where the motor is off. A drive that holds an angle would hold another one, which is joint_zero",
    mjcf: None,
    in_picture_plane: false,
};

/// Offsets of the motors.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    let motors: Vec<usize> = model.motors().map(|(place, _)| place).collect();
    for (motor, &offset) in motors.into_iter().zip(values.each(0)) {
        model.actuators[motor].gearmotor.get_or_insert_default().offset += offset;
    }
}
