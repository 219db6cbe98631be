//! `servo_refresh`: the servo looks at its command every so often.

use std::f64::consts::TAU;

use crate::causes::drive::stage::{Following, Piece, Pieces, Stage, StageState};
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Role};
use crate::scalar::{Mask, Scalar};

/// Shortest and longest refresh period \[s\]: from servos that are commanded 250 times a second to 20 times.
const PERIOD_RANGE_S: [f64; 2] = [0.004, 0.05];
/// Default time in which a servo turns by the change of its command \[s\] (chosen).
const TURN_DEFAULT_S: f64 = 0.003;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "servo_refresh",
    kind: Kind::Drive,
    parameters: &[
        ParameterInfo::size("share", "1", [0.0, 1.0], 1.0, "1 for now and then, 0 for all the time")
            .role(Role::Switch, 0.0),
        ParameterInfo::size("period", "s", PERIOD_RANGE_S, 0.005, "time from one look to the next")
            .role(Role::Hidden(&[0.02]), 0.02),
        ParameterInfo::size("first", "1", [-1.0, 2.0], 0.25, "when it looks, after time 0, in periods")
            .role(Role::Hidden(&[0.0]), 0.0),
        ParameterInfo::size("turn", "s", [5e-4, 0.02], 0.002, "how long it takes to where it has seen")
            .role(Role::Hidden(&[TURN_DEFAULT_S]), TURN_DEFAULT_S),
    ],
    aliases: &[],
    sentence: "the servo looks at its command every so often, and stands in between",
    check: "turn the servo slowly and film the horn at a high rate: it goes in steps",
    formula: "the command at the last of the times (f + k) T, reached evenly within the time to turn",
    source: "sample and hold: the frames of a pulse train, the cycle of a bus",
    mjcf: None,
    in_picture_plane: false,
};

/// Longest piece of a command, so that it holds at most one read, and longest step \[s\]: half the shortest refresh period.
const PIECE_MAX_S: f64 = 0.002;
/// A read that rounding puts later than its instant by less than this counts as in time \[periods\] (chosen).
const READ_TIME_ROUNDING_PERIODS: f64 = 1e-9;

/// The parameters of the refresh, and its stage.
#[derive(Debug, Clone)]
pub(crate) struct Term<T> {
    share: T,
    period: T,
    first: T,
    turn: T,
}

impl<T: Scalar> Stage<T> for Term<T> {
    fn new(values: &CauseValues<T>) -> Self {
        let [share, period, first, turn] = [0, 1, 2, 3].map(|k| values.one(k));
        Self { share, period, first, turn }
    }

    fn longest_piece_s(&self) -> f64 {
        PIECE_MAX_S
    }

    fn longest_step_s(&self) -> f64 {
        if T::ZERO.less(self.share).any() { PIECE_MAX_S } else { f64::INFINITY }
    }

    /// Turns on to the command that was read last, then stands; if a read falls into the piece, turns to the new command, and stands.
    #[inline(always)]
    fn pass(&self, state: &mut StageState<T>, piece: Piece<T>, out: &mut Pieces<T>) {
        let (slope, ends) = (piece.slope(), piece.start_s + piece.duration);
        let before = self.last_look(piece.start_s);
        let looks = before.less(self.last_look(ends));
        // the last piece of all is longer than a period, and the command stands
        let look = before + self.period;
        // into the piece
        let look_after =
            T::select(looks, look - piece.start_s, piece.duration).clamp(T::ZERO, piece.duration);

        let left = (before + self.turn - piece.start_s).max(T::ZERO);
        let going = left.min(look_after);
        let turns = T::ZERO.less(left);
        let part = T::select(turns, going / T::select(turns, left, T::ONE), T::ZERO);
        let there = state.end + (state.last_read - state.end) * part;

        let last_read = T::select(looks, piece.from + slope * look_after, state.last_read);
        let turning = self.turn.min(piece.duration - look_after);
        let end = there + (last_read - there) * T::select(looks, turning / self.turn, T::ZERO);

        // four in every lane, as each alone would: pieces that take no time change nothing but the rounding
        let legs = [
            (there, going),
            (there, look_after - going),
            (end, turning),
            (end, piece.duration - look_after - turning),
        ];
        let (mut at, mut reached, mut commanded) = (T::ZERO, state.end, piece.from);
        for (to, duration) in legs {
            let from = commanded + self.share * (reached - commanded);
            let start_s = piece.start_s + at;
            at += duration;
            (reached, commanded) = (to, piece.from + slope * at);
            out.push(Piece { from, to: commanded + self.share * (to - commanded), start_s, duration });
        }
        *state = StageState { end, last_read, ..*state };
    }
}

impl<T: Scalar> Term<T> {
    /// When it last looked, at `time_s`.
    #[inline(always)]
    fn last_look(&self, time_s: T) -> T {
        let looks = (time_s / self.period - self.first + T::from_f64(READ_TIME_ROUNDING_PERIODS)).floor();
        (looks + self.first) * self.period
    }
}

/// Step of the sought frequencies, over the inverse of a run's length (chosen).
const FREQUENCY_STEP_CYCLES: f64 = 0.125;
/// Least distance between peaks, over the inverse of a run's length (chosen): a peak with its flanks.
const PEAK_WIDTH_CYCLES: f64 = 2.0;
/// Number of peaks that are tried, and of phases for each (chosen).
const PEAKS_MAX: usize = 16;
const PHASES_TRIED: usize = 16;
/// Turning times that are tried \[s\] (chosen): without them a refresh period is mistaken for a shorter one with a lower sawtooth.
const TURNS_TRIED_S: [f64; 4] = [0.0005, 0.003, 0.006, 0.01];

