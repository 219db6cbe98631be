//! `gear_friction`: the gear rubs in proportion to what it bears, another share driving and driven.

use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Role};
use crate::model::{LoadFriction, Model};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "gear_friction",
    kind: Kind::Drive,
    parameters: &[
        ParameterInfo::size(
            "driving",
            "1",
            [0.0, 0.95],
            0.2,
            "share of the motor's torque that is lost where it turns the joint, 1 less efficiency: 0.05 to 0.15 a stage of spur gears",
        ),
        ParameterInfo::size(
            "driven",
            "1",
            [0.0, 5.0],
            0.2,
            "the same where the joint turns the motor; from 1 on the gear locks itself",
        ),
        ParameterInfo::size("rate", "rad/s", [1e-3, 1.0], 0.05, "rate over which friction turns round")
            .role(Role::Hidden(&[0.02]), 0.02),
    ],
    aliases: &[],
    sentence: "the gear rubs the more, the harder the motor pushes",
    check: "lift a weight slowly with the servo and let it sink as slowly: half of the difference in current is friction; repeat with another weight",
    formula: "tau = -e |tau_m| w / sqrt(w^2 + rate^2), e one share where tau_m w > 0, another where it is below",
    source: "gears of constant efficiency (VDI 2158; Duclusaud et al., ICRA 2025, for servos); constant and Stribeck friction are coulomb_friction's. Creeps instead of sticking; the rotor's own inertia torque is not counted as load",
    mjcf: None,
    in_picture_plane: false,
};

/// Friction of the drives' gears.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    for actuator in &mut model.actuators {
        actuator.gearmotor.get_or_insert_default().friction =
            Some(LoadFriction { driving: values.one(0), driven: values.one(1), rate: values.one(2) });
    }
}
