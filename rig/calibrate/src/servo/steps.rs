//! Lag, rate limit, refresh period and delay, from every move of the film.
//!
//! A servo that reads its pulse once a refresh period starts late by the rest of that period: moves at unrelated times are late by different
//! parts of it. Starting from the periods that explain this best, all parameters are fitted together, with and without a rate limit, with and
//! without a refresh period; what does not clearly improve the fit is left out.

use std::ops::Range;

use ground::statistics::{MEDIAN_TO_SIGMA, median};

use super::Film;
use super::error::ServoCalibrateError;
use super::law::Law;
use super::least_squares::{Solution, solve};
use super::levels::Levels;
use super::rests::{Stand, stands};

/// An estimate and its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The estimated value.
    pub value: f64,
    /// Its standard error.
    pub std: f64,
}

/// How a servo follows its command.
#[derive(Debug, Clone, PartialEq)]
pub struct Dynamics {
    /// Time constant \[s\].
    pub lag_s: Estimate,
    /// Delay from the pulse to the picture, in addition to the lag \[s\]: servo, board and camera together.
    pub delay_s: Estimate,
    /// Fastest turn \[rad/s\]; none where it was never reached.
    pub rate_limit_rad_per_s: Option<Estimate>,
    /// Refresh period: time from one look at the pulse to the next \[s\]; none where it is too short to be found.
    pub refresh_s: Option<Estimate>,
    /// Fastest rate of the command \[rad/s\].
    pub command_rad_per_s: f64,
    /// Root mean square of measured minus modelled angle \[rad\].
    pub rms_rad: f64,
}

/// Fewest images of the motion (chosen).
const IMAGES_MIN: usize = 100;
/// Start values that are tried (chosen): lags \[s\], delays \[s\], and rate limits as shares of the fastest command.
const START_LAGS_S: [f64; 6] = [0.003, 0.007, 0.015, 0.03, 0.06, 0.12];
const START_DELAYS_S: [f64; 8] = [-0.02, -0.01, 0.0, 0.01, 0.02, 0.03, 0.05, 0.07];
const START_RATE_SHARES: [f64; 5] = [0.3, 0.45, 0.6, 0.75, 0.9];
/// Rate that stands for no limit \[rad/s\] (chosen).
const RATE_UNLIMITED_RAD_PER_S: f64 = 1e4;
/// Least and greatest lag of a fit \[s\] (chosen).
const LAG_RANGE_S: [f64; 2] = [2e-4, 1.0];
/// Refresh periods that are sought \[s\] (chosen).
const PERIOD_RANGE_S: [f64; 2] = [0.004, 0.05];
/// Step of the sought frequencies, as a share of the inverse of the film's length, and number of phases tried for each (both chosen).
const FREQUENCY_STEP: f64 = 0.25;
const PHASE_STEPS: usize = 10;
/// Moves of no more than this share of the travel are over before the servo has read its pulse twice, so that they show when it reads; and
/// fewest of them (both chosen).
const SMALL_MOVE_SHARE: f64 = 0.1;
const SMALL_MOVES_MIN: usize = 6;
/// Images within about this time of a move's start are used to find the refresh period \[s\] (chosen).
const MOVE_WINDOW_S: f64 = 0.2;
/// Number of starts that are fitted; with a refresh period, number of periods tried on the whole film, steps of the frequency to either side
/// of each, and changes of the delay \[s\] (all chosen).
const STARTS_FOLLOWED: usize = 4;
const PERIODS_TRIED: usize = 30;
const FREQUENCY_STEPS_EACH_SIDE: i32 = 6;
const DELAY_OFFSETS_S: [f64; 5] = [-0.002, -0.001, 0.0, 0.001, 0.002];
/// A period is a rival of the best one where it gains this share of the best one's improvement (chosen).
const RIVAL_GAIN_SHARE: f64 = 0.85;
/// A servo that turns by less than this from image to image stands still \[rad\] (chosen).
const STILL_RAD: f64 = 1e-5;
/// A further parameter must reduce the sum of squares to less than this share (chosen).
const SQUARES_RATIO_MAX: f64 = 0.93;
/// Smallest standard errors, because the model is not quite the servo: absolute \[s\] and as shares of the value (chosen).
const LAG_STD_MIN_S: f64 = 5e-4;
const LAG_STD_SHARE_MIN: f64 = 0.03;
const DELAY_STD_MIN_S: f64 = 3e-4;
const PERIOD_STD_MIN_S: f64 = 2e-5;
const RATE_STD_SHARE_MIN: f64 = 0.02;

