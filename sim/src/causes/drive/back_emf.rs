//! `back_emf`: the motor pushes no harder than its supply lets it, and less the quicker it turns.

use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Role};
use crate::scalar::Scalar;

/// As strong as no motor in a tank \[N m\]: no ceiling.
const NO_CEILING: f64 = 1e4;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "back_emf",
    kind: Kind::Drive,
    parameters: &[
        ParameterInfo::size(
            "stall",
            "N m",
            [1e-4, NO_CEILING],
            1.0,
            "torque of every drive at rest with all of its supply, k V / R (0.52 for a Dynamixel XL330, 1 to 3 for hobby servos)",
        )
        .role(Role::Detail, NO_CEILING),
        ParameterInfo::size(
            "braking",
            "N m s/rad",
            [0.0, 1e3],
            1e-3,
            "torque of every drive against its rate while it is on, k^2 / R: stall torque over no-load rate",
        )
        .role(Role::Detail, 0.0),
        ParameterInfo::size(
            "supply",
            "1",
            [0.0, 5.0],
            0.2,
            "resistance of supply and cable over the motor's: by how much the voltage gives way at full duty",
        )
        .role(Role::Detail, 0.0),
    ],
    aliases: &[],
    sentence: "the motor pushes no harder than its supply lets it, and less the quicker it turns",
    check: "hang a weight on the horn, command a step and film how fast it rises; turn the horn by hand with the servo on and off",
    formula: "tau = (d stall - b w) / (1 + s d^2), d = clamp(what the drive is told to exert on its joint / stall, -1, 1); k: torque constant, V: supply, R: resistance, stall = k V / R, b = k^2 / R, s = R_supply / R",
    source: "direct current motor without inductance, duty cycle in proportion to the error; on a slide in N and N s/m. An idle motor does not brake",
    mjcf: None,
    in_picture_plane: false,
};

/// Ceiling and braking of the drives.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    for actuator in &mut model.actuators {
        let motor = actuator.gearmotor.get_or_insert_default();
        motor.stall = Some(values.one(0));
        motor.braking += values.one(1);
        motor.supply += values.one(2);
    }
}
