//! `servo_gain`: the servo goes further or less far than told.

use crate::causes::drive::stage::{Piece, Pieces, Stage, StageState};
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, Mjcf, ParameterInfo};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "servo_gain",
    kind: Kind::Drive,
    parameters: &[ParameterInfo::size(
        "scale",
        "1",
        [-2.5, 0.5],
        0.02,
        "error of the angle, as a share of it; -2: the other way, or the picture is mirrored",
    )],
    aliases: &[],
    sentence: "the servo goes further, or less far, than it was told, or the other way",
    check: "command plus and minus 30 degrees and measure the horn's angles with a protractor",
    formula: "(1 + g) q_cmd",
    source: "definition; about the command 0",
    mjcf: Some(Mjcf { how: "actuator gear, kp, kv, forcerange", exact: |_| true, fold }),
    in_picture_plane: false,
};

/// `range` times `factor`, which may turn it round.
fn scaled(range: [f64; 2], factor: f64) -> [f64; 2] {
    let [a, b] = range.map(|force| force * factor);
    [a.min(b), a.max(b)]
}

/// A gear of 1 / (1 + g) asks for the angle (1 + g) c; gains and force range make up for it.
fn fold(values: &CauseValues<f64>, model: &mut Model<f64>) {
    let gain = 1.0 + values.one(0);
    for actuator in &mut model.actuators {
        match actuator.kind {
            crate::model::ActuatorKind::Motor => {
                actuator.gear *= gain;
                actuator.force_range = actuator.force_range.map(|range| scaled(range, 1.0 / gain));
            }
            crate::model::ActuatorKind::Position | crate::model::ActuatorKind::Velocity => {
                actuator.gear /= gain;
                actuator.kp *= gain * gain;
                actuator.kv *= gain * gain;
                actuator.force_range = actuator.force_range.map(|range| scaled(range, gain));
            }
        }
        // what MuJoCo keeps in range is the command before the gear
        actuator.command_range = actuator.command_range.map(|range| scaled(range, 1.0 / gain));
    }
}

/// The factor.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    factor: T,
}

impl<T: Scalar> Stage<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        Self { factor: T::ONE + values.one(0) }
    }

    #[inline(always)]
    fn steady(&self, command: T) -> T {
        command * self.factor
    }

    #[inline(always)]
    fn pass(&self, state: &mut StageState<T>, piece: Piece<T>, out: &mut Pieces<T>) {
        let scaled = Piece { from: piece.from * self.factor, to: piece.to * self.factor, ..piece };
        state.end = scaled.to;
        out.push(scaled);
    }
}
