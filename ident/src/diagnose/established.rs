//! What is beyond doubt although the rest is not explained.
//!
//! On a real rig several ordinary things are a little wrong at once, and finding the first must not depend on finding the last. Causes are
//! taken one after the other, each the best of all that could join those before it, for as long as each shows by itself: no other one
//! comes near, its numbers hardly differ from run to run, and it helps on runs that it was not fitted to.

use super::gain;
use super::gates::constancy;
use super::result::{ConstancyTest, PerRun, Remainder, RunRemainder};
use super::rivals::is_wider;
use super::sets::{Found, sets};
use crate::experiment::Experiment;
use crate::fit::counts::Counts;
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;

/// Odds of 20 to 1 as a difference of the BIC: a rival within them leaves doubt.
const BEYOND_DOUBT_DELTA_BIC: f64 = 6.0;
/// Share of what a cause has saved by which its runs may differ: what is not explained yet is another in each run, and pulls at it.
const RUNS_MAY_DIFFER_SHARE: f64 = 0.1;

/// A description of which every part is beyond doubt.
pub(super) struct Established<'a> {
    /// Nothing beyond `baseline` where nothing is.
    pub(super) state: State<'a>,
    /// Whether its numbers are the same in all runs.
    pub(super) constancy: Vec<(ConstancyTest, Vec<PerRun>)>,
}

/// What of the sets that `found` tried beside `baseline` is beyond doubt.
pub(super) fn established<'a>(
    experiment: &'a Experiment,
    baseline: &State<'a>,
    found: &Found<'a>,
    floor: &Floor,
    counts: &mut Counts,
) -> Established<'a> {
    let mut known = Established { state: baseline.clone(), constancy: Vec::new() };
    loop {
        let size = known.state.causes.len() + 1;
        let joins = |state: &&State<'a>| {
            let names = sets(state);
            state.causes.len() == size && sets(&known.state).iter().all(|name| names.contains(name))
        };
        // by the BIC, best first
        let Some(mut next) = found.tried.iter().find(joins).cloned() else { return known };
        if next.bic() >= known.state.bic() || !next.descend(counts) {
            return known;
        }
        let is_near = |state: &State<'_>| state.bic() - next.bic() < BEYOND_DOUBT_DELTA_BIC;
        let mut others = found.tried.iter().filter(joins).filter(|state| sets(state) != sets(&next));
        if others.any(|state| is_near(state) && !is_wider(state, &next, experiment)) {
            return known;
        }
        let saved = known.state.cost - next.cost;
        let tests = constancy(&next, baseline.parameters.len());
        let is_new = |test: &ConstancyTest| {
            let cause = test.parameter.split('/').next().unwrap_or_default();
            !sets(&known.state).contains(&cause)
        };
        let differ =
            |test: &ConstancyTest| test.is_no_chance() && test.chi2 > RUNS_MAY_DIFFER_SHARE * saved;
        if tests.iter().any(|(test, _)| is_new(test) && differ(test)) {
            return known;
        }
        let gained = gain::gain(experiment, &known.state, &next, floor, counts);
        if gained.is_none_or(|gained| gained.may_be_none()) {
            return known;
        }
        known = Established { state: next, constancy: tests };
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
            .map(|(term, squares)| RunRemainder {
                id: term.rehearsal.run.id.clone(),
                rms_m: rms(squares),
            })
            .collect(),
    }
}
