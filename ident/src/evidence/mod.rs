//! From runs that a simulation does not repeat to the reason why, by one evidence with an unknown in every hypothesis.
//!
//! keypoints = h(coefficients, causes, starts) + unknown + noise. A hypothesis is a set of causes in forms; its score is the logarithm of
//! its evidence; the unknown (a force, a slip that nobody has a name for) stands in every one of them, the empty one too, and its
//! scales, each perhaps 0, are found by evidence. See `docs/evidence.md`.
//!
//! Files, each of which knows only those before it: `bounded` (least squares within bounds), `atoms` (causes in forms), `columns` (forms as columns), `unknown` (the unknown's columns), `linear`
//! (a hypothesis at a point), `priors` (what is believed of all that is common), `gram` (products, what is common eliminated), `score` (the evidence), `fit` (a hypothesis at its optimum),
//! `search` (the pool, best first), `verdict` (what the pool says).
//!
//! # Source
//! M. C. Kennedy, A. O'Hagan, "Bayesian calibration of computer models", Journal of the Royal Statistical Society B 63 (2001) 425-464, for
//! a discrepancy beside the model; D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992) 415-447, for its scales.

mod atoms;
mod bounded;
mod columns;
mod fit;
mod gram;
mod linear;
mod priors;
mod score;
mod search;
mod unknown;
mod verdict;

use std::time::Instant;

pub use atoms::Form;
pub use verdict::{Evidence, FoundCause, Size, Standing};

use crate::diagnose::{DiagnoseError, Observer, baseline};
use crate::experiment::Experiment;
use crate::fit::FitError;
use crate::fit::counts::Counts;
use crate::initial::free_parameters;

/// What the floor's noise is known to at best, as a share of it: rounding and tails of real noise (a prototype, chosen).
const NOISE_SHARE_LEAST: f64 = 0.02;

/// Says what the simulation of `experiment` gets wrong. Where its limit is over, or the observer has had enough, that is what the pool holds
/// by then.
///
/// # Errors
/// [`DiagnoseError`]; [`DiagnoseError::Interrupted`] where the observer has had enough before the model is fitted.
pub fn evidence(experiment: &Experiment, observer: &mut dyn Observer) -> Result<Evidence, DiagnoseError> {
    let began = Instant::now();
    experiment.check()?;
    let parameters = free_parameters(&experiment.model, experiment)?;
    let atoms = atoms::Atoms::new(experiment, &parameters);
    if !observer.stage("fitting the baseline") {
        return Err(DiagnoseError::Interrupted);
    }
    let mut counts = Counts::until(observer.interrupted());
    let (state, floor) = baseline::baseline(experiment, parameters, &mut counts)?;
    let noise_share = (floor.noise_std_m / floor.noise_m).max(NOISE_SHARE_LEAST);
    let mut counts = {
        let mut limited = search::by(experiment.diagnose.limit_s.get(), began, &counts);
        limited.add(&counts);
        limited
    };
    let bench = linear::Bench::new(state, atoms, &mut counts).ok_or(FitError::NoOptimum)?;
    let mut pool = search::Pool::new(fit::Fitter::new(&bench, noise_share));
    let complete = pool.search(&mut counts, &mut |text| observer.stage(text));
    let found = verdict::verdict(&pool, complete).ok_or(FitError::NoOptimum)?;
    Ok(Evidence { rollouts: counts.rollouts, ..found })
}