/// Number of refresh frequencies that runs of `span_s` \[s\] can resolve.
pub(crate) fn starts(span_s: f64) -> f64 {
    (span_s * (1.0 / PERIOD_RANGE_S[0] - 1.0 / PERIOD_RANGE_S[1])).max(1.0)
}

/// Where the looks begin to explain how the driven joints followed: between two looks a joint falls behind by its rate times what has
/// passed, a saw whose frequency the product of both shows; among its highest peaks, which repeat where images are fewer than
/// looks, that at which the command last seen is nearest to the joint. A joint that is off, or late, all the time says nothing of looks.
pub(crate) fn start(followings: &[Following<'_>]) -> Vec<(&'static str, f64)> {
    let lengths = followings.iter().filter_map(|of| Some(of.time_s.last()? - of.time_s.first()?));
    let longest_s = lengths.fold(0.0, f64::max);
    if longest_s <= PERIOD_RANGE_S[1] {
        return Vec::new();
    }
    let command_rad = |of: &Following<'_>, time_s: f64| of.command.at(of.column, time_s);
    let rate = |of: &Following<'_>, t: f64| {
        (command_rad(of, t + 0.5 * PIECE_MAX_S) - command_rad(of, t - 0.5 * PIECE_MAX_S)) / PIECE_MAX_S
    };
    let runs: Vec<(&Following<'_>, Vec<f64>)> =
        followings.iter().map(|of| (of, centred(of.time_s.iter().map(|&t| rate(of, t)).collect()))).collect();
    let products: Vec<(f64, f64)> = runs
        .iter()
        .flat_map(|(of, rates)| {
            let ahead = prompt(of.ahead_rad.clone(), rates);
            of.time_s
                .iter()
                .zip(ahead)
                .zip(rates)
                .map(|((&t, ahead), rate)| (t, ahead * rate))
                .collect::<Vec<_>>()
        })
        .collect();
    let height = |frequency: f64| {
        let turned = products.iter().map(|(t, product)| {
            let (sin, cos) = (TAU * frequency * t).sin_cos();
            (product * cos, product * sin)
        });
        let (x, y) = turned.fold((0.0, 0.0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
        f64::hypot(x, y)
    };
    let step = FREQUENCY_STEP_CYCLES / longest_s;
    let [most, least] = PERIOD_RANGE_S.map(f64::recip);
    let mut heights: Vec<(f64, f64)> = (0..=((most - least) / step) as usize)
        .map(|k| least + k as f64 * step)
        .map(|frequency| (frequency, height(frequency)))
        .collect();
    heights.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut peaks: Vec<f64> = Vec::new();
    for (frequency, _) in heights {
        let is_apart = peaks.iter().all(|peak| (peak - frequency).abs() > PEAK_WIDTH_CYCLES / longest_s);
        if is_apart && peaks.len() < PEAKS_MAX {
            peaks.push(frequency);
        }
    }
    let misfit = |frequency: f64, first: f64, turn: f64| -> f64 {
        let squares = runs.iter().map(|(of, rates)| {
            let left = of.time_s.iter().zip(&of.ahead_rad).map(|(&t, ahead)| {
                let look = ((t * frequency - first).floor() + first) / frequency;
                let [before, last_read] = [look - frequency.recip(), look].map(|look| command_rad(of, look));
                let there = ((t - look) / turn).min(1.0);
                ahead - (before + there * (last_read - before) - command_rad(of, t))
            });
            prompt(left.collect(), rates).iter().map(|x| x * x).sum::<f64>()
        });
        squares.sum()
    };
    let near = |frequency: &f64| [-0.5, 0.0, 0.5].map(|part| frequency + part * step);
    let phases = || (0..PHASES_TRIED).map(|k| k as f64 / PHASES_TRIED as f64);
    let all = peaks.iter().flat_map(near).flat_map(|frequency| phases().map(move |first| (frequency, first)));
    let all = all.flat_map(|(frequency, first)| {
        let turns = TURNS_TRIED_S.into_iter().filter(move |turn| turn * frequency <= 1.0);
        turns.map(move |turn| (frequency, first, turn))
    });
    let best = all
        .map(|(frequency, first, turn)| (misfit(frequency, first, turn), frequency, first, turn))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or(Vec::new(), |(_, frequency, first, turn)| {
        vec![("period", frequency.recip()), ("first", first), ("turn", turn)]
    })
}

/// `values` less their mean.
fn centred(mut values: Vec<f64>) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter_mut().for_each(|x| *x -= mean);
    values
}

/// What is left of `angles` without an offset and without lateness, which is a multiple of the centred `rates`.
fn prompt(angles: Vec<f64>, rates: &[f64]) -> Vec<f64> {
    let mut angles = centred(angles);
    let along: f64 = angles.iter().zip(rates).map(|(angle, rate)| angle * rate).sum();
    let squares: f64 = rates.iter().map(|rate| rate * rate).sum();
    if squares > 0.0 {
        angles.iter_mut().zip(rates).for_each(|(angle, rate)| *angle -= along / squares * rate);
    }
    angles
}
