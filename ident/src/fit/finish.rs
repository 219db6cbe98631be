//! From the optimum to error bars, held-out runs and `fit.json`.

use std::borrow::Cow;

use sim::Model;

use super::checkpoint::{Ended, INTERRUPTED};
use super::constancy::constancy;
use super::counts::Counts;
use super::covariance::{Information, RunInformation, information};
use super::driver::{Arrival, best};
use super::error::FitError;
use super::fitted::FittedRun;
use super::noise::AssumedNoise;
use super::objective::Objective;
use super::problem::Point;
use super::profile::profile;
use super::repeat::{hold_out, repeat};
use super::report::{
    Combination, Fit, FittedParameter, JointInformation, NoiseEstimate, NoiseSource, RunErrors, RunValue,
    StartLoss,
};
use super::rest::rested;
use super::steadied::{Steadied, steadied};
use crate::experiment::{Experiment, Method, Use};
use crate::geometry::characteristic_length_m;
use crate::loss::{AxisError, SquaredError, keypoint_errors};
use crate::parameters::{ON_BOUND_SHARE, Parameters};

/// Losses that differ by no more than this share count as equal (chosen).
const SAME_LOSS_SHARE_MAX: f64 = 0.01;
/// Determined values that differ by no more than this many standard deviations count as equal (chosen).
const SAME_VALUE_Z_MAX: f64 = 3.0;
/// Residuals of up to this many times the noise that the images show count as noise alone (chosen).
const NOISE_ALONE_RATIO_MAX: f64 = 1.25;

pub(super) fn finish(
    experiment: &Experiment,
    objective: &Objective<'_>,
    mut arrival: Arrival,
    assumed: &AssumedNoise,
    counts: &mut Counts,
) -> Result<(Fit, Model, Vec<FittedRun>), FitError> {
    let interrupted = arrival.stop_reason == INTERRUPTED;
    let (mut shorter, mut withheld) = (None, Vec::new());
    // the paper's recipe ends where its search does
    let ends_there = experiment.fit.method == Method::Paper || interrupted;
    let steps = match ends_there {
        true => Some(Steadied::AsPlanned),
        false => steadied(objective, &arrival.point, counts),
    };
    let objective = match steps.ok_or(FitError::NoOptimum)? {
        Steadied::AsPlanned => objective,
        Steadied::Shorter(found, point) => {
            (arrival.point, arrival.linear, arrival.linearised) = (point, None, false);
            &*shorter.insert(found)
        }
        Steadied::Never(which) => {
            withheld = which;
            objective
        }
    };
    if !ends_there {
        rest(objective, &mut arrival, assumed, counts);
    }
    let (problem, point) = (&objective.problem, &arrival.point);
    let linear = match &arrival.linear {
        Some(linear) => Cow::Borrowed(&linear[..]),
        None => {
            // After a resumption what was counted before is found again.
            let (by_parameters, mut uncounted) = (!point.values.is_empty(), counts.apart());
            let counts = if arrival.linearised { &mut uncounted } else { &mut *counts };
            Cow::Owned(problem.linearise(point, by_parameters, counts).ok_or(FitError::NoOptimum)?)
        }
    };
    let mut known = information(objective, point, &linear, assumed.stated).ok_or(FitError::NoOptimum)?;
    let free = &problem.parameters.free;
    if !free.is_empty()
        && free.iter().all(|parameter| parameter.prior.is_none())
        && !known.without_effect.contains(&false)
    {
        return Err(FitError::Unseen {
            names: names(problem.parameters, &(0..free.len()).collect::<Vec<_>>()),
        });
    }
    for (i, _) in withheld.iter().enumerate().filter(|(_, withheld)| **withheld) {
        // evenly anywhere within the bounds
        known.std[i] = free[i].scale.width() / 12.0_f64.sqrt();
        known.determined[i] = false;
    }
    let (noise_m, noise_source) = noise_m(objective, &known, assumed);
    let model = problem.parameters.applied(&point.values, problem.model);
    let intervals = (experiment.fit.profile && !interrupted && !point.values.is_empty())
        .then(|| profile(objective, point, &known, counts));

    let repeated = repeated(experiment, objective, point, (&model, noise_m), (&known, assumed), counts)?;

    let fit = Fit {
        method: experiment.fit.method.name().into(),
        seed: experiment.fit.seed,
        evaluations: counts.evaluations,
        rollouts: counts.rollouts,
        stop_reason: arrival.stop_reason.clone(),
        loss_m2: repeated.loss_m2,
        noise_m,
        noise_source,
        error_m: error_m(&repeated.runs, Use::Fit),
        holdout_error_m: error_m(&repeated.runs, Use::Holdout),
        parameters: fitted_parameters(objective, point, &known, intervals.as_deref()),
        runs: repeated
            .runs
            .iter()
            .zip(&experiment.runs)
            .zip(repeated.noise)
            .map(|((run, measured), noise)| RunErrors {
                id: run.id.clone(),
                usage: run.usage,
                keypoints: keypoint_errors(&run.measured, &run.simulated.position_m, run.scored_from_s),
                lost: measured.lost.clone(),
                set_aside: measured.set_aside.clone(),
                noise,
                touch: run.touch.clone(),
            })
            .collect(),
        characteristic_length_m: characteristic_length_m(&experiment.model),
        unidentifiable: known.groups.iter().map(|group| names(problem.parameters, &group.members)).collect(),
        combinations: combinations(problem.parameters, point, &known),
        effective_parameters: known.effective,
        starts: starts(&arrival, &known, repeated.loss_m2),
        information: Some(JointInformation {
            names: names(problem.parameters, &(0..problem.parameters.len()).collect::<Vec<_>>()),
            matrix: known.joint.row_iter().map(|row| row.iter().copied().collect()).collect(),
        }),
        recalibration: None,
    };
    Ok((fit, model, repeated.runs))
}

