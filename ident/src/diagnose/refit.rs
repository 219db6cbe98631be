//! Refits of the candidates that score best.

use sim::Cause;

use super::baseline::SAME_OPTIMUM_COST;
use super::sets::{BETTER_DELTA_BIC, Found, SHORT_LIST, Search, sets};
use crate::fit::problem::Point;
use crate::hypothesis::candidates::Term;
use crate::hypothesis::score::{Scored, Scores};
use crate::hypothesis::state::State;

/// After one step a candidate stays when its BIC is within this of the best one's, or within this share of what that one
/// has saved: a step is mostly nearly the whole way, and what it leaves is far less than either.
const AFTER_ONE_STEP_DELTA_BIC: f64 = 100.0;
const AFTER_ONE_STEP_SHARE: f64 = 0.9;
/// And so many stay in any case.
const KEPT_AFTER_ONE_STEP: usize = 3;
/// After three steps only what is within this of the best one, or within this share of what that one has saved, goes on to its
/// optimum.
const AFTER_THREE_STEPS_DELTA_BIC: f64 = 30.0;
const AFTER_THREE_STEPS_SHARE: f64 = 0.1;
/// Hidden numbers (where a stop is, how fast water sways) and choices from which a candidate is refitted, each maybe the bottom of a
/// valley of its own: so many others for the best candidate, and for any as many as promise the same within this share, which a
/// step from each tells apart.
const MOST_STARTS: usize = 4;
const SAME_PROMISE_SHARE: f64 = 0.02;

