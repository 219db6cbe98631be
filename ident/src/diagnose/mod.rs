//! From runs that a simulation does not repeat to the reason why.
//!
//! [`diagnose`] has `crate::evidence` compare every set of causes that a simulation may lack ([`sim::causes`]), an unknown force in each, and says
//! what follows from it:
//!
//! 1. [`crate::description`]: whether the files describe the runs as they were; what follows is about the runs with that put right;
//! 2. `baseline`, `crate::noise::floor`: the model as it stands, fitted, and how large and how lasting the keypoints' noise is;
//! 3. `crate::evidence`: which causes explain the runs, and what is left that none does;
//! 4. `verdict`, `words`: what is named, with which sizes, and what is not; `unknown_force`: the force that would account for the rest;
//! 5. `gain`, `heldout`, `goodness`, `constancy`, `bent`, `detect`, `residuals`: numbers of the report, which decide nothing but that what is
//!    named must gain on runs that it was not fitted to; `remarks`: what of the set-up may mislead; `next`: the next run.
//!
//! ```no_run
//! use ident::{diagnose, experiment::Experiment};
//!
//! let experiment = Experiment::read("experiment.toml".as_ref())?;
//! let diagnosed = diagnose::diagnose(&experiment, &mut ())?;
//! println!("{}", diagnosed.diagnosis.sentence);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub(crate) mod baseline;
mod bent;
mod constancy;
mod detect;
mod error;
mod force;
mod gain;
mod goodness;
mod heldout;
mod next;
mod remarks;
mod residuals;
mod result;
mod unknown_force;
mod verdict;
mod words;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use sim::Model;

pub use crate::noise::floor::RunFloor;
pub use error::DiagnoseError;
pub use force::{ForceCurve, JointForce, Resembled, RestCurve, UnknownForce};
pub use next::Next;
pub use result::{
    Alternative, Bent, CauseParameter, ConstancyTest, Detectable, Diagnosis, Follows, GoodnessOfFit, HeldOut,
    HeldOutRun, NamedCause, NextExperiment, NoiseFloor, PerRun, Remainder, Residuals, RunRemainder,
    RunResiduals, Unknown, Verdict, Whiteness, WorstInterval,
};

use crate::description;
use crate::design::{self, Prospect};
use crate::evidence::{Found, evidence};
use crate::experiment::Experiment;
use crate::fit::counts::Counts;
use crate::fit::{FittedRun, Timing};
use crate::hypothesis::candidates;
use crate::hypothesis::state::State;
use crate::initial::free_parameters;
use crate::noise::floor::Floor;
use ground::names::did_you_mean;

/// Told what the diagnosis is at.
pub trait Observer {
    /// Whether to go on; `stage` says with what.
    fn stage(&mut self, stage: &str) -> bool;

    /// Becomes true when nobody waits for more than what the search has found. Asked for once; looked at before every simulation, by all
    /// threads, so that a search ends in the midst of a stage too.
    fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::default()
    }
}

/// Watches nothing.
impl Observer for () {
    fn stage(&mut self, _: &str) -> bool {
        true
    }
}

/// A diagnosis, and what goes with it.
#[derive(Debug, Clone)]
pub struct Diagnosed {
    /// `diagnosis.json`.
    pub diagnosis: Diagnosis,
    /// The calibrated model with what is named; without any cause where nothing is.
    pub model: Model,
    /// Fitted runs beside the baseline.
    pub before: Vec<FittedRun>,
    /// Fitted runs beside [`Diagnosed::model`], or beside the partial description.
    pub after: Vec<FittedRun>,
    /// The runs of [`Diagnosis::next_experiments`] in their order, without what needs no run.
    pub next: Vec<Next>,
    /// How long it took.
    pub timing: Timing,
    /// Runs simulated; several that share a pass count each.
    pub rollouts: u64,
}

/// Runs that would pin down the fitted parameters `names`, best first, those of the first name before those of the next.
///
/// # Errors
/// [`DiagnoseError`], for instance for a name that is not fitted.
pub fn pin_down(
    experiment: &Experiment,
    names: &[String],
) -> Result<(Vec<NextExperiment>, Vec<Next>), DiagnoseError> {
    let mut counts = Counts::default();
    let (state, floor, which) = settled(experiment, names, &mut counts)?;
    Ok(next::pinning(experiment, &state, &floor, (names, &which), &counts))
}

/// What the runs that could be made would leave open of the fitted parameters `names`, in the order in which they are tried; none where the
/// runs there are leave everything open.
///
/// # Errors
/// As [`pin_down`].
pub fn prospects(experiment: &Experiment, names: &[String]) -> Result<Vec<Prospect>, DiagnoseError> {
    let mut counts = Counts::default();
    let (state, floor, which) = settled(experiment, names, &mut counts)?;
    let found = design::pinning(experiment, &state, &floor, &which, &counts);
    Ok(found.map_or(Vec::new(), |(_, prospects)| prospects))
}

/// The fitted baseline with its noise floor, and where the fitted parameters `names` stand in it.
fn settled<'a>(
    experiment: &'a Experiment,
    names: &[String],
    counts: &mut Counts,
) -> Result<(State<'a>, Floor, Vec<usize>), DiagnoseError> {
    experiment.check()?;
    let parameters = free_parameters(&experiment.model, experiment)?;
    let place = |name: &String| {
        parameters.free.iter().position(|p| p.names.contains(name)).ok_or_else(|| {
            let known: Vec<String> = parameters.free.iter().flat_map(|p| p.names.clone()).collect();
            DiagnoseError::NotFitted { name: name.clone(), hint: did_you_mean(name, &known) }
        })
    };
    let which: Vec<usize> = names.iter().map(place).collect::<Result<_, _>>()?;
    let (state, floor) = baseline::baseline(experiment, parameters, counts)?;
    Ok((state, floor, which))
}

