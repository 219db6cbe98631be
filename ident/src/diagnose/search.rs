//! From scores to the set of causes that explains the runs best: full refits of a short list, a beam, a swap, and
//! elimination.
//!
//! One cause after the other fails where two strong ones hide each other: so the three best sets go on, not one; in the
//! end each cause must earn its place in the set, and may be exchanged for another.

use rayon::prelude::*;
use sim::{Cause, Model};

use super::DiagnoseError;
use super::candidates::{self, Term};
use super::score::{Scored, Scores};
use super::state::State;
use crate::experiment::Experiment;
use crate::fit::counts::Counts;
use crate::statistics::chi2_survival;

/// A set of causes is better when its BIC is lower by more than this: odds of 150 to 1.
const BETTER: f64 = 10.0;
/// Within this of the best BIC another set is as good: odds below 20 to 1.
pub(super) const AS_GOOD: f64 = 6.0;
/// Chance that any of all candidates looks this good where nothing is.
const FALSE_ALARM: f64 = 1e-4;
/// Causes refitted in full at each stage.
const SHORT_LIST: usize = 5;
/// After one step a candidate stays when its BIC is within this of the best one's, or within this share of what that one
/// has saved.
const NEAR: f64 = 100.0;
const CATCH_UP: f64 = 0.7;
/// After three steps only what is within this of the best one goes on to its optimum.
const LAST: f64 = 30.0;
const LAST_SHARE: f64 = 0.1;
/// And so many stay in any case.
const KEPT: usize = 3;
/// Other hidden numbers (where a stop is, how fast water sways) from which the best candidate is refitted: each may be the
/// bottom of a valley of its own.
const ELSEWHERE: usize = 4;
/// Sets that go on.
const BEAM: usize = 3;
/// Causes in a set.
const MOST_CAUSES: usize = 3;
/// A further cause saves at least this share of what the causes before it have saved: what is less is how these are
/// modelled.
const SHARE: f64 = 0.01;
/// Cost saved an observation, in noise variances, below which a cause is there but does not matter.
const NEGLIGIBLE: f64 = 0.0025;
/// Root mean square of a coordinate below which nothing matters, however certain \[m\]: pictures are wrong by a tenth of a pixel,
/// on and on.
pub(super) const NEGLIGIBLE_M: f64 = 2e-5;

/// The cost below which something may be there but does not matter, in `count` observations with noise of `noise_m` \[m\].
pub(super) fn negligible(noise_m: f64, count: usize) -> f64 {
    NEGLIGIBLE.max((NEGLIGIBLE_M / noise_m).powi(2)) * count as f64
}

/// What was found.
pub(super) struct Found<'a> {
    /// Every set that was refitted, by BIC, the baseline among them.
    pub(super) tried: Vec<State<'a>>,
    /// The accepted one; the baseline where there is none.
    pub(super) leader: State<'a>,
    /// Scores of all candidates against the baseline.
    pub(super) first: Scores,
}

/// The candidates and what they may be combined with.
pub(super) struct Search<'b> {
    experiment: &'b Experiment,
    candidates: Vec<Term>,
    pub(super) counts: Counts,
    /// The noise of one coordinate \[m\].
    pub(super) noise_m: f64,
    /// Sets to which every candidate was tried to be added.
    expanded: Vec<Vec<&'static str>>,
    stage: &'b mut dyn FnMut(&str) -> bool,
}

impl<'b> Search<'b> {
    pub(super) fn new(
        experiment: &'b Experiment,
        model: &Model,
        fitted: &[Cause],
        noise_m: f64,
        stage: &'b mut dyn FnMut(&str) -> bool,
    ) -> Self {
        let free = Cause::ALL.iter().copied().filter(|cause| !fitted.contains(cause));
        let candidates = free.flat_map(|cause| Term::all(cause, model)).collect();
        Self { experiment, candidates, counts: Counts::default(), noise_m, expanded: Vec::new(), stage }
    }

    pub(super) fn says(&mut self, stage: &str) -> Result<(), DiagnoseError> {
        if (self.stage)(stage) { Ok(()) } else { Err(DiagnoseError::Interrupted) }
    }

