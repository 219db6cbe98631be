//! What the residuals look like: by run and keypoint, what they follow, how fast they swing, where they are worst.

use super::result::{Follows, Remainder, Residuals, RunRemainder, RunResiduals, WorstInterval};
use crate::hypothesis::state::State;
use crate::noise::floor::{Floor, interval_s};

/// Length of a worst interval \[s\].
const PIECE_S: f64 = 0.25;
/// Worst intervals listed.
const WORST_LISTED: usize = 5;

pub(super) fn residuals(before: &State<'_>, after: &State<'_>, floor: &Floor) -> Residuals {
    let mut list = Residuals::default();
    let mut worst: Vec<WorstInterval> = Vec::new();
    let mut motions = Motions::default();
    let mut spectrum = Spectrum::default();
    for (run, term) in before.terms.iter().enumerate() {
        let (Some(a), Some(b)) = (before.raw_residuals(run), after.raw_residuals(run)) else { continue };
        let trajectory = &term.rehearsal.run.trajectory;
        let width = trajectory.keypoints.len();
        let id = &term.rehearsal.run.id;
        let rms = |residuals: &[f64], keypoint: usize| {
            let own = term.observations.iter().zip(residuals).filter(|(o, _)| o.keypoint == keypoint);
            let (sum, count) = own.fold((0.0, 0.0), |(sum, count), (_, r)| (sum + r * r, count + 1.0));
            f64::sqrt(sum / f64::max(count, 1.0))
        };
        list.rms.push(RunResiduals {
            id: id.clone(),
            keypoints: trajectory.keypoints.clone(),
            before_m: (0..width).map(|k| rms(&a, k)).collect(),
            after_m: (0..width).map(|k| rms(&b, k)).collect(),
            noise_m: floor.runs[run].std_m.iter().map(|std_m| std_m.hypot(floor.stamp_m)).collect(),
        });
        let model = before.calibrated();
        let Ok(simulated) = term.rehearsal.simulate(&model, &before.point.offsets[run], term.instants) else {
            continue;
        };
        let time_s = &trajectory.time_s[..term.instants];
        motions.add(term, &a, &simulated, width);
        for keypoint in 0..width {
            for axis in 0..3 {
                let own = term
                    .observations
                    .iter()
                    .zip(&a)
                    .filter(|(o, _)| o.keypoint == keypoint && o.axis == axis);
                let series: Vec<(f64, f64)> = own.map(|(o, r)| (time_s[o.instant], *r)).collect();
                spectrum.add(&series);
            }
            worst.extend(pieces(id, &trajectory.keypoints[keypoint], term, &a, &simulated, keypoint, width));
        }
    }
    worst.sort_by(|a, b| b.rms_m.total_cmp(&a.rms_m));
    worst.truncate(WORST_LISTED);
    list.worst = worst;
    list.follows = motions.shares();
    list.frequency_hz = spectrum.peak();
    list
}