/// Moves parameters that the runs do not determine back towards the values the fit began with.
fn rest(objective: &Objective<'_>, arrival: &mut Arrival, assumed: &AssumedNoise, counts: &mut Counts) {
    let (problem, point) = (&objective.problem, &arrival.point);
    let linear = match arrival.linear.take() {
        Some(linear) => Some(linear),
        None => problem.linearise(point, !point.values.is_empty(), &mut counts.apart()),
    };
    let known = linear.as_deref().and_then(|linear| information(objective, point, linear, assumed.stated));
    let rested = known.and_then(|known| rested(objective, point, &known, &mut counts.apart()));
    match rested {
        Some(point) => (arrival.point, arrival.linearised) = (point, false),
        None => arrival.linear = linear,
    }
}

/// Every run of an experiment with its simulation.
struct Repeated {
    runs: Vec<FittedRun>,
    /// Noise of the fitted ones.
    noise: Vec<Option<NoiseEstimate>>,
    /// Of the fitted ones \[m2\].
    loss_m2: f64,
}

/// Repeats every run of `experiment` with the calibrated `model`, held-out ones against noise of `noise_m` \[m\].
fn repeated(
    experiment: &Experiment,
    objective: &Objective<'_>,
    point: &Point,
    (model, noise_m): (&Model, f64),
    (known, assumed): (&Information, &AssumedNoise),
    counts: &mut Counts,
) -> Result<Repeated, FitError> {
    let (mut runs, mut noise, mut error) = (Vec::new(), Vec::new(), SquaredError::default());
    let mut fitted = objective.problem.terms.iter().zip(&point.offsets).zip(&known.runs);
    for run in &experiment.runs {
        if counts.is_stopped() {
            return Err(FitError::Interrupted);
        }
        if run.usage == Use::Holdout {
            noise.push(None);
            runs.push(hold_out(model, run, noise_m, (&[], 0.0), counts)?);
            continue;
        }
        let Some(((term, offsets), RunInformation { residual_noise, .. })) = fitted.next() else { continue };
        counts.rollouts += 1;
        let start_s = term.rehearsal.start_with(model, offsets).start_s;
        let repeated = repeat(model, &term.rehearsal, offsets, start_s)?;
        error.add(&run.trajectory, &repeated.simulated.position_m, start_s, run.weight);
        noise.push(Some(NoiseEstimate {
            assumed_m: assumed.of_run(run),
            residual_m: residual_noise.rms_m,
            correlation: residual_noise.correlation,
            chi2_per_degree: residual_noise.chi2_per_degree,
        }));
        runs.push(repeated);
    }
    Ok(Repeated { runs, noise, loss_m2: error.loss_m2() })
}

fn names(parameters: &Parameters, places: &[usize]) -> Vec<String> {
    places.iter().map(|&i| parameters.free[i].name().to_owned()).collect()
}

/// How far off the simulation of the runs of this use is \[m\].
fn error_m(runs: &[FittedRun], usage: Use) -> Option<f64> {
    let mut error = AxisError::default();
    for run in runs.iter().filter(|run| run.usage == usage) {
        error.add(&run.measured, &run.simulated.position_m, run.scored_from_s);
    }
    error.rms_m()
}

