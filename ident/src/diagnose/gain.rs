//! The gain on runs that nothing was fitted to: parameters frozen, the pose from the still images alone.

use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sim::Model;

use super::result::{HeldOut, HeldOutRun};
use crate::experiment::{Experiment, Run, Use};
use crate::fit::FittedRun;
use crate::fit::counts::Counts;
use crate::fit::repeat::hold_out;
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;
use crate::noise::pose::PoseErrors;
use crate::simulate::Nuisance;

/// Bootstrap samples.
const BOOTSTRAP_SAMPLES: usize = 2000;
/// Runs from which on whole runs are drawn; with fewer, pieces of them.
const WHOLE_RUNS_FROM: usize = 6;
/// Steps from the optimum of all runs to that of all but one.
const MOST_STEPS: usize = 2;
/// What of a run the numbers that it has its own of are told by, where there are any: the rest is scored.
const SEEN_SHARE: f64 = 0.5;
/// Length of a piece \[s\].
const PIECE_S: f64 = 0.5;

/// How the gain is measured where runs were held out.
const HOLDOUT: &str = "holdout";

/// Squares of residuals of one piece: before, after, count.
type Piece = [f64; 3];

/// A run that nothing was fitted to, and what predicts it.
struct Test<'a> {
    run: &'a Run,
    /// Before and after.
    models: [Model; 2],
    /// What each run has its own of, before and after.
    own: &'a [Vec<Nuisance>; 2],
    /// Noise of each keypoint \[m\] that is known.
    std_m: &'a [f64],
}

/// What a run has shown, and its pieces.
type Tested = (HeldOutRun, Vec<Piece>);

impl Test<'_> {
    /// `None` where it cannot be simulated.
    fn carry_out(&self, floor: &Floor, counts: &mut Counts) -> Option<Tested> {
        // both know as much of the run beforehand
        let seen_share = if self.own.iter().all(Vec::is_empty) { 0.0 } else { SEEN_SHARE };
        let predicted = |(model, own): (&Model, &Vec<Nuisance>), counts: &mut Counts| {
            hold_out(model, self.run, floor.noise_m, (own, seen_share), counts).ok()
        };
        let predicted = counts.of_each(self.models.iter().zip(self.own).collect(), predicted);
        let [Some(before), Some(after)] = &predicted[..] else { return None };
        let pose = PoseErrors::of(&self.run.trajectory);
        let pose_m = pose.map_or(0.0, |errors| errors.rms_m());
        let more_m = pose_m.hypot(floor.stamp_m);
        let keypoints = 0..self.run.trajectory.keypoints.len();
        let rms = |fitted: &FittedRun| keypoints.clone().map(|k| rms_m(fitted, k)).collect();
        let shown = HeldOutRun {
            id: self.run.id.clone(),
            keypoints: self.run.trajectory.keypoints.clone(),
            rms_before_m: rms(before),
            rms_after_m: rms(after),
            noise_floor_m: keypoints
                .clone()
                .map(|k| self.std_m.get(k).unwrap_or(&floor.noise_m).hypot(more_m))
                .collect(),
        };
        Some((shown, in_pieces(before, after)))
    }
}

