//! `servo_sag`: the servo's reach drifts while a run lasts.

use crate::causes::drive::stage::{Piece, Pieces, Stage, StageState};
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "servo_sag",
    kind: Kind::Drive,
    parameters: &[ParameterInfo::size(
        "rate",
        "1/s",
        [-0.5, 0.5],
        0.03,
        "share of its angle that the servo loses a second",
    )],
    aliases: &[],
    sentence: "the servo's reach sags while the run lasts: its supply falls, or it slips",
    check: "measure the servo's supply while it moves, and its horn's angle at the same command early and late",
    formula: "(1 - r t) q_cmd, t since the run's start",
    source: "the first term of any drift; about the command 0",
    mjcf: None,
    in_picture_plane: false,
};

/// The drift.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    rate: T,
}

impl<T: Scalar> Stage<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        Self { rate: values.one(0) }
    }

    /// Exact at the ends of the piece, which are where a command has its rows and where somebody asks; in between it bends, and counts
    /// as straight for the stages behind.
    #[inline(always)]
    fn pass(&self, state: &mut StageState<T>, piece: Piece<T>, out: &mut Pieces<T>) {
        let left = T::ONE - self.rate * piece.start_s;
        let from = piece.from * left;
        let to = piece.to * (left - self.rate * piece.duration);
        state.end = to;
        out.push(Piece { from, to, ..piece });
    }
}
