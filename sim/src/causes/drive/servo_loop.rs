//! `servo_loop`: the servo follows like a mass on a spring.

use crate::causes::drive::stage::{Piece, Pieces, Stage, StageState};
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Role};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "servo_loop",
    kind: Kind::Drive,
    parameters: &[
        ParameterInfo::size(
            "time",
            "s",
            [0.0, 0.2],
            0.01,
            "reciprocal of the natural frequency, in radians a second: 1 / (2 pi f) (0.01 to 0.03 for hobby servos)",
        ),
        ParameterInfo::size("damping_ratio", "1", [0.05, 2.0], 0.3, "1: just no overshoot; 0.3 to 0.8 usual")
            .role(Role::Hidden(&[0.3]), 0.5),
    ],
    aliases: &[],
    sentence: "the servo follows its command like a mass on a spring, and overshoots",
    check: "command a step and film the horn: it swings beyond its end and back",
    formula: "1 / (1 + 2 z T s + T^2 s^2)",
    source: "second-order loop (K. Ogata, Modern Control Engineering, section 5.3), exact on straight pieces of the command; a ceiling of rate is servo_rate_limit's, before it",
    mjcf: None,
    in_picture_plane: false,
};

/// A time below this counts as none \[s\] (chosen).
const TIME_MIN_S: f64 = 1e-9;
/// The transient is computed up to this many reciprocal natural frequencies (chosen): at the least damping ratio it is then 1e-22 of its
/// start, less than rounding.
const TRANSIENT_MAX: f64 = 1000.0;
/// Up to this size of (z^2 - 1) (t / T)^2 series stand in for the circular and the hyperbolic functions (chosen): the first term left out is below 1e-17.
const SERIES_MAX: f64 = 0.5;
/// Terms of these series beyond the first.
const SERIES_TERMS: usize = 8;

/// The loop.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    time: T,
    damping_ratio: T,
}

impl<T: Scalar> Term<T> {
    /// What the transient keeps after `s` reciprocal natural frequencies: exp(-z s) cosh(r s) and exp(-z s) sinh(r s) / r, r^2 = z^2 - 1.
    #[inline(always)]
    fn kept(&self, s: T) -> (T, T) {
        let (one, half) = (T::ONE, T::from_f64(0.5));
        let z = self.damping_ratio;
        let square = z * z - one;
        let x = square * s * s;
        let near = x.abs().less(T::from_f64(SERIES_MAX));

        // each of the three stands on numbers of its own kind, whichever counts
        let small = T::select(near, x, T::ZERO);
        let (mut cos, mut sin, mut even, mut odd) = (one, one, one, one);
        for k in 0..SERIES_TERMS {
            let k = k as f64;
            even = even * small * T::from_f64(1.0 / ((2.0 * k + 2.0) * (2.0 * k + 1.0)));
            odd = odd * small * T::from_f64(1.0 / ((2.0 * k + 3.0) * (2.0 * k + 2.0)));
            cos += even;
            sin += odd;
        }
        let faded = (-(z * s)).exp();
        let by_series = (faded * cos, faded * sin * s);

        let over = T::ZERO.less(square);
        let root = T::select(near, one, square.abs()).sqrt();
        let (sin, cos) = (root * s).sin_cos();
        let by_circle = (faded * cos, faded * sin / root);

        // slow and quick mode; with the slow one's rate without cancellation
        let quick = T::select(over, z, one) + root;
        let (slow_left, quick_left) = ((-(s / quick)).exp(), (-(s * quick)).exp());
        let by_modes = ((slow_left + quick_left) * half, (slow_left - quick_left) * half / root);

        let choose = |series, circle, modes| T::select(near, series, T::select(over, modes, circle));
        (choose(by_series.0, by_circle.0, by_modes.0), choose(by_series.1, by_circle.1, by_modes.1))
    }
}

impl<T: Scalar> Stage<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        Self { time: values.one(0), damping_ratio: values.one(1) }
    }

    /// On a piece of slope m the output goes to x - 2 z T m; how far it is from there, and its rate, swing and fade.
    #[inline(always)]
    fn pass(&self, state: &mut StageState<T>, piece: Piece<T>, out: &mut Pieces<T>) {
        let instant = T::from_f64(TIME_MIN_S);
        let time = T::select(self.time.less(instant), instant, self.time);
        let z = self.damping_ratio;
        let slope = piece.slope();
        let behind = slope * self.time * (z + z);
        let from = state.end;
        // in reciprocal natural frequencies from here on
        let s = (piece.duration / time).min(T::from_f64(TRANSIENT_MAX));
        let (off, off_rate) = (from - piece.from + behind, (state.rate - slope) * time);
        let (even, odd) = self.kept(s);
        let to = piece.to - behind + even * off + odd * (z * off + off_rate);
        state.rate = slope + (even * off_rate - odd * (off + z * off_rate)) / time;
        state.end = to;
        out.push(Piece { from, to, ..piece });
    }
}
