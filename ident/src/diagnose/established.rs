//! What is beyond doubt although the rest is not explained.
//!
//! On a real rig several ordinary things are a little wrong at once, and finding the first must not depend on finding the last. Of the best
//! description those causes are beyond doubt that show by themselves beside the others: nothing could stand in their place, their
//! numbers hardly differ from run to run, and they help on runs that they were not fitted to.

use super::gain;
use super::gates::constancy;
use super::result::{ConstancyTest, PerRun, Remainder, RunRemainder};
use super::rivals::{holds_bound, is_wider};
use super::sets::{Found, sets};
use crate::experiment::Experiment;
use crate::fit::counts::Counts;
use crate::hypothesis::candidates::{Term, names};
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

/// What of `leader`, the best description that `found` holds beside `baseline`, is beyond doubt.
pub(super) fn established<'a>(
    experiment: &'a Experiment,
    baseline: &State<'a>,
    (found, leader): (&Found<'a>, &State<'a>),
    floor: &Floor,
    counts: &mut Counts,
) -> Established<'a> {
    let nothing = || Established { state: baseline.clone(), constancy: Vec::new() };
    let tests = constancy(leader, baseline.parameters.len());
    let mut names: Vec<&'static str> = Vec::new();
    for term in &leader.causes {
        let name = term.info().name;
        let without = match leader.causes.len() {
            1 => Some(baseline),
            _ => found.without(leader, name),
        };
        let Some(without) = without else { continue };
        let saved = without.cost - leader.cost;
        let is_its = |test: &ConstancyTest| test.parameter.split('/').next() == Some(name);
        let is_doubtful = is_nowhere(term, leader)
            || has_rival(experiment, found, leader, name)
            || tests.iter().any(|(test, _)| is_its(test) && differs(test, saved));
        if is_doubtful {
            continue;
        }
        let gained = gain::gain(experiment, without, leader, floor, counts);
        if gained.is_some_and(|gained| !gained.may_be_none()) {
            names.push(name);
        }
    }
    names.sort_unstable();
    let known = match names.is_empty() {
        true => None,
        false => found.tried.iter().chain([leader]).find(|state| sets(state) == names).cloned(),
    };
    let Some(mut state) = known else { return nothing() };
    if !state.descend(counts) {
        return nothing();
    }
    // each may help a description that the other runs contradict as a whole
    let gained = gain::gain(experiment, baseline, &state, floor, counts);
    if gained.is_none_or(|gained| gained.may_be_none()) {
        return nothing();
    }
    // and they must stand without what is in doubt as they stood beside it
    let constancy = constancy(&state, baseline.parameters.len());
    let explained = baseline.cost - state.cost;
    let is_doubtful = state.causes.iter().any(|term| is_nowhere(term, &state))
        || constancy.iter().any(|(test, _)| differs(test, explained));
    if is_doubtful { nothing() } else { Established { state, constancy } }
}

/// Whether the runs differ in a number of what has `saved` so much, by more than what is not explained yet would make them.
fn differs(test: &ConstancyTest, saved: f64) -> bool {
    test.is_no_chance() && test.chi2 > RUNS_MAY_DIFFER_SHARE * saved
}

/// Whether a place that belongs to `term` has run into the end of where it may be: then it is not there, and stands in for something
/// else.
fn is_nowhere(term: &Term, leader: &State<'_>) -> bool {
    let parameters = names(term.cause, &leader.model);
    let is_place = |name: &str| parameters.iter().any(|(own, info)| own == name && info.unit == "m");
    term.hidden.iter().any(|(name, _)| is_place(name) && holds_bound(leader, name))
}

/// Whether another cause in the place of the one called `name` would describe the runs about as well.
fn has_rival(experiment: &Experiment, found: &Found<'_>, leader: &State<'_>, name: &str) -> bool {
    let rest: Vec<&str> = sets(leader).into_iter().filter(|own| *own != name).collect();
    found.tried.iter().any(|other| {
        let theirs = sets(other);
        theirs.len() == leader.causes.len()
            && theirs != sets(leader)
            && rest.iter().all(|name| theirs.contains(name))
            && other.bic() - leader.bic() < BEYOND_DOUBT_DELTA_BIC
            && !is_wider(other, leader, experiment)
    })
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