    /// Candidates that may join `state`.
    fn open(&self, state: &State<'_>) -> Vec<Term> {
        let taken = |cause: Cause| {
            state.causes.iter().any(|term| {
                term.cause == cause
                    || candidates::aliases(term.cause, self.experiment).contains(&cause.name())
            })
        };
        self.candidates.iter().filter(|term| !taken(term.cause)).cloned().collect()
    }

    pub(super) fn score(&mut self, state: &State<'_>) -> Scores {
        let open = self.open(state);
        self.counts.rollouts += (open.len() * state.terms.len()) as u64;
        Scores::new(state, &open)
    }

    /// The most promising candidates, one of each cause and class of aliases.
    fn short_list(&self, state: &State<'_>, scores: &Scores) -> Vec<usize> {
        let per_number = state.ln_count();
        let worth = |scored: &Scored| scored.gain - scored.count as f64 * per_number;
        let mut order: Vec<usize> = (0..scores.list.len()).collect();
        order.sort_by(|&a, &b| worth(&scores.list[b]).total_cmp(&worth(&scores.list[a])));
        let mut list: Vec<usize> = Vec::new();
        for index in order {
            let scored = &scores.list[index];
            if list.len() == SHORT_LIST || worth(scored) <= 0.0 {
                break;
            }
            let same = |&other: &usize| {
                let other = &scores.list[other].term;
                other.cause == scored.term.cause
                    || candidates::aliases(other.cause, self.experiment).contains(&scored.term.cause.name())
            };
            if !list.iter().any(same) {
                list.push(index);
            }
        }
        list
    }

    /// Whether some candidate is good enough to be worth a refit at all.
    fn promises(&self, state: &State<'_>, scores: &Scores, least: f64) -> bool {
        let per_number = state.ln_count();
        scores.list.iter().any(|scored| {
            scored.gain >= least && scored.gain - scored.count as f64 * per_number > BETTER / 2.0
        })
    }