impl Search<'_> {
    /// The most promising candidates, one of each cause and class of aliases.
    fn short_list(&self, state: &State<'_>, scores: &Scores) -> Vec<usize> {
        let per_number = state.ln_count();
        let worth =
            |scored: &Scored| scored.gain - scored.count as f64 * per_number - scored.term.choice_cost();
        let mut order: Vec<usize> = (0..scores.list.len()).collect();
        order.sort_by(|&a, &b| worth(&scores.list[b]).total_cmp(&worth(&scores.list[a])));
        let mut list: Vec<usize> = Vec::new();
        for index in order {
            let scored = &scores.list[index];
            if list.len() == SHORT_LIST || worth(scored) <= 0.0 {
                break;
            }
            let same = |&other: &usize| self.is_same(&scores.list[other].term, &scored.term);
            if !list.iter().any(same) {
                list.push(index);
            }
        }
        list
    }

    /// Whether some candidate is good enough to be worth a refit at all.
    pub(super) fn promises(&self, state: &State<'_>, scores: &Scores, least: f64) -> bool {
        let per_number = state.ln_count();
        scores.list.iter().any(|scored| {
            let worth = scored.gain - scored.count as f64 * per_number - scored.term.choice_cost();
            scored.gain >= least && worth > BETTER_DELTA_BIC / 2.0
        })
    }

    /// `state` with each of the short list in turn, refitted; the best of these from other hidden numbers too. What is `known`
    /// already joins them as it is.
    pub(super) fn expand<'a>(
        &mut self,
        state: &State<'a>,
        scores: &Scores,
        known: Vec<State<'a>>,
    ) -> Vec<State<'a>> {
        self.expanded.push(sets(state));
        let mut list = self.short_list(state, scores);
        list.retain(|&index| {
            let cause = scores.list[index].term.cause;
            known.iter().all(|state| state.causes.last().is_none_or(|term| term.cause != cause))
        });
        let mut all = self.refit_each(state, scores, list.iter().map(|&index| equal_starts(index, scores)));
        let is_better = |best: &&State<'a>| known.iter().all(|known| best.bic() < known.bic());
        let best = all.iter().min_by(|a, b| a.bic().total_cmp(&b.bic())).filter(is_better);
        let others = best.and_then(|best| Some(starts_elsewhere(best.causes.last()?, scores)));
        if let Some(others) = others.filter(|others| !others.is_empty()) {
            all.extend(self.refit_each(state, scores, others.into_iter().map(|index| vec![index])));
            // one of each, or the beam would hold one cause alone
            all.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
            let mut seen: Vec<Vec<&'static str>> = Vec::new();
            all.retain(|state| {
                let names = sets(state);
                let is_first = !seen.contains(&names);
                seen.push(names);
                is_first
            });
        }
        all.extend(known);
        all
    }

    /// `state` with each candidate of `list` in turn, from the best of its starts, refitted.
    fn refit_each<'a>(
        &mut self,
        state: &State<'a>,
        scores: &Scores,
        list: impl Iterator<Item = Vec<usize>>,
    ) -> Vec<State<'a>> {
        let noise_m = self.floor.noise_m;
        let starts =
            list.enumerate().flat_map(|(of, starts)| starts.into_iter().map(move |index| (of, index)));
        let first = self.counts.of_each(starts.collect(), |(of, index), counts| {
            let scored = &scores.list[index];
            let mut next = state.with(&scored.term);
            next.begin(&scored.term, state);
            if !scored.term.is_switch() {
                next.linear = scores.extended(state, &next, index);
            }
            next.steps(1, counts).then_some((of, next))
        });
        let mut first: Vec<(usize, State<'a>)> = first.into_iter().flatten().collect();
        first.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.bic().total_cmp(&b.1.bic())));
        first.dedup_by_key(|(of, _)| *of);
        let first: Vec<State<'a>> = first.into_iter().map(|(_, next)| next).collect();
        let mut reached: Vec<f64> = first.iter().map(State::bic).collect();
        reached.sort_by(f64::total_cmp);
        let best = reached.first().copied().unwrap_or(f64::INFINITY);
        // what lies far behind after a step that is nearly the last one does not catch up
        let reach = best + AFTER_ONE_STEP_DELTA_BIC.max(AFTER_ONE_STEP_SHARE * (state.bic() - best));
        let reach = reach.max(reached.get(KEPT_AFTER_ONE_STEP - 1).copied().unwrap_or(f64::INFINITY));
        // unless its score had promised more, and the way there is no straight line
        let promised = |next: &State<'a>| {
            let scored = scores.list.iter().find(|scored| next.causes.last() == Some(&scored.term));
            scored.map_or(f64::INFINITY, |scored| next.bic() - next.cost + state.cost - scored.gain)
        };
        let within = |next: &State<'a>, reach: f64| next.bic() <= reach || promised(next) <= reach;
        let bent = |next: &State<'a>| next.causes.last().is_some_and(Term::is_strongly_bent);
        let near = first.into_iter().filter(|next| within(next, reach) || bent(next)).collect();
        let further = self.counts.of_each(near, |mut next: State<'a>, counts| {
            next.replan(noise_m, counts);
            next.steps(2, counts).then_some(next)
        });
        let further: Vec<State<'a>> = further.into_iter().flatten().collect();
        let best = further.iter().map(State::bic).fold(f64::INFINITY, f64::min);
        let reach = best + AFTER_THREE_STEPS_DELTA_BIC.max(AFTER_THREE_STEPS_SHARE * (state.bic() - best));
        let refitted = self.counts.of_each(further, |mut next, counts| {
            if within(&next, reach) {
                next.replan(noise_m, counts);
                return next.descend(counts).then_some(next);
            }
            Some(next)
        });
        refitted.into_iter().flatten().collect()
    }

    /// Refits the leader of `found` from elsewhere: from the model's own values and starts, and from those of `baseline`. The way
    /// from a baseline that has bent far may end in another optimum, and dry friction has many. Whether one of them is better.
    pub(super) fn settle<'a>(&mut self, baseline: &State<'a>, found: &mut Found<'a>) -> bool {
        let leader = &found.leader;
        let still = baseline.point.offsets.iter().map(|offsets| vec![0.0; offsets.len()]).collect();
        let own = Point { values: baseline.parameters.start(), offsets: still };
        let ends = self.counts.of_each(vec![own, baseline.point.clone()], |start, counts| {
            let mut state = leader.started_at(&start);
            state.descend(counts).then_some(state)
        });
        let best = ends.into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost));
        let Some(better) = best.filter(|end| end.cost < leader.cost - SAME_OPTIMUM_COST) else {
            return false;
        };
        let names = sets(&better);
        found.tried.retain(|state| sets(state) != names);
        found.tried.push(better.clone());
        found.tried.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
        found.leader = better;
        true
    }

    /// Moves each cause of the leader of `found` to the element where it explains most, or to all of them together, or makes its numbers
    /// those of each run or common to all. Whether any has moved.
    pub(super) fn place<'a>(&mut self, baseline: &State<'a>, found: &mut Found<'a>) -> bool {
        let mut moved = false;
        for which in 0..found.leader.causes.len() {
            let leader = found.leader.clone();
            let level = leader.level();
            let elements = &self.experiment.diagnose.elements;
            let others = leader.causes[which].elsewhere(&baseline.model, baseline.terms.len(), elements);
            let noise_m = self.floor.noise_m;
            let placed = self.counts.of_each(others, |other, counts| {
                let causes: Vec<Term> = leader
                    .causes
                    .iter()
                    .enumerate()
                    .map(|(place, term)| if place == which { other.clone() } else { term.clone() })
                    .collect();
                let mut state = started_near(baseline, &causes, &leader);
                state.replan(noise_m, counts);
                let goes_on = state.steps(3, counts)
                    && state.bic_at(level) - leader.bic_at(level) < AFTER_THREE_STEPS_DELTA_BIC
                    && state.descend(counts);
                goes_on.then_some(state)
            });
            let placed: Vec<State<'a>> = placed.into_iter().flatten().collect();
            let best = placed.iter().min_by(|a, b| a.bic_at(level).total_cmp(&b.bic_at(level)));
            if let Some(better) = best.filter(|best| best.bic_at(level) < leader.bic_at(level)).cloned() {
                moved = true;
                let names = sets(&better);
                found.tried.retain(|state| sets(state) != names);
                found.tried.push(better.clone());
                found.leader = better;
            }
            found.elsewhere.extend(placed);
        }
        found.tried.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
        moved
    }

    /// `baseline` with `causes`, started where `near` is.
    pub(super) fn refit<'a>(
        &mut self,
        baseline: &State<'a>,
        causes: &[Term],
        near: &State<'a>,
    ) -> Option<State<'a>> {
        let mut state = started_near(baseline, causes, near);
        state.replan(self.floor.noise_m, &self.counts);
        state.descend(&mut self.counts).then_some(state)
    }
}