/// The force that the model as it stands, fitted, lacks, where one helps on runs that it was not fitted to: see [`UnknownForce`].
///
/// # Errors
/// [`DiagnoseError`].
pub fn unknown_force(experiment: &Experiment) -> Result<Option<UnknownForce>, DiagnoseError> {
    experiment.check()?;
    let parameters = free_parameters(&experiment.model, experiment)?;
    let candidates = candidates::possible(experiment, &candidates::fitted(&experiment.model, &parameters));
    let mut counts = Counts::default();
    let (state, floor) = baseline::baseline(experiment, parameters, &mut counts)?;
    Ok(unknown_force::unknown_force(experiment, &state, &candidates, &floor, &mut counts))
}

/// A noise floor that differs by more than this share beside the best explanation is worth another search (chosen).
const OTHER_FLOOR_SHARE: f64 = 0.2;
/// What of the time limit the search may take: what it finds is to be described as well.
const SEARCH_SHARE: f64 = 0.75;

/// Says what the simulation of `experiment` gets wrong. Where its limit is over, or the observer has had enough, that is the best so
/// far.
///
/// # Errors
/// [`DiagnoseError`]; [`DiagnoseError::Interrupted`] where the observer has had enough before the model is fitted.
pub fn diagnose(experiment: &Experiment, observer: &mut dyn Observer) -> Result<Diagnosed, DiagnoseError> {
    let counts = Counts::until(observer.interrupted());
    diagnosed(experiment, counts, observer)
}

fn diagnosed(
    experiment: &Experiment,
    mut counts: Counts,
    observer: &mut dyn Observer,
) -> Result<Diagnosed, DiagnoseError> {
    let began = Instant::now();
    experiment.check()?;
    let interrupted = || Err(DiagnoseError::Interrupted);
    if !observer.stage("looking through the files") {
        return interrupted();
    }
    let description::Examined { suspects, mended } = description::examine(experiment, &mut counts);
    if counts.is_stopped() {
        return interrupted();
    }
    // what follows is about the runs as they would be without the suspects
    let experiment = mended.as_ref().unwrap_or(experiment);
    let parameters = free_parameters(&experiment.model, experiment)?;
    let fitted = candidates::fitted(&experiment.model, &parameters);
    if !observer.stage("fitting the baseline") {
        return interrupted();
    }
    let fitted_model = baseline::baseline(experiment, parameters, &mut counts);
    if counts.is_stopped() {
        return interrupted();
    }
    let (mut baseline, mut floor) = fitted_model?;
    let limit = |share: f64| Duration::try_from_secs_f64(share * experiment.diagnose.limit_s.get());
    let by = |counts: Counts, share: f64| match limit(share).ok().and_then(|limit| began.checked_add(limit)) {
        Some(deadline) => counts.by(deadline),
        None => counts,
    };
    let mut searching = by(counts.apart(), SEARCH_SHARE);
    let mut says = |set: &str| observer.stage(&format!("trying {set}"));
    let mut found = evidence(experiment, &baseline, &floor, None, &mut searching, &mut says)?;
    // noise is what the best explanation leaves, not what a model leaves that lacks something
    let left = baseline::seen_floor(&found.leader)?;
    if !searching.is_stopped() && !baseline::is_same(&floor, &left, OTHER_FLOOR_SHARE) {
        let mut again = baseline.clone();
        again.weigh(&left);
        if again.descend(&mut searching) {
            let once_more = evidence(experiment, &again, &left, Some(&found), &mut searching, &mut says)?;
            if once_more.evidence.complete || !found.evidence.complete {
                (baseline, floor, found) = (again, left, once_more);
            }
        }
    }
    let mut checking = match counts.is_stopped() {
        true => counts.for_last_words(),
        false => by(counts.clone(), 1.0),
    };
    checking.add(&searching);
    observer.stage("checking");
    let mut diagnosis = verdict::verdict(experiment, &fitted, &baseline, &found, &floor, &mut checking);
    diagnosis.complete &= !checking.is_stopped();
    observer.stage("planning the next run");
    let Found { leader, named, rival, .. } = found;
    let rivals = (&leader, rival.as_ref());
    let (advice, next) = next::next(experiment, &baseline, rivals, &floor, &diagnosis, &checking);
    diagnosis.next_experiments = advice;
    if !diagnosis.complete {
        diagnosis.remarks.push(remarks::ended_early(experiment.diagnose.limit_s.get()));
    }
    diagnosis.lead_with(suspects);
    let (model, after) = match diagnosis.verdict {
        Verdict::NothingDetectable => (baseline.calibrated(), baseline.repeated()),
        Verdict::Ambiguous => (leader.expected(), leader.repeated()),
        // a model is handed on with what other runs confirm, or without any cause
        Verdict::Unexplained if diagnosis.established.is_empty() => (baseline.calibrated(), named.repeated()),
        _ => (named.expected(), named.repeated()),
    };
    Ok(Diagnosed {
        before: baseline.repeated(),
        after,
        diagnosis,
        model,
        next,
        timing: Timing { wall: began.elapsed(), threads: rayon::current_num_threads() },
        rollouts: checking.rollouts,
    })
}