    /// `state` with each of the short list in turn, refitted; the best of these from other hidden numbers too.
    fn expand<'a>(&mut self, state: &State<'a>, scores: &Scores) -> Vec<State<'a>> {
        self.expanded.push(sets(state));
        let mut all = self.refit_each(state, scores, &self.short_list(state, scores));
        let best = all.iter().min_by(|a, b| a.bic().total_cmp(&b.bic()));
        let others = best.and_then(|best| Some(starts_elsewhere(best.causes.last()?, scores)));
        if let Some(others) = others.filter(|others| !others.is_empty()) {
            all.extend(self.refit_each(state, scores, &others));
            // one of each, or the beam would hold one cause alone
            all.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
            let mut known: Vec<Vec<&'static str>> = Vec::new();
            all.retain(|state| {
                let names = sets(state);
                let is_first = !known.contains(&names);
                known.push(names);
                is_first
            });
        }
        all
    }

    /// `state` with each candidate of `list` in turn, refitted.
    fn refit_each<'a>(&mut self, state: &State<'a>, scores: &Scores, list: &[usize]) -> Vec<State<'a>> {
        let first: Vec<(Option<State<'a>>, Counts)> = list
            .par_iter()
            .map(|&index| {
                let mut counts = Counts::default();
                let scored = &scores.list[index];
                let mut next = state.with(&scored.term);
                if !scored.term.is_switch() {
                    next.linear = scores.extended(state, &next, index);
                }
                (next.steps(1, &mut counts).then_some(next), counts)
            })
            .collect();
        let mut reached: Vec<f64> = first.iter().filter_map(|(next, _)| Some(next.as_ref()?.bic())).collect();
        reached.sort_by(f64::total_cmp);
        let best = reached.first().copied().unwrap_or(f64::INFINITY);
        // what lies far behind after a step that is nearly the last one does not catch up
        let reach = best + NEAR.max(CATCH_UP * (state.bic() - best));
        let reach = reach.max(reached.get(KEPT - 1).copied().unwrap_or(f64::INFINITY));
        let bent = |next: &State<'a>| next.causes.last().is_some_and(Term::is_strongly_bent);
        let further: Vec<(Option<State<'a>>, Counts)> = first
            .into_par_iter()
            .map(|(next, mut counts)| {
                let mut next = next.filter(|next| next.bic() <= reach || bent(next));
                if !next.as_mut().is_some_and(|next| next.steps(2, &mut counts)) {
                    next = None;
                }
                (next, counts)
            })
            .collect();
        let best =
            further.iter().filter_map(|(next, _)| Some(next.as_ref()?.bic())).fold(f64::INFINITY, f64::min);
        let reach = best + LAST.max(LAST_SHARE * (state.bic() - best));
        let refitted: Vec<(Option<State<'a>>, Counts)> = further
            .into_par_iter()
            .map(|(mut next, mut counts)| {
                if next.as_mut().is_some_and(|next| next.bic() <= reach && !next.descend(&mut counts)) {
                    next = None;
                }
                (next, counts)
            })
            .collect();
        for (_, own) in &refitted {
            self.counts.evaluations += own.evaluations;
            self.counts.rollouts += own.rollouts;
        }
        refitted.into_iter().filter_map(|(state, _)| state).collect()
    }

    /// Whether `better` is so much better than `worse` that it is no chance.
    fn accepts(&self, worse: &State<'_>, better: &State<'_>) -> bool {
        let gain = worse.cost - better.cost;
        let numbers = better.added.saturating_sub(worse.added).max(1);
        let chance = chi2_survival(gain, numbers as f64) * self.candidates.len() as f64;
        worse.bic() - better.bic() > BETTER
            && chance < FALSE_ALARM
            && gain > negligible(self.noise_m, better.count())
    }

    /// Looks for the best set of causes beside `baseline`.
    pub(super) fn run<'a>(&mut self, baseline: &State<'a>) -> Result<Found<'a>, DiagnoseError> {
        self.run_from(baseline, baseline)
    }

    /// Looks once more, from the model's own values, and adds what is better to `found`: a baseline that has bent far to cover
    /// for a strong cause points to others.
    pub(super) fn run_anew<'a>(
        &mut self,
        baseline: &State<'a>,
        found: &mut Found<'a>,
    ) -> Result<(), DiagnoseError> {
        let mut start = State { linear: Vec::new(), ..baseline.clone() };
        start.point.values = baseline.parameters.start();
        if !start.stay(&mut self.counts) {
            return Ok(());
        }
        self.expanded.clear();
        let anew = self.run_from(baseline, &start)?;
        found.tried.extend(anew.tried);
        found.tried.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
        if anew.leader.bic() < found.leader.bic() {
            found.leader = anew.leader;
        }
        Ok(())
    }

    /// Looks for the best set of causes beside `baseline`, whose first causes are added at `start`.
    fn run_from<'a>(&mut self, baseline: &State<'a>, start: &State<'a>) -> Result<Found<'a>, DiagnoseError> {
        self.says("scoring every cause")?;
        let first = self.score(start);
        let mut tried: Vec<State<'a>> = vec![baseline.clone()];
        let mut leader = baseline.clone();
        let mut beam: Vec<State<'a>> = Vec::new();
        let matters = negligible(self.noise_m, baseline.count());
        if self.promises(start, &first, matters) {
            self.says("refitting the most promising causes")?;
            beam = self.expand(start, &first);
        }
        for depth in 1..=MOST_CAUSES {
            beam.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
            beam.truncate(SHORT_LIST);
            tried.extend(beam.iter().cloned());
            let Some(best) = beam.first() else { break };
            let least = SHARE * (baseline.cost - leader.cost);
            if !self.accepts(&leader, best) || leader.cost - best.cost < least {
                break;
            }
            leader = best.clone();
            let mut scores = self.score(&leader);
            let mut least = matters.max(SHARE * (baseline.cost - leader.cost));
            let mut more = depth < MOST_CAUSES && self.promises(&leader, &scores, least);
            if more && depth == 1 && self.started_anew(baseline, &mut beam, &mut leader) {
                tried.extend(beam.iter().cloned());
                scores = self.score(&leader);
                least = matters.max(SHARE * (baseline.cost - leader.cost));
                more = self.promises(&leader, &scores, least);
            }
            let mut next = Vec::new();
            if more {
                self.says("looking for a further cause")?;
                next = self.expand(&leader, &scores);
                for mut other in beam.iter().skip(1).take(BEAM - 1).cloned() {
                    if other.descend(&mut self.counts) {
                        let scores = self.score(&other);
                        next.extend(self.expand(&other, &scores));
                    }
                }
            }
            beam = next;
        }
        if leader.causes.len() > 1 {
            self.says("exchanging and dropping causes")?;
            leader = self.improved(baseline, leader, &mut tried)?;
        }
        tried.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
        Ok(Found { tried, leader, first })
    }

    /// Refits the best single causes from the model's own values: a baseline that has bent far to cover for a strong cause may
    /// be no way to where it is explained. Whether the leader is another or better.
    fn started_anew<'a>(
        &mut self,
        baseline: &State<'a>,
        beam: &mut [State<'a>],
        leader: &mut State<'a>,
    ) -> bool {
        let before = leader.bic();
        for state in beam.iter_mut().take(BEAM) {
            let mut anew = State { linear: Vec::new(), ..state.clone() };
            let count = baseline.parameters.len();
            anew.point.values[..count].copy_from_slice(&baseline.parameters.start());
            if anew.descend(&mut self.counts) && anew.bic() < state.bic() {
                *state = anew;
            }
        }
        beam.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
        match beam.first().filter(|best| best.bic() < before - 1.0) {
            Some(best) => {
                *leader = best.clone();
                true
            }
            None => false,
        }
    }

    /// Drops causes that are not needed, and exchanges those for which there is a better one.
    fn improved<'a>(
        &mut self,
        baseline: &State<'a>,
        mut leader: State<'a>,
        tried: &mut Vec<State<'a>>,
    ) -> Result<State<'a>, DiagnoseError> {
        for _ in 0..MOST_CAUSES {
            let mut best: Option<State<'a>> = None;
            for dropped in 0..leader.causes.len() {
                let others: Vec<Term> = without(&leader.causes, dropped);
                let names = names(&others);
                let known = tried.iter().find(|state| sets(state) == names).cloned();
                let mut smaller = match known {
                    Some(known) => known,
                    None => match self.refit(baseline, &others, &leader) {
                        Some(smaller) => smaller,
                        None => continue,
                    },
                };
                if !self.accepts(&smaller, &leader) {
                    best = Some(smaller);
                    break;
                }
                if self.expanded.contains(&names) || !smaller.descend(&mut self.counts) {
                    continue;
                }
                let scores = self.score(&smaller);
                for other in self.expand(&smaller, &scores) {
                    let known = best.as_ref().unwrap_or(&leader);
                    if other.bic() < known.bic() && sets(&other) != sets(&leader) {
                        best = Some(other.clone());
                    }
                    tried.push(other);
                }
                tried.push(smaller);
            }
            match best {
                Some(better) => leader = better,
                None => break,
            }
            if leader.causes.len() < 2 {
                break;
            }
        }
        Ok(leader)
    }

    /// `baseline` with `causes`, started where `near` is.
    pub(super) fn refit<'a>(
        &mut self,
        baseline: &State<'a>,
        causes: &[Term],
        near: &State<'a>,
    ) -> Option<State<'a>> {
        let mut state = State { linear: Vec::new(), ..baseline.clone() };
        for term in causes {
            state = state.with(term);
        }
        for (place, parameter) in state.parameters.free.iter().enumerate() {
            let same = near.parameters.free.iter().position(|other| other.names == parameter.names);
            if let Some(same) = same {
                state.point.values[place] = parameter.scale.clamp(near.point.values[same]);
            }
        }
        state.descend(&mut self.counts).then_some(state)
    }
}

/// The most promising of the candidates that differ from `term` in hidden numbers alone.
fn starts_elsewhere(term: &Term, scores: &Scores) -> Vec<usize> {
    let differs = |other: &Term| {
        other.cause == term.cause && other.choices == term.choices && other.hidden != term.hidden
    };
    let mut list: Vec<usize> = (0..scores.list.len()).filter(|&i| differs(&scores.list[i].term)).collect();
    list.sort_by(|&a, &b| scores.list[b].gain.total_cmp(&scores.list[a].gain));
    list.truncate(ELSEWHERE);
    list
}

/// Names of the causes of `state`, sorted.
pub(super) fn sets(state: &State<'_>) -> Vec<&'static str> {
    names(&state.causes)
}

fn names(causes: &[Term]) -> Vec<&'static str> {
    let mut names: Vec<&'static str> = causes.iter().map(|term| term.cause.name()).collect();
    names.sort_unstable();
    names
}

fn without(causes: &[Term], dropped: usize) -> Vec<Term> {
    causes.iter().enumerate().filter(|(place, _)| *place != dropped).map(|(_, term)| term.clone()).collect()
}
