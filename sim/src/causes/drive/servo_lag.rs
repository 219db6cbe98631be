//! `servo_lag`: the servo follows like a first-order filter.

use crate::causes::drive::stage::{Piece, Pieces, Stage, StageState};
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "servo_lag",
    kind: Kind::Drive,
    parameters: &[ParameterInfo::size("time", "s", [0.0, 0.5], 0.02, "time constant")],
    aliases: &[],
    sentence: "the servo follows its command sluggishly",
    check: "command a step, film the horn and see whether it creeps into its end",
    formula: "1 / (1 + tau s)",
    source: "first-order lag, exact on straight pieces of the command",
    mjcf: None,
    in_picture_plane: false,
};

/// A lag below this counts as none \[s\] (chosen).
const LAG_MIN_S: f64 = 1e-9;
/// Decay is computed up to this many time constants (chosen): what is left then is rounding.
const DECAY_MAX_TIME_CONSTANTS: f64 = 50.0;

/// The filter.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    time: T,
}

impl<T: Scalar> Stage<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        Self { time: values.one(0) }
    }

    /// y = x - m tau + (y0 - x0 + m tau) exp(-t / tau) on a piece of slope m. At tau = 0 the exponential has died, with
    /// all its derivatives, and what remains has the slope -m by tau.
    #[inline(always)]
    fn pass(&self, state: &mut StageState<T>, piece: Piece<T>, out: &mut Pieces<T>) {
        let instant = T::from_f64(LAG_MIN_S);
        let time = T::select(self.time.less(instant), instant, self.time);
        let left = (-(piece.duration / time).min(T::from_f64(DECAY_MAX_TIME_CONSTANTS))).exp();
        let behind = piece.slope() * self.time;
        let from = state.end;
        let to = piece.to - behind + (from - piece.from + behind) * left;
        state.end = to;
        out.push(Piece { from, to, ..piece });
    }
}
