//! Every move of the film: lag, rate limit, looks and delay.
//!
//! A servo that looks at its pulse now and then starts late by what was left of its period: moves at times that have nothing to do with
//! each other are late by different parts of it. From the periods that explain that best on all numbers are fitted together, with and
//! without a limit of the rate, with and without looks; what does not clearly better the fit is left out.

use std::ops::Range;

use ground::statistics::{MEDIAN_TO_SIGMA, median};

use super::Film;
use super::error::ServoCalibrateError;
use super::law::Law;
use super::least_squares::{Solution, solve};
use super::levels::Levels;
use super::rests::{Stand, stands};

/// A number and its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Its standard error.
    pub std: f64,
}

/// How a servo follows.
#[derive(Debug, Clone, PartialEq)]
pub struct Dynamics {
    /// Time constant \[s\].
    pub lag_s: Estimate,
    /// From the pulse to the picture, beside the lag \[s\]: servo, board and camera together.
    pub delay_s: Estimate,
    /// Fastest turn \[rad/s\]; none where it was never reached.
    pub rate_limit_rad_per_s: Option<Estimate>,
    /// From one look at the pulse to the next \[s\]; none where it looks too often to be seen.
    pub refresh_s: Option<Estimate>,
    /// Fastest change of what it was told \[rad/s\].
    pub told_rad_per_s: f64,
    /// Standard deviation of the images from the law \[rad\].
    pub rms_rad: f64,
}

/// Least images of moves.
const IMAGES_MIN: usize = 100;
/// Starts that are tried: lags \[s\], delays \[s\], and rate limits as shares of the fastest command.
const START_LAGS_S: [f64; 6] = [0.003, 0.007, 0.015, 0.03, 0.06, 0.12];
const START_DELAYS_S: [f64; 8] = [-0.02, -0.01, 0.0, 0.01, 0.02, 0.03, 0.05, 0.07];
const START_RATE_SHARES: [f64; 5] = [0.3, 0.45, 0.6, 0.75, 0.9];
/// No limit \[rad/s\].
const RATE_UNLIMITED_RAD_PER_S: f64 = 1e4;
/// Least and greatest lag of a search \[s\].
const LAG_RANGE_S: [f64; 2] = [2e-4, 1.0];
/// Periods of looks that are sought \[s\].
const PERIOD_RANGE_S: [f64; 2] = [0.004, 0.05];
/// Frequencies this share of the inverse of the film's length apart keep in step with it.
const FREQUENCY_STEP: f64 = 0.25;
const PHASE_STEPS: usize = 10;
/// Moves of no more than this share of the travel are over before the servo has looked twice, and tell when it looks.
const SMALL_MOVE_SHARE: f64 = 0.1;
const SMALL_MOVES_MIN: usize = 6;
/// A move is looked at about so long \[s\].
const MOVE_WINDOW_S: f64 = 0.2;
/// So many starts are followed to their ends; with looks, of so many periods tried on all of the film, with so many steps of the frequency to
/// either side, and delays off by so much \[s\].
const STARTS_FOLLOWED: usize = 4;
const PERIODS_TRIED: usize = 30;
const FREQUENCY_STEPS_EACH_SIDE: i32 = 6;
const DELAY_OFFSETS_S: [f64; 5] = [-0.002, -0.001, 0.0, 0.001, 0.002];
/// A period is a rival of the best where it has this share of what that betters.
const RIVAL_GAIN_SHARE: f64 = 0.85;
/// A servo that turns by less from image to image stands \[rad\].
const STILL_RAD: f64 = 1e-5;
/// A further number must lessen the squares to less than this share.
const SQUARES_RATIO_MAX: f64 = 0.93;
/// What no statistics of one film tell: a law that is not quite the servo's \[s\], and as a share of the lag.
const LAG_STD_MIN_S: f64 = 5e-4;
const LAG_STD_SHARE_MIN: f64 = 0.03;
const DELAY_STD_MIN_S: f64 = 3e-4;
const PERIOD_STD_MIN_S: f64 = 2e-5;
const RATE_STD_SHARE_MIN: f64 = 0.02;

/// What the film is compared with.
struct Steps<'a> {
    film: &'a Film,
    levels: &'a Levels,
    /// The middle of the steps: times count from there, so that a period and a phase are apart.
    middle_s: f64,
    /// When images were taken, and what they showed.
    time_s: Vec<f64>,
    angle_rad: Vec<f64>,
    moves: Vec<Stand>,
    /// Times and angles of the images that tell most of looks, with a first one that only begins; and from which to which image they are.
    telling: (Vec<f64>, Vec<f64>),
    shown: Range<usize>,
    deadband_rad: f64,
}