/// The film, prepared for the fit.
struct Steps<'a> {
    film: &'a Film,
    levels: &'a Levels,
    /// The middle of the steps: times count from there, so that a period and a phase are apart.
    middle_s: f64,
    /// Times of the images \[s\], and measured angles \[rad\].
    time_s: Vec<f64>,
    angle_rad: Vec<f64>,
    moves: Vec<Stand>,
    /// Times and angles of the images that show most of the refresh period, after a first one that only sets the start; and the range of
    /// images that they span.
    informative: (Vec<f64>, Vec<f64>),
    informative_range: Range<usize>,
    deadband_rad: f64,
}

/// Which parameters a servo model has in addition to lag and delay.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Form {
    limited: bool,
    refresh: bool,
}

struct Fitted {
    form: Form,
    law: Law,
    solution: Solution,
    /// Sum of squares and refresh period of the fits from other starts.
    others: Vec<(f64, Option<[f64; 2]>)>,
}

impl Fitted {
    /// Largest difference to a period that explains nearly as much of `plain`, the squares without a refresh period \[s\].
    fn rivals_s(&self, plain: f64) -> f64 {
        let least = plain - RIVAL_GAIN_SHARE * (plain - self.solution.squares);
        let rivals = self.others.iter().filter(|(squares, _)| *squares < least);
        let period_s = |refresh: Option<[f64; 2]>| refresh.map_or(0.0, |[period_s, _]| period_s);
        rivals.map(|(_, refresh)| (period_s(*refresh) - period_s(self.law.refresh)).abs()).fold(0.0, f64::max)
    }
}

/// How the servo follows.
pub(super) fn dynamics(
    film: &Film,
    levels: &Levels,
    may_refresh: bool,
) -> Result<Dynamics, ServoCalibrateError> {
    let steps = Steps::of(film, levels)?;
    let zone = 2.0 * levels.deadband_rad.value;
    let step = steps.step_rad();
    if zone > 0.5 * step {
        return Err(ServoCalibrateError::Loose { zone_rad: zone, step_rad: step });
    }
    let command_rad_per_s = steps.command_rad_per_s();
    let plain =
        steps.fit(Form { limited: false, refresh: false }, &steps.starts(&[RATE_UNLIMITED_RAD_PER_S]));
    let rates = START_RATE_SHARES.map(|share| share * command_rad_per_s);
    let limited = steps.fit(Form { limited: true, refresh: false }, &steps.starts(&rates));
    let smooth = better(plain, limited, |fitted| fitted.law.rate < command_rad_per_s);
    let plain_squares = smooth.solution.squares;
    if !may_refresh {
        return Ok(steps.to_dynamics(&smooth, plain_squares, command_rad_per_s));
    }
    let refreshing = steps.distinct(&steps.refreshing(&smooth));
    let best = steps.fit_refreshing(Form { refresh: true, ..smooth.form }, &refreshing);
    let in_range = |period_s: f64| (PERIOD_RANGE_S[0]..=PERIOD_RANGE_S[1]).contains(&period_s);
    let best =
        better(smooth, best, |fitted| fitted.law.refresh.is_some_and(|[period_s, _]| in_range(period_s)));
    Ok(steps.to_dynamics(&best, plain_squares, command_rad_per_s))
}