fn pieces(
    id: &str,
    name: &str,
    term: &crate::fit::problem::Term<'_>,
    residuals: &[f64],
    simulated: &[[f64; 3]],
    keypoint: usize,
    width: usize,
) -> Vec<WorstInterval> {
    let time_s = &term.rehearsal.run.trajectory.time_s;
    let mut list: Vec<(usize, f64, f64, [f64; 3])> = Vec::new();
    for (o, r) in term.observations.iter().zip(residuals).filter(|(o, _)| o.keypoint == keypoint) {
        let place = ((time_s[o.instant] - time_s[0]) / PIECE_S) as usize;
        let at = simulated[o.instant * width + keypoint];
        match list.last_mut().filter(|last| last.0 == place) {
            Some(last) => {
                last.1 += r * r;
                last.2 += 1.0;
                last.3 = std::array::from_fn(|axis| last.3[axis] + at[axis]);
            }
            None => list.push((place, r * r, 1.0, at)),
        }
    }
    let is_seen = |axis: &usize| term.observations.iter().any(|o| o.axis == *axis);
    let seen: Vec<usize> = (0..3).filter(is_seen).collect();
    let speed = |from_s: f64, to_s: f64| {
        let rows: Vec<usize> = (0..term.instants).filter(|&i| (from_s..to_s).contains(&time_s[i])).collect();
        let way: f64 = rows
            .windows(2)
            .map(|pair| {
                let [a, b] = [pair[0], pair[1]].map(|row| simulated[row * width + keypoint]);
                seen.iter().map(|&axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
            })
            .sum();
        let span = rows.last().zip(rows.first()).map_or(0.0, |(b, a)| time_s[*b] - time_s[*a]);
        if span > 0.0 { way / span } else { 0.0 }
    };
    list.into_iter()
        .map(|(place, squares, count, at)| {
            let from_s = time_s[0] + place as f64 * PIECE_S;
            let mean = |axis: usize| seen.contains(&axis).then_some(at[axis] / count);
            WorstInterval {
                run: id.to_owned(),
                keypoint: name.to_owned(),
                from_s,
                to_s: from_s + PIECE_S,
                rms_m: (squares / count).sqrt(),
                x_m: mean(0),
                y_m: mean(1),
                z_m: mean(2),
                speed_m_s: speed(from_s, from_s + PIECE_S),
            }
        })
        .collect()
}

/// Residuals beside positions, velocities and accelerations of the same coordinates.
#[derive(Default)]
struct Motions {
    residuals: Vec<f64>,
    /// Position, velocity, acceleration, sign of velocity, constant.
    regressors: [Vec<f64>; 5],
}

const REGRESSORS: [&str; 5] =
    ["position", "velocity", "acceleration", "direction of motion", "constant offset"];

impl Motions {
    fn add(
        &mut self,
        term: &crate::fit::problem::Term<'_>,
        residuals: &[f64],
        simulated: &[[f64; 3]],
        width: usize,
    ) {
        let time_s = &term.rehearsal.run.trajectory.time_s;
        for (o, &r) in term.observations.iter().zip(residuals) {
            if o.instant == 0 || o.instant + 1 >= term.instants {
                continue;
            }
            let at = |instant: usize| simulated[instant * width + o.keypoint][o.axis];
            let (before, after) =
                (time_s[o.instant] - time_s[o.instant - 1], time_s[o.instant + 1] - time_s[o.instant]);
            let (a, b) =
                ((at(o.instant) - at(o.instant - 1)) / before, (at(o.instant + 1) - at(o.instant)) / after);
            let velocity = (a + b) / 2.0;
            self.residuals.push(r);
            let numbers = [at(o.instant), velocity, (b - a) * 2.0 / (before + after), velocity.signum(), 1.0];
            self.regressors.iter_mut().zip(numbers).for_each(|(list, x)| list.push(x));
        }
    }

    /// Share of the squares that goes with each by itself.
    fn shares(&self) -> Vec<Follows> {
        let all: f64 = self.residuals.iter().map(|r| r * r).sum();
        let mut list: Vec<Follows> = REGRESSORS
            .iter()
            .zip(&self.regressors)
            .map(|(what, regressor)| {
                let product: f64 = regressor.iter().zip(&self.residuals).map(|(a, b)| a * b).sum();
                let own: f64 = regressor.iter().map(|x| x * x).sum();
                let share = product * product / (own * all).max(f64::MIN_POSITIVE);
                Follows { what: (*what).into(), share }
            })
            .collect();
        list.sort_by(|a, b| b.share.total_cmp(&a.share));
        list
    }
}

/// Power of residuals at frequencies.
#[derive(Default)]
struct Spectrum {
    power: Vec<f64>,
}

/// Resolution and highest frequency of the spectrum \[Hz\].
const STEP_HZ: f64 = 0.1;
const HIGHEST_HZ: f64 = 15.0;

impl Spectrum {
    fn add(&mut self, series: &[(f64, f64)]) {
        let times: Vec<f64> = series.iter().map(|(t, _)| *t).collect();
        let highest = HIGHEST_HZ.min(0.4 / interval_s(&times).max(1e-9));
        let count = (highest / STEP_HZ) as usize;
        self.power.resize(self.power.len().max(count), 0.0);
        for place in 0..count {
            let turn = std::f64::consts::TAU * STEP_HZ * (place + 1) as f64;
            let (c, s) = series.iter().fold((0.0, 0.0), |(c, s), (t, r)| {
                let (sin, cos) = (turn * t).sin_cos();
                (c + r * cos, s + r * sin)
            });
            self.power[place] += c * c + s * s;
        }
    }

    fn peak(&self) -> Option<f64> {
        let (place, _) = self.power.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        Some(STEP_HZ * (place + 1) as f64)
    }
}

/// What `state` leaves of the runs that `baseline` was fitted to.
pub(super) fn remainder(baseline: &State<'_>, state: &State<'_>, floor: &Floor) -> Remainder {
    let rms = |squares: &[f64]| (squares.iter().sum::<f64>() / (squares.len() as f64).max(1.0)).sqrt();
    let squares = |state: &State<'_>, run: usize| -> Vec<f64> {
        state.raw_residuals(run).into_iter().flatten().map(|x| x * x).collect()
    };
    let all = |state: &State<'_>| (0..state.terms.len()).map(|run| squares(state, run)).collect::<Vec<_>>();
    let (before, after) = (all(baseline), all(state));
    let noise = floor.noise_m.powi(2);
    let beyond = |runs: &[Vec<f64>]| (rms(&runs.concat()).powi(2) - noise).max(0.0);
    let runs = state.terms.iter().zip(&after);
    Remainder {
        rms_m: rms(&after.concat()),
        share: beyond(&after) / beyond(&before).max(f64::MIN_POSITIVE),
        runs: runs
            .map(|(term, squares)| RunRemainder { id: term.rehearsal.run.id.clone(), rms_m: rms(squares) })
            .collect(),
        force: None,
    }
}