/// Which numbers a law has beside lag and delay.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Form {
    limited: bool,
    looks: bool,
}

struct Fitted {
    form: Form,
    law: Law,
    solution: Solution,
    /// Squares and looks of where other starts have led.
    others: Vec<(f64, Option<[f64; 2]>)>,
}

impl Fitted {
    /// How far off periods are that explain nearly as much of what a servo without looks leaves, `plain` squares \[s\].
    fn rivals_s(&self, plain: f64) -> f64 {
        let least = plain - RIVAL_GAIN_SHARE * (plain - self.solution.squares);
        let rivals = self.others.iter().filter(|(squares, _)| *squares < least);
        let period_s = |looks: Option<[f64; 2]>| looks.map_or(0.0, |[period_s, _]| period_s);
        rivals.map(|(_, looks)| (period_s(*looks) - period_s(self.law.looks)).abs()).fold(0.0, f64::max)
    }
}

/// How the servo follows.
pub(super) fn dynamics(
    film: &Film,
    levels: &Levels,
    may_look: bool,
) -> Result<Dynamics, ServoCalibrateError> {
    let steps = Steps::of(film, levels)?;
    let zone = 2.0 * levels.deadband_rad.value;
    let step = steps.step_rad();
    if zone > 0.5 * step {
        return Err(ServoCalibrateError::Loose { zone_rad: zone, step_rad: step });
    }
    let told = steps.told_rad_per_s();
    let plain = steps.fit(Form { limited: false, looks: false }, &steps.starts(&[RATE_UNLIMITED_RAD_PER_S]));
    let rates = START_RATE_SHARES.map(|share| share * told);
    let limited = steps.fit(Form { limited: true, looks: false }, &steps.starts(&rates));
    let smooth = better(plain, limited, |fitted| fitted.law.rate < told);
    let plain_squares = smooth.solution.squares;
    if !may_look {
        return Ok(steps.said(&smooth, plain_squares, told));
    }
    let looking = steps.distinct(&steps.looking(&smooth));
    let best = steps.fit_looking(Form { looks: true, ..smooth.form }, &looking);
    let in_range = |period_s: f64| (PERIOD_RANGE_S[0]..=PERIOD_RANGE_S[1]).contains(&period_s);
    let best =
        better(smooth, best, |fitted| fitted.law.looks.is_some_and(|[period_s, _]| in_range(period_s)));
    Ok(steps.said(&best, plain_squares, told))
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
        let told = |corner: Option<&(f64, f64)>| corner.map_or(f64::NAN, |corner| corner.0);
        // a tenth of a second before it is told anything, and half of one after the last
        let (from_s, until_s) = (told(film.told.first()) - 0.1, told(film.told.last()) + 0.5);
        let middle_s = 0.5 * (from_s + until_s);
        let shown = film.time_s.iter().zip(&film.angle_rad).filter(|(t, _)| (from_s..until_s).contains(*t));
        let (time_s, angle_rad): (Vec<f64>, Vec<f64>) =
            shown.map(|(t, angle)| (t - middle_s, *angle)).unzip();
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
        let shown = place(moves[first].from_s - MOVE_WINDOW_S)..place(moves[last].until_s);
        // the move before says on which side of its dead zone the servo stands
        let begin_s = moves[first.saturating_sub(1)].from_s - MOVE_WINDOW_S - middle_s;
        let mut telling = (vec![begin_s], vec![f64::NAN]);
        let mut taken = 0;
        for stand in moving.iter().map(|k| &moves[*k]) {
            let until = place(stand.from_s + MOVE_WINDOW_S);
            let images = place(stand.from_s - MOVE_WINDOW_S / 2.0).max(taken)..until;
            telling.0.extend(&time_s[images.clone()]);
            telling.1.extend(&angle_rad[images]);
            taken = until;
        }
        let deadband_rad = levels.deadband_rad.value;
        Ok(Self { film, levels, middle_s, time_s, angle_rad, moves, telling, shown, deadband_rad })
    }

    /// The angle it is told at `time_s`.
    fn told(&self, time_s: f64) -> f64 {
        let (told, time_s) = (&self.film.told, time_s + self.middle_s);
        let next = told.partition_point(|corner| corner.0 <= time_s);
        let pulse_us = match (next.checked_sub(1).and_then(|before| told.get(before)), told.get(next)) {
            (Some(&(t0, p0)), Some(&(t1, p1))) => p0 + (p1 - p0) * (time_s - t0) / (t1 - t0),
            (Some(&(_, pulse_us)), None) | (None, Some(&(_, pulse_us))) => pulse_us,
            (None, None) => f64::NAN,
        };
        self.levels.angle_rad(pulse_us)
    }

    fn told_rad_per_s(&self) -> f64 {
        let pairs = self.film.told.windows(2).filter(|pair| pair[1].0 > pair[0].0);
        let rates = pairs.map(|pair| {
            let change = self.levels.angle_rad(pair[1].1) - self.levels.angle_rad(pair[0].1);
            (change / (pair[1].0 - pair[0].0)).abs()
        });
        rates.fold(0.0, f64::max)
    }

    /// How far a move leads: most of them are alike.
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
        let shown = law.follow(|t| self.told(t), &self.time_s[images.clone()]);
        self.angle_rad[images].iter().zip(shown).map(|(seen, shown)| seen - shown).collect()
    }

    /// Of the images that tell most of looks, where `law` has looks; else of all.
    fn squares(&self, law: &Law) -> f64 {
        if law.looks.is_none() {
            return self.residuals(law, 0..self.time_s.len()).iter().map(|r| r * r).sum();
        }
        let (times, angles) = (&self.telling.0, &self.telling.1);
        let shown = law.follow(|t| self.told(t), times);
        angles
            .iter()
            .zip(shown)
            .filter(|(seen, _)| seen.is_finite())
            .map(|(seen, shown)| (seen - shown).powi(2))
            .sum()
    }

    fn starts(&self, rates: &[f64]) -> Vec<Law> {
        let each = START_LAGS_S
            .iter()
            .flat_map(|&lag_s| START_DELAYS_S.iter().map(move |&delay_s| (lag_s, delay_s)));
        let half_zone = self.zone(0.5);
        each.flat_map(|(lag_s, delay_s)| {
            rates.iter().map(move |&rate| Law { lag_s, rate, delay_s, looks: None, half_zone })
        })
        .collect()
    }

    /// The zone in which nothing moves, with a share of it in the play behind the servo.
    fn zone(&self, behind: f64) -> [f64; 2] {
        let behind = behind.clamp(0.0, 1.0);
        [1.0 - behind, behind].map(|share| share * self.deadband_rad)
    }

    /// The best that the best of `starts` lead to.
    fn fit(&self, form: Form, starts: &[Law]) -> Fitted {
        let mut ranked: Vec<(f64, Law)> = starts.iter().map(|law| (self.squares(law), *law)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.best(form, ranked.iter().take(STARTS_FOLLOWED).map(|(_, law)| law))
    }

    /// The same for laws with looks. Few moves may be misled by noise and all of the film by a lag that is not quite right yet: the best by
    /// either are followed.
    fn fit_looking(&self, form: Form, distinct: &[Law]) -> Fitted {
        let all = |law: &Law| self.residuals(law, 0..self.time_s.len()).iter().map(|r| r * r).sum();
        let lists = [self.nearby(distinct, |law| self.squares(law)), self.nearby(distinct, all)];
        self.best(form, lists.iter().flat_map(|list| list.iter().take(STARTS_FOLLOWED)))
    }

    fn best<'b>(&self, form: Form, starts: impl Iterator<Item = &'b Law>) -> Fitted {
        let mut fits: Vec<Fitted> = starts.map(|start| self.solved(form, start)).collect();
        fits.sort_by(|a, b| a.solution.squares.total_cmp(&b.solution.squares));
        let mut best = fits.remove(0);
        best.others = fits.iter().map(|other| (other.solution.squares, other.law.looks)).collect();
        best
    }

    /// The best of `ranked` laws with looks, of each period one.
    fn distinct(&self, ranked: &[(f64, Law)]) -> Vec<Law> {
        let span_s = self.time_s[self.shown.end - 1] - self.time_s[self.shown.start];
        let apart = |[a, _]: [f64; 2], [b, _]: [f64; 2]| (a.recip() - b.recip()).abs() * span_s;
        let mut distinct: Vec<Law> = Vec::new();
        for (_, law) in ranked {
            let is_new = |known: &Law| known.looks.zip(law.looks).is_none_or(|(a, b)| apart(a, b) > 0.25);
            if distinct.len() < PERIODS_TRIED && distinct.iter().all(is_new) {
                distinct.push(*law);
            }
        }
        distinct
    }

    /// Each of `distinct` laws with the period, the phase and the delay nearby that explain most, and how much they leave \[rad²\]: of the moves
    /// that tell most, or of all of the film, which tells periods from each other more finely.
    fn nearby(&self, distinct: &[Law], squares: impl Fn(&Law) -> f64) -> Vec<Law> {
        let span_s = self.time_s[self.time_s.len() - 1] - self.time_s[0];
        let telling_s = 0.5 * (self.time_s[self.shown.start] + self.time_s[self.shown.end - 1]);
        let near = |law: &Law| {
            let [period_s, phase] = law.looks?;
            let nearby = (-FREQUENCY_STEPS_EACH_SIDE..=FREQUENCY_STEPS_EACH_SIDE).flat_map(|k| {
                let finer_s = (period_s.recip() + 0.5 * FREQUENCY_STEP * f64::from(k) / span_s).recip();
                DELAY_OFFSETS_S.map(|by_s| {
                    // looking at the same instants where most is told of them
                    let looks = Some([finer_s, phase + telling_s / finer_s - telling_s / period_s]);
                    let law = Law { looks, delay_s: law.delay_s + by_s, ..*law };
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
            let looks =
                if form.looks { rest.next().zip(rest.next()).map(|(&t, &phase)| [t, phase]) } else { None };
            Law {
                lag_s: at[0].exp().clamp(LAG_RANGE_S[0], LAG_RANGE_S[1]),
                delay_s: at[1],
                rate: rate.clamp(1e-2, RATE_UNLIMITED_RAD_PER_S),
                looks: looks
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
        if let (true, Some([period_s, phase])) = (form.looks, start.looks) {
            at.extend([period_s, phase]);
            step.extend([1e-6, 0.01]);
        }
        let solution = solve(|at| self.residuals(&law(at), 0..self.time_s.len()), &at, &step);
        Fitted { form, law: law(&solution.at), solution, others: Vec::new() }
    }

    /// Servos that look now and then: one for each period and phase that tell on the moves that tell most. What is told at an instant is seen
    /// at the next look, half a period later on average, which a servo without looks takes for delay.
    fn looking(&self, smooth: &Fitted) -> Vec<(f64, Law)> {
        let span_s = self.time_s[self.shown.end - 1] - self.time_s[self.shown.start];
        let step = FREQUENCY_STEP / span_s.max(1.0);
        let [most, least] = PERIOD_RANGE_S.map(f64::recip);
        let base = smooth.law;
        let frequencies = (0..=((most - least) / step) as usize).map(|k| least + k as f64 * step);
        let best_of = |frequency: f64| {
            let period_s = frequency.recip();
            let phases = (0..PHASE_STEPS).map(|phase| {
                let looks = Some([period_s, phase as f64 / PHASE_STEPS as f64]);
                let law = Law { delay_s: base.delay_s - 0.5 * period_s, looks, ..base };
                (self.squares(&law), law)
            });
            phases.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let mut ranked: Vec<(f64, Law)> = frequencies.filter_map(best_of).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked
    }

    /// By how much `law` would have to be early or late to be off by as much as it is beyond the images' noise \[s\]: what its numbers may be
    /// wrong by where the servo follows another law.
    fn misfit_s(&self, law: &Law) -> f64 {
        let path = law.follow(|t| self.told(t), &self.time_s);
        let still =
            self.angle_rad.windows(2).zip(path.windows(2)).filter(|(_, a)| (a[1] - a[0]).abs() < STILL_RAD);
        let mut changes: Vec<f64> = still.map(|(pair, _)| (pair[1] - pair[0]).abs()).collect();
        let noise = MEDIAN_TO_SIGMA * median(&mut changes, f64::total_cmp).unwrap_or(0.0) / 2.0_f64.sqrt();
        let rates = path.windows(2).zip(self.time_s.windows(2)).map(|(a, t)| (a[1] - a[0]) / (t[1] - t[0]));
        let rates: f64 = rates.map(|rate| rate * rate).sum();
        let left: f64 = self.angle_rad.iter().zip(&path).map(|(seen, shown)| (seen - shown).powi(2)).sum();
        let beyond = left - noise * noise * path.len() as f64;
        (beyond.max(0.0) / rates.max(f64::MIN_POSITIVE)).sqrt()
    }

    fn said(&self, best: &Fitted, plain_squares: f64, told_rad_per_s: f64) -> Dynamics {
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
            refresh_s: law.looks.map(|[period_s, _]| Estimate {
                value: period_s,
                std: std_of(period, PERIOD_STD_MIN_S).hypot(best.rivals_s(plain_squares)),
            }),
            told_rad_per_s,
            rms_rad: (best.solution.squares / self.time_s.len() as f64).sqrt(),
        }
    }
}