/// What is noise and not the model's fault \[m\], and who says so.
fn noise_m(objective: &Objective<'_>, known: &Information, assumed: &AssumedNoise) -> (f64, NoiseSource) {
    if assumed.stated {
        return (assumed.common_m, NoiseSource::Stated);
    }
    if known.runs.is_empty() {
        return (assumed.common_m, NoiseSource::Images);
    }
    let terms = &objective.problem.terms;
    let counts = || terms.iter().map(|term| term.observations.len() as f64);
    let mean_square = |squares: &dyn Fn(usize) -> f64| {
        counts().enumerate().map(|(run, count)| count * squares(run)).sum::<f64>() / counts().sum::<f64>()
    };
    let left_m = mean_square(&|run| known.runs[run].residual_noise.rms_m.powi(2)).sqrt();
    let shown_m = mean_square(&|run| assumed.of_run(terms[run].rehearsal.run).powi(2)).sqrt();
    match left_m <= NOISE_ALONE_RATIO_MAX * shown_m {
        true => (left_m, NoiseSource::Residuals),
        false => (shown_m, NoiseSource::Images),
    }
}

fn fitted_parameters(
    objective: &Objective<'_>,
    point: &Point,
    known: &Information,
    intervals: Option<&[[f64; 2]]>,
) -> Vec<FittedParameter> {
    let parameters = objective.parameters();
    let ids: Vec<String> = objective.problem.terms.iter().map(|term| term.rehearsal.run.id.clone()).collect();
    let mut list = Vec::new();
    for (i, parameter) in parameters.free.iter().enumerate() {
        let (scale, value) = (&parameter.scale, point.values[i]);
        let near = ON_BOUND_SHARE * scale.width();
        let by_run = constancy(parameters, &point.values, known, &ids, i);
        let by_run = by_run.filter(|_| known.determined[i]);
        let named = parameter.names.iter().zip(&parameter.places).zip(&parameter.shares);
        list.extend(named.map(|((name, place), share)| FittedParameter {
            name: name.clone(),
            unit: objective.problem.model.unit(*place).into(),
            value: share * value,
            std: share * known.std[i],
            lower: share * scale.lower(),
            upper: share * scale.upper(),
            at_bound: value - scale.lower() <= near || scale.upper() - value <= near,
            determined: known.determined[i],
            ci95: intervals.map(|intervals| intervals[i].map(|end| share * end)),
            per_run: by_run.as_ref().map_or(Vec::new(), |(values, _)| times(values, *share)),
            constancy: by_run.as_ref().map(|(_, test)| *test),
        }));
    }
    list
}

fn times(values: &[RunValue], share: f64) -> Vec<RunValue> {
    let one = |value: &RunValue| RunValue {
        run: value.run.clone(),
        value: share * value.value,
        std: share * value.std,
    };
    values.iter().map(one).collect()
}

fn combinations(parameters: &Parameters, point: &Point, known: &Information) -> Vec<Combination> {
    let mut list = Vec::new();
    for (number, group) in known.groups.iter().enumerate() {
        let named = |weights: &[f64]| {
            let pairs = group.members.iter().zip(weights).filter(|(_, weight)| **weight != 0.0);
            pairs.map(|(&i, &weight)| (parameters.free[i].name().to_owned(), weight)).collect()
        };
        for (weights, std) in &group.determined {
            let value = group.members.iter().zip(weights).map(|(&i, weight)| weight * point.values[i]).sum();
            let weights = named(weights);
            list.push(Combination {
                group: number,
                seen: true,
                weights,
                value: Some(value),
                std: Some(*std),
            });
        }
        for weights in &group.undetermined {
            let weights = named(weights);
            list.push(Combination { group: number, seen: false, weights, value: None, std: None });
        }
    }
    list
}

/// Whether the starts agree with the best of them, whose loss is `loss_m2`.
fn starts(arrival: &Arrival, known: &Information, loss_m2: f64) -> Vec<StartLoss> {
    let Some(best) = best(&arrival.ended) else { return Vec::new() };
    let agrees = |ended: &Ended| {
        let same_loss =
            ended.cost.zip(best.cost).is_some_and(|(cost, best)| cost <= best * (1.0 + SAME_LOSS_SHARE_MAX));
        let values = ended.point.values.iter().zip(&best.point.values).zip(&known.std).zip(&known.determined);
        same_loss
            && values
                .into_iter()
                .all(|(((a, b), std), determined)| !determined || (a - b).abs() <= SAME_VALUE_Z_MAX * std)
    };
    let start = |ended: &Ended| StartLoss {
        from: ended.origin,
        loss_m2: ended.cost.zip(best.cost).map(|(cost, best)| cost / best * loss_m2),
        agrees: agrees(ended),
    };
    arrival.ended.iter().map(start).collect()
}