/// `other` where it `counts` and betters `one` clearly.
fn better(one: Fitted, other: Fitted, counts: impl Fn(&Fitted) -> bool) -> Fitted {
    if counts(&other) && other.solution.squares < SQUARES_RATIO_MAX * one.solution.squares {
        other
    } else {
        one
    }
}

impl<'a> Steps<'a> {
    fn of(film: &'a Film, levels: &'a Levels) -> Result<Self, ServoCalibrateError> {
        let moved = |stand: &Stand| stand.move_us.is_some_and(|us| us != 0.0);
        let moves: Vec<Stand> = stands(film).into_iter().filter(moved).collect();
        let corner_s = |corner: Option<&(f64, f64)>| corner.map_or(f64::NAN, |corner| corner.0);
        // from a tenth of a second before the command begins to half a second after it ends
        let (from_s, until_s) = (corner_s(film.command.first()) - 0.1, corner_s(film.command.last()) + 0.5);
        let middle_s = 0.5 * (from_s + until_s);
        let in_motion =
            film.time_s.iter().zip(&film.angle_rad).filter(|(t, _)| (from_s..until_s).contains(*t));
        let (time_s, angle_rad): (Vec<f64>, Vec<f64>) =
            in_motion.map(|(t, angle)| (t - middle_s, *angle)).unzip();
        if moves.len() < 3 || time_s.len() < IMAGES_MIN {
            return Err(ServoCalibrateError::NoMoves { images: time_s.len(), least: IMAGES_MIN });
        }
        let travel_us = levels.levels[levels.levels.len() - 1].pulse_us - levels.levels[0].pulse_us;
        let is_small =
            |stand: &Stand| stand.move_us.is_some_and(|us| us.abs() <= SMALL_MOVE_SHARE * travel_us);
        let small: Vec<usize> = (0..moves.len()).filter(|k| is_small(&moves[*k])).collect();
        let moving = if small.len() < SMALL_MOVES_MIN { (0..moves.len()).collect() } else { small };
        let [first, last] = [moving[0], moving[moving.len() - 1]];
        let place = |s: f64| time_s.partition_point(|&t| t < s - middle_s);
        let informative_range = place(moves[first].from_s - MOVE_WINDOW_S)..place(moves[last].until_s);
        // the move before says on which side of its dead zone the servo stands
        let begin_s = moves[first.saturating_sub(1)].from_s - MOVE_WINDOW_S - middle_s;
        let mut informative = (vec![begin_s], vec![f64::NAN]);
        let mut taken = 0;
        for stand in moving.iter().map(|k| &moves[*k]) {
            let until = place(stand.from_s + MOVE_WINDOW_S);
            let images = place(stand.from_s - MOVE_WINDOW_S / 2.0).max(taken)..until;
            informative.0.extend(&time_s[images.clone()]);
            informative.1.extend(&angle_rad[images]);
            taken = until;
        }
        let deadband_rad = levels.deadband_rad.value;
        Ok(Self {
            film,
            levels,
            middle_s,
            time_s,
            angle_rad,
            moves,
            informative,
            informative_range,
            deadband_rad,
        })
    }

    /// The commanded angle at `time_s` \[rad\].
    fn commanded_rad(&self, time_s: f64) -> f64 {
        let (command, time_s) = (&self.film.command, time_s + self.middle_s);
        let next = command.partition_point(|corner| corner.0 <= time_s);
        let pulse_us = match (next.checked_sub(1).and_then(|before| command.get(before)), command.get(next)) {
            (Some(&(t0, p0)), Some(&(t1, p1))) => p0 + (p1 - p0) * (time_s - t0) / (t1 - t0),
            (Some(&(_, pulse_us)), None) | (None, Some(&(_, pulse_us))) => pulse_us,
            (None, None) => f64::NAN,
        };
        self.levels.angle_rad(pulse_us)
    }

