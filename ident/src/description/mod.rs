//! Whether the files describe the runs as they were: a diagnosis asks this before it asks what the water does.
//!
//! 1. `labels`: images that no pose of the model is like, until two labels are changed over;
//! 2. `mistakes`: axes, order, units and signs of all files alike, and releases, each as a description of its own: the model must
//!    repeat the runs as described, or it repeats them as they would be without the mistake;
//! 3. `strangers`: one run that does not belong to the others.
//!
//! Descriptions are compared by how far a quick fit is off under each. What a model gets wrong lasts for a whole run, so that each
//! coordinate of each keypoint counts once a run, with an error of unknown size: twice the error in all of them is worth one `ln 2` each. What
//! explains the runs in that way is a *suspect*; what follows works on the runs with the suspects put right.

mod labels;
mod mistakes;
mod strangers;
mod trial;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use sim::Model;

use crate::experiment::{Experiment, Run, RunKind, Use};
use crate::fit::counts::Counts;
use crate::initial::{nearest_pose, run_noise};
use crate::noise::floor::interval_s;
use ground::statistics::median;
use mistakes::Mistake;
use trial::Trial;

/// What is wrong with the description of an experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Suspect {
    /// What kind: `axes`, `order`, `servo-reversed`, `servo-degrees`, `servo-milliseconds`, `release`, `labels`, `run`.
    pub name: String,
    /// What would be so, without a capital and a full stop.
    pub sentence: String,
    /// What to do about it.
    pub check: String,
    /// The runs that it is about.
    pub runs: Vec<String>,
    /// Its probability beside the other descriptions that were tried.
    pub probability: f64,
}

/// The largest probability that is stated (chosen): what was not thought of has the rest.
const STATED_PROBABILITY_MAX: f64 = 0.999;
/// Odds of any one mistake before anything is looked at (chosen): one experiment in a hundred.
const MISTAKE_ODDS: f64 = 0.01;
/// Below this probability a mistake is none (chosen).
const PROBABILITY_MIN: f64 = 0.9;
/// Mistakes whose likelihoods are this near cannot be told apart \[nats\] (chosen).
const SAME_NATS: f64 = 3.0;
/// Errors of the model's own numbers beyond which a description is not fitted before others are tried \[nats each\] (chosen): 20 times the
/// noise, of which coefficients that are off account for a third.
const FAR_NATS: f64 = 3.0;
/// Descriptions are fitted where the model's own numbers repeat the runs nearly as well as with the best \[nats each\] (chosen): a factor
/// of two in every error.
const NEAR_NATS: f64 = 0.7;
/// Images of a run by which a description is held against the poses there are (chosen).
const POSED_IMAGES: usize = 12;
/// A description is out of the question where its images are this many times as far off any pose as those of the best (chosen), and off
/// by this many times the noise.
const POSE_RATIO_MAX: f64 = 3.0;
const POSE_NOISE_RATIO_MIN: f64 = 5.0;

/// An experiment, looked through.
#[derive(Debug, Clone)]
pub(crate) struct Examined {
    /// What is wrong with it.
    pub(crate) suspects: Vec<Suspect>,
    /// The experiment with that put right; `None`: as it is.
    pub(crate) mended: Option<Experiment>,
}

/// What is wrong with the description of `experiment`, which a check has let through; what was found until then where nobody waits any
/// longer, as `stop` says.
pub fn suspects(experiment: &Experiment, stop: Arc<AtomicBool>) -> Vec<Suspect> {
    examine(experiment, &mut Counts::until(stop)).suspects
}

/// As [`suspects`], with what follows from it.
pub(crate) fn examine(experiment: &Experiment, counts: &mut Counts) -> Examined {
    let (mut suspects, mut mended) = labels::exchanged(experiment);
    let described = mended.as_ref().unwrap_or(experiment);
    // far off, a fit would only wander
    let unfitted = trial::unfitted(described, counts);
    let is_far = unfitted.as_ref().is_none_or(|trial| trial.ln_likelihood() < -FAR_NATS * trial.count());
    // what the fitted runs leave open of the others is no mistake of theirs
    let mut together = described.clone();
    together.runs.iter_mut().for_each(|run| run.usage = Use::Fit);
    if !is_far && trial::fitted(&together, counts).is_some_and(|trial| trial.is_explained()) {
        return Examined { suspects, mended };
    }
    let mut trial = if is_far { unfitted } else { trial::fitted(described, counts).or(unfitted) };
    if trial.as_ref().is_some_and(Trial::is_explained) {
        return Examined { suspects, mended };
    }
    if let Some((suspect, better, repeated)) = mistaken(described, trial.as_ref(), counts) {
        suspects.push(suspect);
        (mended, trial) = (Some(better), Some(repeated));
    }
    if !trial.as_ref().is_some_and(Trial::is_explained)
        && let Some((suspect, others)) =
            strangers::stranger(mended.as_ref().unwrap_or(experiment), trial.as_ref(), counts)
    {
        suspects.push(suspect);
        mended = Some(others);
    }
    Examined { suspects, mended }
}

