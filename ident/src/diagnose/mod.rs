//! From runs that a simulation does not repeat to the reason why.
//!
//! [`diagnose`] fits the model as it stands, the *baseline*, and asks of every cause that a simulation may lack
//! ([`sim::causes`]) whether it would explain what is left, all fitted coefficients and starts following:
//!
//! 1. `baseline`, `crate::noise::floor`: the optimum, and how large and how lasting the keypoints' noise is, which must not swallow
//!    what the model gets wrong;
//! 2. `crate::hypothesis`: exact derivatives of every cause at neutral, what the baseline could do projected out;
//! 3. `sets`, `refit`, `search`: the best refitted in full, sets of up to three, each earning its place by the BIC, in one element or
//!    in all; `scan`: causes too strong to be seen in derivatives; `rivals`: what explains the runs about as well, held-out ones included;
//! 4. `gates`, `heldout`: what is left must be noise, on held-out runs too, and each named number the same in all runs:
//!    otherwise the description is none of a cause, and the verdict `unexplained`;
//! 5. `intervals`, `gain`, `detect`, `residuals`: values with intervals, which coefficients had bent, the gain on runs not
//!    fitted to, what would have been seen; `remarks`: what of the set-up may mislead.
//!
//! ```no_run
//! use ident::{diagnose, experiment::Experiment};
//!
//! let experiment = Experiment::read("experiment.toml".as_ref())?;
//! let diagnosed = diagnose::diagnose(&experiment, &mut ())?;
//! println!("{}", diagnosed.diagnosis.sentence);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod baseline;
mod detect;
mod error;
mod established;
mod gain;
mod gates;
mod heldout;
mod intervals;
mod next;
mod refit;
mod remarks;
mod residuals;
mod result;
mod rivals;
mod scan;
mod search;
mod sets;
mod verdict;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use sim::Model;

pub use crate::noise::floor::RunFloor;
pub use error::DiagnoseError;
pub use next::Next;
pub use result::{
    Alternative, Bent, CauseParameter, ConstancyTest, Detectable, Diagnosis, Follows, GoodnessOfFit, HeldOut,
    HeldOutRun, NamedCause, NextExperiment, NoiseFloor, PerRun, Remainder, Residuals, RunRemainder,
    RunResiduals, Verdict, Whiteness, WorstInterval,
};

use crate::experiment::Experiment;
use crate::fit::counts::Counts;
use crate::fit::{FittedRun, Timing};
use crate::hypothesis::candidates;
use crate::initial::free_parameters;
use crate::names::did_you_mean;

/// Told what the diagnosis is at.
pub trait Observer {
    /// Whether to go on; `stage` says with what.
    fn stage(&mut self, stage: &str) -> bool;

    /// Becomes true when nobody waits for the diagnosis any longer. Asked for once; looked at before every simulation, by all
    /// threads, so that a diagnosis ends in the midst of a stage too.
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
    experiment.check()?;
    let parameters = free_parameters(&experiment.model, experiment)?;
    let mut counts = Counts::default();
    let (state, floor) = baseline::baseline(experiment, parameters, &mut counts)?;
    let known: Vec<String> = state.parameters.free.iter().flat_map(|p| p.names.clone()).collect();
    if let Some(name) = names.iter().find(|name| !known.contains(name)) {
        return Err(DiagnoseError::NotFitted { name: name.clone(), hint: did_you_mean(name, &known) });
    }
    Ok(next::pinning(experiment, &state, &floor, names, &counts))
}

/// Says what the simulation of `experiment` gets wrong.
///
/// # Errors
/// [`DiagnoseError`]; [`DiagnoseError::Interrupted`] soon after the observer has had enough.
pub fn diagnose(experiment: &Experiment, observer: &mut dyn Observer) -> Result<Diagnosed, DiagnoseError> {
    let counts = Counts::until(observer.interrupted());
    let diagnosed = diagnosed(experiment, counts.apart(), observer);
    // a diagnosis that was stopped has found that nothing can be simulated, whatever it makes of that
    if counts.is_stopped() { Err(DiagnoseError::Interrupted) } else { diagnosed }
}

fn diagnosed(
    experiment: &Experiment,
    mut counts: Counts,
    observer: &mut dyn Observer,
) -> Result<Diagnosed, DiagnoseError> {
    let began = Instant::now();
    experiment.check()?;
    let parameters = free_parameters(&experiment.model, experiment)?;
    let fitted = candidates::fitted(&experiment.model, &parameters);
    let mut stage = |text: &str| observer.stage(text);
    if !stage("fitting the baseline") {
        return Err(DiagnoseError::Interrupted);
    }
    let (mut baseline, mut floor) = baseline::baseline(experiment, parameters, &mut counts)?;
    let mut search = sets::Search::new(experiment, &fitted, &floor, counts.apart(), &mut stage);
    let mut found = search.run(&baseline)?;
    if !found.leader.causes.is_empty() {
        let everywhere = !found.is_clear(&baseline);
        let seed = experiment.fit.seed;
        let deeper = baseline::deeper(&baseline, &found.leader, everywhere, seed, &mut search.counts);
        if let Some(deeper) = deeper {
            (floor, baseline) = (baseline::seen_floor(&deeper)?, deeper);
            search.weigh(&mut baseline, &floor);
            found = search.run(&baseline)?;
        }
        let is_clear = found.is_clear(&baseline);
        found = search.with_noise_seen(&mut baseline, &mut floor, found, is_clear)?;
    }
    let explained = baseline.cost - found.leader.cost;
    let left = gates::goodness_of_fit(&found.leader, &floor);
    let objected = left.objects(explained, &floor, baseline.count());
    let stands_in = rivals::stands_in(&found.leader);
    if objected || explained > sets::FAR_BENT_COST && (stands_in || !found.is_clear(&baseline)) {
        let most = if objected { sets::MOST_CAUSES } else { found.leader.causes.len() };
        search.run_anew(&baseline, &mut found, most)?;
        found = search.with_noise_seen(&mut baseline, &mut floor, found, true)?;
    }
    if explained > sets::FAR_BENT_COST && search.settle(&baseline, &mut found) {
        found = search.with_noise_seen(&mut baseline, &mut floor, found, true)?;
    }
    if !found.leader.causes.is_empty() {
        search.says("asking where it sits")?;
        search.place(&baseline, &mut found);
    }
    search.says("comparing what is nearly as good")?;
    let contest = rivals::contest(experiment, &mut found, &floor, &mut search.counts);
    search.says("checking")?;
    counts.add(&search.counts);
    let (mut diagnosis, leader, established) =
        verdict::verdict(experiment, &fitted, &baseline, (&found, contest), &floor, &mut counts);
    search.says("planning the next run")?;
    let (advice, next) = next::next(experiment, &baseline, &found, &floor, &diagnosis, &counts);
    diagnosis.next_experiments = advice;
    let model = match (&established, diagnosis.causes.is_empty()) {
        (_, false) => leader.calibrated(),
        (Some(state), true) => state.calibrated(),
        (None, true) => baseline.calibrated(),
    };
    Ok(Diagnosed {
        before: baseline.repeated(),
        after: leader.repeated(),
        diagnosis,
        model,
        next,
        timing: Timing { wall: began.elapsed(), threads: rayon::current_num_threads() },
        rollouts: counts.rollouts,
    })
}