    fn command_rad_per_s(&self) -> f64 {
        let pairs = self.film.command.windows(2).filter(|pair| pair[1].0 > pair[0].0);
        let rates = pairs.map(|pair| {
            let change = self.levels.angle_rad(pair[1].1) - self.levels.angle_rad(pair[0].1);
            (change / (pair[1].0 - pair[0].0)).abs()
        });
        rates.fold(0.0, f64::max)
    }

    /// Median size of the moves \[rad\].
    fn step_rad(&self) -> f64 {
        let mut steps: Vec<f64> = self
            .moves
            .iter()
            .filter_map(|stand| {
                let from_us = stand.pulse_us - stand.move_us?;
                Some((self.levels.angle_rad(stand.pulse_us) - self.levels.angle_rad(from_us)).abs())
            })
            .collect();
        median(&mut steps, f64::total_cmp).unwrap_or(0.0)
    }

    fn residuals(&self, law: &Law, images: Range<usize>) -> Vec<f64> {
        let modelled = law.follow(|t| self.commanded_rad(t), &self.time_s[images.clone()]);
        self.angle_rad[images].iter().zip(modelled).map(|(measured, modelled)| measured - modelled).collect()
    }

    /// Sum of squares \[rad²\]: of the informative images, where `law` has a refresh period; else of all.
    fn squares(&self, law: &Law) -> f64 {
        if law.refresh.is_none() {
            return self.residuals(law, 0..self.time_s.len()).iter().map(|r| r * r).sum();
        }
        let (times, angles) = (&self.informative.0, &self.informative.1);
        let modelled = law.follow(|t| self.commanded_rad(t), times);
        angles
            .iter()
            .zip(modelled)
            .filter(|(measured, _)| measured.is_finite())
            .map(|(measured, modelled)| (measured - modelled).powi(2))
            .sum()
    }

    fn starts(&self, rates: &[f64]) -> Vec<Law> {
        let each = START_LAGS_S
            .iter()
            .flat_map(|&lag_s| START_DELAYS_S.iter().map(move |&delay_s| (lag_s, delay_s)));
        let half_zone = self.zone(0.5);
        each.flat_map(|(lag_s, delay_s)| {
            rates.iter().map(move |&rate| Law { lag_s, rate, delay_s, refresh: None, half_zone })
        })
        .collect()
    }

    /// The half zone in which nothing moves \[rad\], divided between the servo and, by the share `behind`, the play behind it.
    fn zone(&self, behind: f64) -> [f64; 2] {
        let behind = behind.clamp(0.0, 1.0);
        [1.0 - behind, behind].map(|share| share * self.deadband_rad)
    }

    /// The best fit from the best of `starts`.
    fn fit(&self, form: Form, starts: &[Law]) -> Fitted {
        let mut ranked: Vec<(f64, Law)> = starts.iter().map(|law| (self.squares(law), *law)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.best(form, ranked.iter().take(STARTS_FOLLOWED).map(|(_, law)| law))
    }

    /// The same for laws with a refresh period. The ranking on the few informative moves suffers from noise, that on the whole film from a lag
    /// that is not quite right yet: the best by either are fitted.
    fn fit_refreshing(&self, form: Form, distinct: &[Law]) -> Fitted {
        let all = |law: &Law| self.residuals(law, 0..self.time_s.len()).iter().map(|r| r * r).sum();
        let lists = [self.nearby(distinct, |law| self.squares(law)), self.nearby(distinct, all)];
        self.best(form, lists.iter().flat_map(|list| list.iter().take(STARTS_FOLLOWED)))
    }

    fn best<'b>(&self, form: Form, starts: impl Iterator<Item = &'b Law>) -> Fitted {
        let mut fits: Vec<Fitted> = starts.map(|start| self.solved(form, start)).collect();
        fits.sort_by(|a, b| a.solution.squares.total_cmp(&b.solution.squares));
        let mut best = fits.remove(0);
        best.others = fits.iter().map(|other| (other.solution.squares, other.law.refresh)).collect();
        best
    }