/// The mistake of all files alike that explains `experiment`, which as described comes to `trial`; with the experiment without it and
/// what that comes to.
fn mistaken(
    experiment: &Experiment,
    trial: Option<&Trial>,
    counts: &mut Counts,
) -> Option<(Suspect, Experiment, Trial)> {
    let misfit = |experiment: &Experiment| pose_misfit(&experiment.model, &experiment.runs);
    let list = counts.of_each(mistakes::all(experiment), |mistake, _| (misfit(&mistake.mended), mistake));
    let least = list.iter().map(|(misfit, _)| *misfit).fold(misfit(experiment), f64::min);
    let is_possible = |misfit: f64| misfit < POSE_NOISE_RATIO_MIN.max(POSE_RATIO_MAX * least);
    let possible = list.into_iter().filter(|(misfit, _)| is_possible(*misfit)).map(|(_, mistake)| mistake);
    let unfitted =
        |mistake: Mistake, counts: &mut Counts| Some((trial::unfitted(&mistake.mended, counts)?, mistake));
    let unfitted: Vec<(Trial, Mistake)> =
        counts.of_each(possible.collect(), unfitted).into_iter().flatten().collect();
    let best = unfitted.iter().map(|(trial, _)| trial.ln_likelihood()).reduce(f64::max)?;
    let is_near = |trial: &Trial| trial.ln_likelihood() > best - NEAR_NATS * trial.count();
    let near = unfitted.into_iter().filter(|(trial, _)| is_near(trial)).map(|(_, mistake)| mistake);
    let fitted = counts
        .of_each(near.collect(), |mistake, counts| Some((trial::fitted(&mistake.mended, counts)?, mistake)));
    let mut fitted: Vec<(Trial, Mistake)> = fitted
        .into_iter()
        .flatten()
        .filter(|(trial, mistake)| !mistake.must_explain || trial.is_explained())
        .collect();
    fitted.sort_by(|a, b| b.0.ln_likelihood().total_cmp(&a.0.ln_likelihood()));
    let best = fitted.first()?.0.ln_likelihood();
    let weight = |trial: &Trial| MISTAKE_ODDS * (trial.ln_likelihood() - best).exp();
    let all: f64 = fitted.iter().map(|(trial, _)| weight(trial)).sum();
    // as described, from what the best mistake has led the coefficients to as well: a fit that merely went astray accuses nobody
    let led = Experiment { model: fitted.first()?.0.model.clone(), ..experiment.clone() };
    let led = trial::fitted(&led, counts);
    let described = trial.into_iter().chain(&led).map(Trial::ln_likelihood).fold(f64::NEG_INFINITY, f64::max);
    let probability = all / (all + (described - best).exp());
    if probability < PROBABILITY_MIN {
        return None;
    }
    let same = fitted.iter().filter(|(trial, _)| best - trial.ln_likelihood() < SAME_NATS);
    let mut said: Vec<&Mistake> = same.map(|(_, mistake)| mistake).collect();
    // of one kind the simplest, which stands first in the list of all
    said.sort_by_key(|mistake| mistake.place);
    said.dedup_by_key(|mistake| mistake.name);
    let join =
        |part: fn(&Mistake) -> &str, word: &str| said.iter().map(|m| part(m)).collect::<Vec<_>>().join(word);
    let suspect = Suspect {
        name: said[0].name.into(),
        sentence: join(|mistake| &mistake.sentence, ", or as well: "),
        check: join(|mistake| &mistake.check, "; or "),
        runs: experiment.runs.iter().map(|run| run.id.clone()).collect(),
        probability: probability.min(STATED_PROBABILITY_MAX),
    };
    let simplest = fitted.iter().position(|(_, mistake)| mistake.place == said[0].place)?;
    let (repeated, mistake) = fitted.swap_remove(simplest);
    let suspect = match mistake.name {
        mistakes::RELEASE => releases(experiment, &repeated, suspect)?,
        _ => suspect,
    };
    Some((suspect, mistake.mended, repeated))
}

/// How far images of `runs` are off the nearest poses of `model`, over their noise: the median.
fn pose_misfit(model: &Model, runs: &[Run]) -> f64 {
    let mut all = Vec::new();
    for run in runs {
        let noise_m = run_noise(run).std_m;
        let count = run.trajectory.time_s.len();
        let mut guess = model.rest_state().qpos;
        for instant in (0..count).step_by((count / POSED_IMAGES).max(1)) {
            if let Some((pose, off_m)) = nearest_pose(model, run, (instant, noise_m), None, &guess) {
                guess = pose;
                all.push(off_m / noise_m);
            }
        }
    }
    median(&mut all, f64::total_cmp).unwrap_or(f64::INFINITY)
}

/// A release counts as stated where it is within this of what the images say, in image intervals (chosen).
const RELEASE_INTERVALS: f64 = 1.0;

/// The releases that are not when they are stated, by what `repeated` says without these; `None` where all are.
fn releases(experiment: &Experiment, repeated: &Trial, suspect: Suspect) -> Option<Suspect> {
    let mut said = Vec::new();
    let mut runs = Vec::new();
    for (run, found) in
        experiment.runs.iter().zip(&repeated.runs).filter(|(run, _)| run.kind == RunKind::Drop)
    {
        let Some(stated_s) = run.release_s else { continue };
        let early_s = found.start_s - stated_s;
        if early_s.abs() > RELEASE_INTERVALS * interval_s(&run.trajectory.time_s) {
            let how = if early_s > 0.0 { "early" } else { "late" };
            said.push(format!("{how} by {:.0} ms in {}", 1e3 * early_s.abs(), run.id));
            runs.push(run.id.clone());
        }
    }
    let sentence = format!("the stated release, `release_s`, is {}", said.join(" and "));
    (!runs.is_empty()).then_some(Suspect { sentence, runs, ..suspect })
}
