//! `backlash`: play between the servo and the joint.

use crate::causes::drive::stage::{Piece, Pieces, Stage, StageState};
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "backlash",
    kind: Kind::Joint,
    parameters: &[ParameterInfo::size("half_width", "rad", [0.0, 0.3], 0.01, "half the play")],
    aliases: &[],
    sentence: "there is play between the servo and the joint",
    check: "hold the command, turn the horn by hand and measure how far it gives",
    formula: "q stays until q_cmd is b away, then follows at that distance",
    source: "the play operator, exact on straight pieces of the command; in the middle of its play before the first row",
    mjcf: None,
    in_picture_plane: false,
};

/// The play.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    half_width: T,
}

impl<T: Scalar> Stage<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        Self { half_width: values.one(0) }
    }

    /// Stays until the piece has crossed the play, then goes with it.
    #[inline(always)]
    fn pass(&self, state: &mut StageState<T>, piece: Piece<T>, out: &mut Pieces<T>) {
        let start = state.end;
        let end = start.clamp(piece.to - self.half_width, piece.to + self.half_width);
        let slope = piece.slope();
        let (up, down) = (T::ZERO.less(slope), slope.less(T::ZERO));
        let moves = up | down;
        let ahead = T::select(up, self.half_width, -self.half_width);
        let still = (start + ahead - piece.from) / T::select(moves, slope, T::ONE);
        let still = T::select(moves, still, piece.duration).clamp(T::ZERO, piece.duration);
        state.end = end;
        out.push(Piece { from: start, to: start, duration: still, ..piece });
        out.push(Piece {
            from: start,
            to: end,
            start_s: piece.start_s + still,
            duration: piece.duration - still,
        });
    }
}