/// Errors of `before` and `after` on held-out runs; where there are none, on each fitted run with both refitted to the
/// others. `None` where that cannot be done.
pub(super) fn gain(
    experiment: &Experiment,
    before: &State<'_>,
    after: &State<'_>,
    floor: &Floor,
    counts: &mut Counts,
) -> Option<HeldOut> {
    let held: Vec<&Run> = experiment.runs.iter().filter(|run| run.usage == Use::Holdout).collect();
    let own = [before, after].map(|state| state.own().into_iter().map(|(_, nuisance)| nuisance).collect());
    let own: &[Vec<Nuisance>; 2] = &own;
    let how = if held.is_empty() { "leave-one-out" } else { HOLDOUT };
    let tests: Vec<Test<'_>> = if held.is_empty() {
        if before.terms.len() < 2 {
            return None;
        }
        let each = 0..before.terms.len();
        each.filter_map(|left_out| {
            let [before_it, after_it] = [before, after].map(|state| without(state, left_out, counts));
            let run = before.terms[left_out].rehearsal.run;
            Some(Test { run, models: [before_it?, after_it?], own, std_m: &floor.runs[left_out].std_m })
        })
        .collect()
    } else {
        let models = [before.calibrated(), after.calibrated()];
        held.into_iter().map(|run| Test { run, models: models.clone(), own, std_m: &[] }).collect()
    };
    let tested = counts.of_each(tests, |test, own| test.carry_out(floor, own));
    let (runs, pieces): (Vec<HeldOutRun>, Vec<Vec<Piece>>) = tested.into_iter().flatten().unzip();
    let squared = runs.iter().flat_map(|run| &run.noise_floor_m).map(|std_m| std_m * std_m);
    let noise = [squared.clone().sum::<f64>(), squared.count() as f64];
    let sum = |list: &[&Piece]| {
        list.iter().fold([0.0; 3], |sum, piece| [sum[0] + piece[0], sum[1] + piece[1], sum[2] + piece[2]])
    };
    let all: Vec<&Piece> = pieces.iter().flatten().collect();
    let [a, b, count] = sum(&all);
    if count == 0.0 || a == 0.0 {
        return None;
    }
    let whole: Vec<Piece> = pieces.iter().map(|run| sum(&run.iter().collect::<Vec<_>>())).collect();
    let drawn: Vec<&Piece> = if whole.len() >= WHOLE_RUNS_FROM { whole.iter().collect() } else { all };
    let gain = |[a, b, _]: [f64; 3]| 1.0 - (b / a.max(f64::MIN_POSITIVE)).sqrt();
    let mut random = ChaCha8Rng::seed_from_u64(experiment.fit.seed);
    let mut gains: Vec<f64> = (0..BOOTSTRAP_SAMPLES)
        .map(|_| {
            let sample: Vec<&Piece> =
                (0..drawn.len()).map(|_| drawn[random.random_range(0..drawn.len())]).collect();
            gain(sum(&sample))
        })
        .collect();
    gains.sort_by(f64::total_cmp);
    let quantile = |share: f64| gains[((BOOTSTRAP_SAMPLES - 1) as f64 * share).round() as usize];
    Some(HeldOut {
        rms_before_m: (a / count).sqrt(),
        rms_after_m: (b / count).sqrt(),
        noise_floor_m: (noise[0] / f64::max(noise[1], 1.0)).sqrt(),
        gain: gain([a, b, count]),
        gain_ci95: [quantile(0.025), quantile(0.975)],
        how: how.into(),
        runs,
    })
}

impl HeldOut {
    /// Whether what is named may as well gain nothing on runs that it was not fitted to.
    pub(super) fn may_be_none(&self) -> bool {
        self.gain_ci95[0] <= 0.0
    }
}

/// The model of `state` fitted to all runs but one.
fn without(state: &State<'_>, left_out: usize, counts: &mut Counts) -> Option<Model> {
    let mut state = state.clone();
    state.terms.remove(left_out);
    if left_out < state.linear.len() {
        state.linear.remove(left_out);
    }
    state.point.offsets.remove(left_out);
    state.steps(MOST_STEPS, counts).then(|| state.calibrated())
}

fn cells(fitted: &FittedRun) -> impl Iterator<Item = (f64, usize, f64)> + '_ {
    let width = fitted.measured.keypoints.len();
    let from_s = fitted.scored_from_s;
    let rows = fitted.measured.time_s.iter().enumerate().filter(move |(_, t)| **t >= from_s);
    rows.flat_map(move |(row, &time_s)| {
        (0..width).flat_map(move |k| {
            let (m, s) = (fitted.measured.at(row, k), fitted.simulated.at(row, k));
            (0..3).map(move |axis| (time_s, k, m[axis] - s[axis]))
        })
    })
    .filter(|(.., residual)| residual.is_finite())
}

fn rms_m(fitted: &FittedRun, keypoint: usize) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (.., residual) in cells(fitted).filter(|(_, k, _)| *k == keypoint) {
        sum += residual * residual;
        count += 1.0;
    }
    (sum / f64::max(count, 1.0)).sqrt()
}

fn in_pieces(before: &FittedRun, after: &FittedRun) -> Vec<Piece> {
    let from_s = before.scored_from_s.min(after.scored_from_s);
    let mut pieces: Vec<Piece> = Vec::new();
    let mut add = |time_s: f64, add: Piece| {
        let place = ((time_s - from_s) / PIECE_S).max(0.0) as usize;
        if pieces.len() <= place {
            pieces.resize(place + 1, [0.0; 3]);
        }
        pieces[place].iter_mut().zip(add).for_each(|(sum, x)| *sum += x);
    };
    for (time_s, _, residual) in cells(before) {
        add(time_s, [residual * residual, 0.0, 1.0]);
    }
    for (time_s, _, residual) in cells(after) {
        add(time_s, [0.0, residual * residual, 0.0]);
    }
    pieces.retain(|piece| piece[2] > 0.0);
    pieces
}
