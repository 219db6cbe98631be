//! From runs that a simulation does not repeat to the reason why, by one evidence with an unknown in every hypothesis.
//!
//! keypoints = h(coefficients, causes, starts) + unknown + noise. A hypothesis is a set of causes in forms; its score is the logarithm of
//! its evidence; the unknown (a force, a slip that nobody has a name for) stands in every one of them, the empty one too, and its
//! scales, each perhaps 0, are found by evidence. See `docs/evidence.md`.
//!
//! Files, each of which knows only those before it: `bounded` (least squares within bounds), `atoms` (causes in forms), `columns` (forms as columns), `unknown` (the unknown's columns), `linear`
//! (a hypothesis at a point), `priors` (what is believed of all that is common), `gram` (products, what is common eliminated), `score` (the evidence), `fit` (a hypothesis at its optimum),
//! `search` (the pool, best first), `verdict` (what the pool says), `described` (a set as a fitted model).
//!
//! # Source
//! M. C. Kennedy, A. O'Hagan, "Bayesian calibration of computer models", Journal of the Royal Statistical Society B 63 (2001) 425-464, for
//! a discrepancy beside the model; D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4 (1992) 415-447, for its scales.

mod atoms;
mod bounded;
mod columns;
mod described;
mod fit;
mod gram;
mod linear;
mod priors;
mod score;
mod search;
mod unknown;
mod verdict;

pub(crate) use atoms::Form;
pub(crate) use verdict::{Evidence, FoundCause, Standing};

use crate::experiment::{Experiment, RunKind};
use crate::fit::FitError;
use crate::fit::counts::Counts;
use crate::hypothesis::held_out::held_out;
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;

/// What the floor's noise is known to at best, as a share of it: rounding and tails of real noise (a prototype, chosen).
const NOISE_SHARE_LEAST: f64 = 0.02;

/// What the runs say, and the models that say it.
pub(crate) struct Found<'a> {
    pub(crate) evidence: Evidence,
    /// The runs that were asked, as [`Form::OneRun`] counts them: the fitted ones, then the others.
    pub(crate) run_ids: Vec<String>,
    /// The best set of causes, fitted.
    pub(crate) leader: State<'a>,
    /// What is named, fitted alone.
    pub(crate) named: State<'a>,
    /// The best set that holds another cause than the leader.
    pub(crate) rival: Option<State<'a>>,
    /// The best set, and where.
    best: (Vec<usize>, linear::Point),
}

/// What explains the runs of `experiment` beside `baseline`, the model as it stands, fitted, with the noise of `floor`. All runs are asked what
/// is at work, held-out ones too; how large it is, and all else that is fitted, the fitted ones say alone. Where `counts` is stopped, that is
/// what the pool holds by then. `from`: what was found with another floor, where the search begins. `says` is told what is tried, and says whether to go on.
///
/// # Errors
/// [`FitError::NoOptimum`] where the baseline cannot be simulated.
pub(crate) fn evidence<'a>(
    experiment: &'a Experiment,
    baseline: &State<'a>,
    floor: &Floor,
    from: Option<&Found<'a>>,
    counts: &mut Counts,
    says: &mut dyn FnMut(&str) -> bool,
) -> Result<Found<'a>, FitError> {
    let own = State { linear: Vec::new(), ..baseline.clone() };
    let all = held_out(experiment, baseline, floor).and_then(|(held, _)| {
        let mut together = own.clone();
        together.terms.extend(held.terms);
        together.point.offsets.extend(held.point.offsets);
        // an optimum of all runs: what is missing to it would count for the causes
        together.descend(counts).then_some(together)
    });
    let noise_share = (floor.noise_std_m / floor.noise_m).max(NOISE_SHARE_LEAST);
    // held-out runs that cannot be simulated, or whose derivatives outgrow all numbers, are not asked
    for asked in all.into_iter().chain([own]) {
        let kinds: Vec<RunKind> = asked.terms.iter().map(|term| term.rehearsal.run.kind).collect();
        let atoms = atoms::Atoms::new(experiment, &kinds, &baseline.parameters);
        // what every answer begins with is worked out however little time there is
        let mut first = Counts::default();
        let bench = linear::Bench::new(asked, atoms, &mut first).ok_or(FitError::NoOptimum)?;
        counts.add(&first);
        let mut pool = search::Pool::new(fit::Fitter::new(&bench, noise_share));
        let from = from.map(|found| &found.best).filter(|(_, point)| point.offsets.len() == bench.runs());
        let complete = pool.search(from, counts, says);
        let Some(evidence) = verdict::verdict(&pool, complete) else { continue };
        return described::described(&pool, baseline.terms.len(), evidence, !counts.is_stopped())
            .ok_or(FitError::NoOptimum);
    }
    Err(FitError::NoOptimum)
}