/// `baseline` with `causes`, before any fit, its numbers those of `near` where that has them.
fn started_near<'a>(baseline: &State<'a>, causes: &[Term], near: &State<'a>) -> State<'a> {
    let mut state = State { linear: Vec::new(), ..baseline.clone() };
    for term in causes {
        state = state.with(term);
    }
    for (place, parameter) in state.parameters.free.iter().enumerate() {
        if let Some(value) = near.value(parameter.name()) {
            state.point.values[place] = parameter.scale.clamp(value);
        }
    }
    for run in 0..state.terms.len() {
        for (k, nuisance) in state.terms[run].rehearsal.nuisances.iter().enumerate() {
            let name = state.own_name(*nuisance);
            if let Some(value) = name.and_then(|name| near.own_value(name, run).or_else(|| near.value(name)))
            {
                state.point.offsets[run][k] = nuisance.clamp(value);
            }
        }
    }
    state
}

/// The candidate at `index`, and those of its cause, in the same element, that promise the same.
fn equal_starts(index: usize, scores: &Scores) -> Vec<usize> {
    let Scored { term, gain, .. } = &scores.list[index];
    let same = |&other: &usize| {
        let Scored { term: its, gain: promised, .. } = &scores.list[other];
        other != index && its.is_placed_as(term) && *promised >= (1.0 - SAME_PROMISE_SHARE) * gain
    };
    std::iter::once(index)
        .chain(of_cause(term.cause, scores).into_iter().filter(same))
        .take(MOST_STARTS)
        .collect()
}

/// The most promising of the candidates that differ from `term` in hidden numbers or choices alone.
fn starts_elsewhere(term: &Term, scores: &Scores) -> Vec<usize> {
    let differs = |&other: &usize| {
        let other = &scores.list[other].term;
        other != term && other.is_placed_as(term)
    };
    of_cause(term.cause, scores).into_iter().filter(differs).take(MOST_STARTS).collect()
}

/// The candidates of `cause`, the most promising first.
fn of_cause(cause: Cause, scores: &Scores) -> Vec<usize> {
    let mut list: Vec<usize> =
        (0..scores.list.len()).filter(|&index| scores.list[index].term.cause == cause).collect();
    list.sort_by(|&a, &b| scores.list[b].gain.total_cmp(&scores.list[a].gain));
    list
}
