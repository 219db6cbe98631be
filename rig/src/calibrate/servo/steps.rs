//! Quick steps: lag, rate limit, looks and delay.
//!
//! A servo that looks at its pulse now and then starts late by what was left of its period: steps at times that have nothing to do with
//! each other are late by a saw of their times, whose frequency a periodogram shows. From its highest peaks on all numbers are fitted
//! together, with and without a limit of the rate, with and without looks; what does not clearly better the fit is left out.

use std::f64::consts::TAU;

use ident::statistics::median;

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
    /// Looks further apart than this would have been seen \[s\].
    pub seen_refresh_s: f64,
    /// Standard deviation of the images from the law \[rad\].
    pub rms_rad: f64,
}

/// Least images of quick steps.
const LEAST_IMAGES: usize = 100;
/// Stands shorter than this are between quick steps \[s\].
const SHORT_S: f64 = 0.45;
/// Starts that are tried: lags \[s\], delays \[s\], and rate limits as shares of the fastest command.
const LAGS_S: [f64; 6] = [0.003, 0.007, 0.015, 0.03, 0.06, 0.12];
const DELAYS_S: [f64; 8] = [-0.02, -0.01, 0.0, 0.01, 0.02, 0.03, 0.05, 0.07];
const RATES: [f64; 5] = [0.3, 0.45, 0.6, 0.75, 0.9];
/// No limit \[rad/s\].
const UNLIMITED: f64 = 1e4;
/// Least and greatest lag of a search \[s\].
const LAG_S: [f64; 2] = [2e-4, 1.0];
/// Periods of looks that are sought \[s\].
const PERIOD_S: [f64; 2] = [0.004, 0.05];
/// Frequencies this share of the inverse of the film's length apart keep in step with it.
const FREQUENCY_STEP: f64 = 0.125;
const PEAKS: usize = 12;
const PHASES: usize = 12;
/// How late a step can be beside the others \[s\].
const LATE_S: f64 = 0.04;
/// A further number must lessen the squares to less than this share.
const BETTERS: f64 = 0.8;
/// What no statistics of one film tell: a law that is not quite the servo's \[s\], and as a share of the lag.
const LEAST_LAG_STD_S: f64 = 5e-4;
const LEAST_LAG_SHARE: f64 = 0.03;
const LEAST_DELAY_STD_S: f64 = 3e-4;
const LEAST_PERIOD_STD_S: f64 = 2e-5;
const LEAST_RATE_SHARE: f64 = 0.02;

/// What quick steps are compared with.
struct Steps<'a> {
    film: &'a Film,
    levels: &'a Levels,
    /// The middle of the steps: times count from there, so that a period and a phase are apart.
    middle_s: f64,
    /// When images were taken, and what they showed.
    time_s: Vec<f64>,
    angle_rad: Vec<f64>,
    moves: Vec<Stand>,
    hysteresis_rad: f64,
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
}

/// How the servo follows quick steps.
pub(super) fn dynamics(films: &[Film], levels: &Levels) -> Result<Dynamics, ServoCalibrateError> {
    let steps = Steps::of(films, levels)?;
    let zone = 2.0 * levels.hysteresis_rad.value;
    let step = steps.step_rad();
    if zone > 0.5 * step {
        return Err(ServoCalibrateError::Loose { zone_rad: zone, step_rad: step });
    }
    let told = steps.told_rad_per_s();
    let plain = steps.fit(Form { limited: false, looks: false }, &steps.starts(&[UNLIMITED]));
    let rates = RATES.map(|share| share * told);
    let limited = steps.fit(Form { limited: true, looks: false }, &steps.starts(&rates));
    let smooth = better(plain, limited, |fitted| fitted.law.rate < told);
    let late_s = steps.late_s(&smooth.law);
    let looking = steps.looking(&smooth, &late_s);
    let form = |limited| Form { limited, looks: true };
    let plain = steps.fit(form(false), &looking.iter().map(|law| Law { rate: UNLIMITED, ..*law }).collect::<Vec<_>>());
    let limits = looking.iter().flat_map(|law| {
        [law.rate.min(0.9 * told), 0.6 * told].map(|rate| Law { rate, ..*law })
    });
    let limited = steps.fit(form(true), &limits.collect::<Vec<_>>());
    let best = better(plain, limited, |fitted| fitted.law.rate < told);
    let in_range = |period_s: f64| (PERIOD_S[0]..=PERIOD_S[1]).contains(&period_s);
    let best = better(smooth, best, |fitted| fitted.law.looks.is_some_and(|[period_s, _]| in_range(period_s)));
    Ok(steps.said(&best, &late_s, told))
}

/// `other` where it `counts` and betters `one` clearly.
fn better(one: Fitted, other: Fitted, counts: impl Fn(&Fitted) -> bool) -> Fitted {
    if counts(&other) && other.solution.squares < BETTERS * one.solution.squares { other } else { one }
}

