//! `servo_rate_limit`: the servo cannot turn faster than a rate.

use crate::causes::drive::stage::{Piece, Pieces, Stage, StageState};
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Role};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "servo_rate_limit",
    kind: Kind::Drive,
    parameters: &[
        ParameterInfo::size("share", "1", [0.0, 1.0], 1.0, "1 for limited, 0 for not")
            .role(Role::Switch, 0.0),
        ParameterInfo::size("rate", "rad/s", [0.05, 100.0], 0.5, "greatest rate")
            .role(Role::Hidden(&[0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0]), 6.0),
    ],
    aliases: &[],
    sentence: "the servo is not fast enough for the stroke",
    check: "command a step, film the horn and see how fast it turns",
    formula: "dq/dt = clamp(towards q_cmd, -r, r)",
    source: "definition; exact on straight pieces of the command",
    mjcf: None,
    in_picture_plane: false,
};

/// The limit.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    share: T,
    rate: T,
}

impl<T: Scalar> Stage<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        Self { share: values.one(0), rate: values.one(1) }
    }

    /// Until it has caught up it turns at the greatest rate, from then on with the piece, as fast as it can.
    #[inline(always)]
    fn pass(&self, state: &mut StageState<T>, piece: Piece<T>, out: &mut Pieces<T>) {
        let (start, slope) = (state.end, piece.slope());
        let gap = piece.from - start;
        let behind = gap.less(T::ZERO);
        let sign = T::select(behind, -T::ONE, T::ONE);
        let closing = self.rate - slope * sign;
        let catches = T::ZERO.less(closing);
        let chase = gap.abs() / T::select(catches, closing, T::ONE);
        let chase = T::select(catches, chase, piece.duration).min(piece.duration);
        let met = start + sign * self.rate * chase;
        let rest = piece.duration - chase;
        let end = met + slope.clamp(-self.rate, self.rate) * rest;
        let corner = piece.from + slope * chase;
        state.end = end;
        let from = piece.from + self.share * (start - piece.from);
        let over = corner + self.share * (met - corner);
        let to = piece.to + self.share * (end - piece.to);
        out.push(Piece { from, to: over, duration: chase, ..piece });
        out.push(Piece { from: over, to, start_s: piece.start_s + chase, duration: rest });
    }
}