    /// The best of `ranked` laws with a refresh period, one for each period.
    fn distinct(&self, ranked: &[(f64, Law)]) -> Vec<Law> {
        let span_s = self.time_s[self.informative_range.end - 1] - self.time_s[self.informative_range.start];
        let apart = |[a, _]: [f64; 2], [b, _]: [f64; 2]| (a.recip() - b.recip()).abs() * span_s;
        let mut distinct: Vec<Law> = Vec::new();
        for (_, law) in ranked {
            let is_new = |known: &Law| known.refresh.zip(law.refresh).is_none_or(|(a, b)| apart(a, b) > 0.25);
            if distinct.len() < PERIODS_TRIED && distinct.iter().all(is_new) {
                distinct.push(*law);
            }
        }
        distinct
    }

    /// Each of `distinct` laws with the best period, phase and delay nearby by `squares` \[rad²\]: those of the informative moves, or of the
    /// whole film, which resolves periods more finely.
    fn nearby(&self, distinct: &[Law], squares: impl Fn(&Law) -> f64) -> Vec<Law> {
        let span_s = self.time_s[self.time_s.len() - 1] - self.time_s[0];
        let informative_middle_s =
            0.5 * (self.time_s[self.informative_range.start] + self.time_s[self.informative_range.end - 1]);
        let near = |law: &Law| {
            let [period_s, phase] = law.refresh?;
            let nearby = (-FREQUENCY_STEPS_EACH_SIDE..=FREQUENCY_STEPS_EACH_SIDE).flat_map(|k| {
                let finer_s = (period_s.recip() + 0.5 * FREQUENCY_STEP * f64::from(k) / span_s).recip();
                DELAY_OFFSETS_S.map(|by_s| {
                    // reads at the same instants in the middle of the informative images
                    let refresh = Some([
                        finer_s,
                        phase + informative_middle_s / finer_s - informative_middle_s / period_s,
                    ]);
                    let law = Law { refresh, delay_s: law.delay_s + by_s, ..*law };
                    (squares(&law), law)
                })
            });
            nearby.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let mut again: Vec<(f64, Law)> = distinct.iter().filter_map(near).collect();
        again.sort_by(|a, b| a.0.total_cmp(&b.0));
        again.into_iter().map(|(_, law)| law).collect()
    }

    fn solved(&self, form: Form, start: &Law) -> Fitted {
        let law = |at: &[f64]| {
            let mut rest = at[3..].iter();
            let rate = if form.limited {
                rest.next().map_or(RATE_UNLIMITED_RAD_PER_S, |ln| ln.exp())
            } else {
                RATE_UNLIMITED_RAD_PER_S
            };
            let refresh =
                if form.refresh { rest.next().zip(rest.next()).map(|(&t, &phase)| [t, phase]) } else { None };
            Law {
                lag_s: at[0].exp().clamp(LAG_RANGE_S[0], LAG_RANGE_S[1]),
                delay_s: at[1],
                rate: rate.clamp(1e-2, RATE_UNLIMITED_RAD_PER_S),
                refresh: refresh
                    .map(|[t, phase]| [t.clamp(0.5 * PERIOD_RANGE_S[0], 2.0 * PERIOD_RANGE_S[1]), phase]),
                half_zone: self.zone(at[2]),
            }
        };
        let behind = start.half_zone[1] / self.deadband_rad.max(f64::MIN_POSITIVE);
        let (mut at, mut step) = (vec![start.lag_s.ln(), start.delay_s, behind], vec![0.02, 2e-4, 0.02]);
        if form.limited {
            at.push(start.rate.ln());
            step.push(0.01);
        }
        if let (true, Some([period_s, phase])) = (form.refresh, start.refresh) {
            at.extend([period_s, phase]);
            step.extend([1e-6, 0.01]);
        }
        let solution = solve(|at| self.residuals(&law(at), 0..self.time_s.len()), &at, &step);
        Fitted { form, law: law(&solution.at), solution, others: Vec::new() }
    }

    /// Laws with a refresh period, the best phase for each period, ranked on the informative moves. A command is read half a period late on
    /// average, which a law without a refresh period takes for delay.
    fn refreshing(&self, smooth: &Fitted) -> Vec<(f64, Law)> {
        let span_s = self.time_s[self.informative_range.end - 1] - self.time_s[self.informative_range.start];
        let step = FREQUENCY_STEP / span_s.max(1.0);
        let [most, least] = PERIOD_RANGE_S.map(f64::recip);
        let base = smooth.law;
        let frequencies = (0..=((most - least) / step) as usize).map(|k| least + k as f64 * step);
        let best_of = |frequency: f64| {
            let period_s = frequency.recip();
            let phases = (0..PHASE_STEPS).map(|phase| {
                let refresh = Some([period_s, phase as f64 / PHASE_STEPS as f64]);
                let law = Law { delay_s: base.delay_s - 0.5 * period_s, refresh, ..base };
                (self.squares(&law), law)
            });
            phases.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let mut ranked: Vec<(f64, Law)> = frequencies.filter_map(best_of).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked
    }

    /// The time shift of `law` that would cause a misfit as large as the one beyond the images' noise \[s\]: how wrong its times may be where the
    /// servo does not follow the model.
    fn misfit_s(&self, law: &Law) -> f64 {
        let path = law.follow(|t| self.commanded_rad(t), &self.time_s);
        let still =
            self.angle_rad.windows(2).zip(path.windows(2)).filter(|(_, a)| (a[1] - a[0]).abs() < STILL_RAD);
        let mut changes: Vec<f64> = still.map(|(pair, _)| (pair[1] - pair[0]).abs()).collect();
        let noise = MEDIAN_TO_SIGMA * median(&mut changes, f64::total_cmp).unwrap_or(0.0) / 2.0_f64.sqrt();
        let rates = path.windows(2).zip(self.time_s.windows(2)).map(|(a, t)| (a[1] - a[0]) / (t[1] - t[0]));
        let rates: f64 = rates.map(|rate| rate * rate).sum();
        let left: f64 =
            self.angle_rad.iter().zip(&path).map(|(measured, modelled)| (measured - modelled).powi(2)).sum();
        let beyond = left - noise * noise * path.len() as f64;
        (beyond.max(0.0) / rates.max(f64::MIN_POSITIVE)).sqrt()
    }

    fn to_dynamics(&self, best: &Fitted, plain_squares: f64, command_rad_per_s: f64) -> Dynamics {
        let (law, std) = (&best.law, &best.solution.std);
        let misfit_s = self.misfit_s(law);
        let std_of = |place: usize, least: f64| {
            std.get(place).copied().filter(|std| std.is_finite()).map_or(least, |std| std.max(least))
        };
        let lag_std = (law.lag_s * std[0].max(LAG_STD_SHARE_MIN)).max(LAG_STD_MIN_S).hypot(misfit_s);
        let limit = std_of(3, RATE_STD_SHARE_MIN);
        let period = if best.form.limited { 4 } else { 3 };
        Dynamics {
            lag_s: Estimate { value: law.lag_s, std: if lag_std.is_finite() { lag_std } else { law.lag_s } },
            delay_s: Estimate { value: law.delay_s, std: std_of(1, DELAY_STD_MIN_S).hypot(misfit_s) },
            rate_limit_rad_per_s: best
                .form
                .limited
                .then_some(Estimate { value: law.rate, std: law.rate * limit }),
            refresh_s: law.refresh.map(|[period_s, _]| Estimate {
                value: period_s,
                std: std_of(period, PERIOD_STD_MIN_S).hypot(best.rivals_s(plain_squares)),
            }),
            command_rad_per_s,
            rms_rad: (best.solution.squares / self.time_s.len() as f64).sqrt(),
        }
    }
}