impl<'a> Steps<'a> {
    fn of(films: &'a [Film], levels: &'a Levels) -> Result<Self, ServoCalibrateError> {
        let short = |film: &&Film| stands(film).iter().filter(|s| s.until_s - s.from_s < SHORT_S).count();
        let lacking = |images| ServoCalibrateError::NoQuickSteps { images, least: LEAST_IMAGES };
        let film = films.iter().max_by_key(short).ok_or(lacking(0))?;
        let all = stands(film);
        let moves: Vec<Stand> = all.iter().filter(|stand| stand.move_us.is_some()).copied().collect();
        let (Some(first), Some(last)) = (all.first(), all.last()) else { return Err(lacking(0)) };
        // a tenth of a second before the first step, and half of one after the last
        let (from_s, until_s) = (first.until_s - 0.1, last.until_s.min(last.from_s + 0.5));
        let middle_s = 0.5 * (from_s + until_s);
        let shown = film.time_s.iter().zip(&film.angle_rad).filter(|(t, _)| (from_s..until_s).contains(*t));
        let (time_s, angle_rad): (Vec<f64>, Vec<f64>) = shown.map(|(t, angle)| (t - middle_s, *angle)).unzip();
        if short(&film) < 3 || time_s.len() < LEAST_IMAGES {
            return Err(lacking(time_s.len()));
        }
        let hysteresis_rad = levels.hysteresis_rad.value;
        Ok(Self { film, levels, middle_s, time_s, angle_rad, moves, hysteresis_rad })
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

    /// How far a quick step leads: most of them are alike.
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

    fn residuals(&self, law: &Law) -> Vec<f64> {
        let shown = law.follow(|t| self.told(t), &self.time_s);
        self.angle_rad.iter().zip(shown).map(|(seen, shown)| seen - shown).collect()
    }

    fn squares(&self, law: &Law) -> f64 {
        self.residuals(law).iter().map(|r| r * r).sum()
    }

    fn starts(&self, rates: &[f64]) -> Vec<Law> {
        let each = LAGS_S.iter().flat_map(|&lag_s| DELAYS_S.iter().map(move |&delay_s| (lag_s, delay_s)));
        let half_zone = self.zone(0.5);
        each.flat_map(|(lag_s, delay_s)| {
            rates.iter().map(move |&rate| Law { lag_s, rate, delay_s, looks: None, half_zone })
        })
        .collect()
    }

    /// The zone in which nothing moves, with a share of it in the play behind the servo.
    fn zone(&self, behind: f64) -> [f64; 2] {
        let behind = behind.clamp(0.0, 1.0);
        [1.0 - behind, behind].map(|share| share * self.hysteresis_rad)
    }

    /// The best that the best of `starts` lead to.
    fn fit(&self, form: Form, starts: &[Law]) -> Fitted {
        const FOLLOWED: usize = 3;
        let mut ranked: Vec<(f64, Law)> = starts.iter().map(|law| (self.squares(law), *law)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let fits = ranked.iter().take(FOLLOWED).map(|(_, start)| self.solved(form, start));
        let best = fits.min_by(|a, b| a.solution.squares.total_cmp(&b.solution.squares));
        best.unwrap_or_else(|| self.solved(form, &self.starts(&[UNLIMITED])[0]))
    }

    fn solved(&self, form: Form, start: &Law) -> Fitted {
        let law = |at: &[f64]| {
            let mut rest = at[3..].iter();
            let rate = if form.limited { rest.next().map_or(UNLIMITED, |ln| ln.exp()) } else { UNLIMITED };
            let looks = if form.looks { rest.next().zip(rest.next()).map(|(&t, &phase)| [t, phase]) } else { None };
            Law {
                lag_s: at[0].exp().clamp(LAG_S[0], LAG_S[1]),
                delay_s: at[1],
                rate: rate.clamp(1e-2, UNLIMITED),
                looks: looks.map(|[t, phase]| [t.clamp(0.5 * PERIOD_S[0], 2.0 * PERIOD_S[1]), phase]),
                half_zone: self.zone(at[2]),
            }
        };
        let behind = start.half_zone[1] / self.hysteresis_rad.max(f64::MIN_POSITIVE);
        let (mut at, mut step) = (vec![start.lag_s.ln(), start.delay_s, behind], vec![0.02, 2e-4, 0.02]);
        if form.limited {
            at.push(start.rate.ln());
            step.push(0.01);
        }
        if let (true, Some([period_s, phase])) = (form.looks, start.looks) {
            at.extend([period_s, phase]);
            step.extend([1e-6, 0.01]);
        }
        let solution = solve(|at| self.residuals(&law(at)), &at, &step);
        Fitted { form, law: law(&solution.at), solution }
    }

    /// How late each step is beside what `law` has: when it was told, and by how much \[s\].
    fn late_s(&self, law: &Law) -> Vec<(f64, f64)> {
        const TRIED: i32 = 40;
        let found = self.moves.iter().enumerate().filter_map(|(k, stand)| {
            let next_s = self.moves.get(k + 1).map_or(stand.until_s, |next| next.from_s);
            let (from_s, until_s) = (stand.from_s - self.middle_s - 0.1, next_s - self.middle_s - 0.05);
            let from = self.time_s.partition_point(|&t| t < from_s);
            let until = self.time_s.partition_point(|&t| t < until_s);
            if until < from + 5 {
                return None;
            }
            // with a run-up, so that it stands where the step before has led
            let run_up = from.saturating_sub(50);
            let squares = |late: f64| {
                let late = Law { delay_s: law.delay_s + late, ..*law };
                let shown = late.follow(|t| self.told(t), &self.time_s[run_up..until]);
                let pairs = self.angle_rad[from..until].iter().zip(&shown[from - run_up..]);
                pairs.map(|(seen, shown)| (seen - shown).powi(2)).sum::<f64>()
            };
            let unit = LATE_S / f64::from(TRIED);
            let each: Vec<f64> = (-TRIED..=TRIED).map(|k| squares(unit * f64::from(k))).collect();
            let best = (1..each.len() - 1).min_by(|a, b| each[*a].total_cmp(&each[*b]))?;
            let [a, b, c] = [each[best - 1], each[best], each[best + 1]];
            let bend = a - 2.0 * b + c;
            let between = if bend > 0.0 { (0.5 * (a - c) / bend).clamp(-1.0, 1.0) } else { 0.0 };
            Some((stand.from_s - self.middle_s, unit * (best as f64 - f64::from(TRIED) + between)))
        });
        found.collect()
    }

    /// Servos that look now and then, by how late steps are: from the highest peaks of the periodogram.
    fn looking(&self, smooth: &Fitted, late_s: &[(f64, f64)]) -> Vec<Law> {
        let span_s = self.time_s.last().zip(self.time_s.first()).map_or(1.0, |(last, first)| last - first);
        let mean = late_s.iter().map(|late| late.1).sum::<f64>() / late_s.len().max(1) as f64;
        let height = |frequency: f64| {
            let turned = late_s.iter().map(|(t, late)| {
                let (sin, cos) = (TAU * frequency * t).sin_cos();
                ((late - mean) * cos, (late - mean) * sin)
            });
            let (x, y) = turned.fold((0.0, 0.0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
            x.hypot(y)
        };
        let step = FREQUENCY_STEP / span_s;
        let [most, least] = PERIOD_S.map(f64::recip);
        let all = (0..=((most - least) / step) as usize).map(|k| least + k as f64 * step);
        let mut heights: Vec<(f64, f64)> = all.map(|frequency| (frequency, height(frequency))).collect();
        heights.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut peaks: Vec<f64> = Vec::new();
        for (frequency, _) in heights {
            if peaks.len() < PEAKS && peaks.iter().all(|peak| (peak - frequency).abs() > 1.0 / span_s) {
                peaks.push(frequency);
            }
        }
        let base = smooth.law;
        let laws = peaks.iter().flat_map(|frequency| {
            [-0.5, 0.0, 0.5].map(|part| (frequency + part * step).recip()).into_iter().flat_map(|period_s| {
                (0..PHASES).flat_map(move |k| {
                    let looks = Some([period_s, k as f64 / PHASES as f64]);
                    // looking now and then is half a period late, and looks like lag
                    [0.6, 1.0].into_iter().flat_map(move |share| {
                        [-0.75, -0.5, -0.25].map(|part| Law {
                            lag_s: share * base.lag_s,
                            delay_s: base.delay_s + part * period_s + (1.0 - share) * base.lag_s * 0.5,
                            looks,
                            ..base
                        })
                    })
                })
            })
        });
        laws.collect()
    }

    fn said(&self, best: &Fitted, late_s: &[(f64, f64)], told_rad_per_s: f64) -> Dynamics {
        let (law, std) = (&best.law, &best.solution.std);
        let std_of = |place: usize, least: f64| {
            std.get(place).copied().filter(|std| std.is_finite()).map_or(least, |std| std.max(least))
        };
        let lag_std = (law.lag_s * std[0].max(LEAST_LAG_SHARE)).max(LEAST_LAG_STD_S);
        let limit = std_of(3, LEAST_RATE_SHARE);
        let period = if best.form.limited { 4 } else { 3 };
        let mean = late_s.iter().map(|late| late.1).sum::<f64>() / late_s.len().max(1) as f64;
        let spread = late_s.iter().map(|late| (late.1 - mean).powi(2)).sum::<f64>();
        Dynamics {
            lag_s: Estimate { value: law.lag_s, std: if lag_std.is_finite() { lag_std } else { law.lag_s } },
            delay_s: Estimate { value: law.delay_s, std: std_of(1, LEAST_DELAY_STD_S) },
            rate_limit_rad_per_s: best
                .form
                .limited
                .then_some(Estimate { value: law.rate, std: law.rate * limit }),
            refresh_s: law
                .looks
                .map(|[period_s, _]| Estimate { value: period_s, std: std_of(period, LEAST_PERIOD_STD_S) }),
            told_rad_per_s,
            // a saw's standard deviation is its height over the root of 12
            seen_refresh_s: (12.0 * spread / late_s.len().max(1) as f64).sqrt(),
            rms_rad: (best.solution.squares / self.time_s.len() as f64).sqrt(),
        }
    }
}
