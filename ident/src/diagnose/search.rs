//! From scores to the set of causes that explains the runs best: full refits of a short list, a beam, a swap, and
//! elimination.
//!
//! One cause after the other fails where two strong ones hide each other: so the three best sets go on, not one; in the
//! end each cause must earn its place in the set, and may be exchanged for another.

use std::cmp::Ordering;

use sim::{Cause, Model};

use super::DiagnoseError;
use super::baseline;
use super::refit::SHORT_LIST;
use crate::experiment::Experiment;
use crate::fit::counts::Counts;
use crate::fit::problem::Point;
use crate::hypothesis::candidates::Term;
use crate::hypothesis::score::Scores;
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;
use crate::statistics::chi2_survival;

/// A set of causes is better when its BIC is lower by more than this: odds of 150 to 1.
pub(super) const BETTER: f64 = 10.0;
/// Within this of the best BIC another set is as good: odds below 2.7 to 1, which are "not worth more than a bare mention"
/// (R. E. Kass, A. E. Raftery, "Bayes Factors", Journal of the American Statistical Association 90 (1995) 773-795).
pub(super) const AS_GOOD: f64 = 2.0;
/// Chance that any of all candidates looks this good where nothing is.
const FALSE_ALARM: f64 = 1e-4;
/// Sets that go on.
const BEAM: usize = 3;
/// Causes in a set.
pub(super) const MOST_CAUSES: usize = 3;
/// A further cause saves at least this share of what the causes before it have saved: what is less is how these are
/// modelled.
const SHARE: f64 = 0.01;
/// A leader to which nothing can be added may still stand in for two causes that resemble it, if what it leaves exceeds the
/// noise's squares by this share: then the sets behind it go on.
const LEFT: f64 = 0.1;
/// Noise that differs by less is the same.
const OTHER_NOISE: f64 = 0.04;
/// Cost saved an observation, in noise variances, below which a cause is there but does not matter.
const NEGLIGIBLE: f64 = 0.0025;
/// A cause that explains so much cost has bent the baseline so far that what bent it may not be what it points to.
pub(super) const FAR_BENT: f64 = 2000.0;
/// A set that explains more than that is beyond doubt where every other one is behind by as much and by this share of it.
const FAR_BEHIND: f64 = 0.1;
/// Nothing is beyond doubt that leaves more than this of each observation, in noise variances: what explains the rest may
/// explain it all.
const WELL_EXPLAINED: f64 = 3.0;
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

impl<'a> Found<'a> {
    /// The best set that was refitted of the causes of `state` but the one called `name`.
    pub(super) fn without(&self, state: &State<'_>, name: &str) -> Option<&State<'a>> {
        let rest: Vec<&str> = sets(state).into_iter().filter(|own| *own != name).collect();
        self.tried.iter().find(|state| sets(state) == rest)
    }

    /// Whether the leader is beyond doubt: it explains very much, leaves little, and nothing else comes near.
    pub(super) fn is_clear(&self, baseline: &State<'_>) -> bool {
        let leader = sets(&self.leader);
        let far = FAR_BENT.max(FAR_BEHIND * (baseline.cost - self.leader.cost));
        let holds_leader = |state: &State<'_>| leader.iter().all(|name| sets(state).contains(name));
        let mut others = self.tried.iter().filter(|state| !holds_leader(state));
        let explained = self.leader.cost < WELL_EXPLAINED * self.leader.count() as f64;
        !leader.is_empty() && explained && others.all(|other| other.bic() - self.leader.bic() > far)
    }
}

/// The candidates and what they may be combined with.
pub(super) struct Search<'b> {
    pub(super) experiment: &'b Experiment,
    candidates: Vec<Term>,
    pub(super) counts: Counts,
    /// The noise of one coordinate \[m\].
    pub(super) noise_m: f64,
    /// Sets to which every candidate was tried to be added.
    pub(super) expanded: Vec<Vec<&'static str>>,
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

    /// From here on noise is that of `floor`, for `baseline` too, which goes to its optimum with it.
    pub(super) fn weigh(&mut self, baseline: &mut State<'_>, floor: &Floor) {
        self.noise_m = floor.noise_m;
        baseline.weigh(floor);
        baseline.descend(&mut self.counts);
    }

    /// Candidates that may join `state`.
    fn open(&self, state: &State<'_>) -> Vec<Term> {
        let taken = |term: &&Term| state.causes.iter().any(|own| self.is_same(own, term));
        self.candidates.iter().filter(|term| !taken(term)).cloned().collect()
    }

    pub(super) fn score(&mut self, state: &State<'_>) -> Scores {
        let open = self.open(state);
        self.counts.rollouts += (open.len() * state.terms.len()) as u64;
        Scores::new(state, &open)
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

    /// Whether `better` is so much better than `worse`, with fewer causes, that it is neither chance nor how those are modelled.
    fn needs(&self, baseline: &State<'_>, worse: &State<'_>, better: &State<'_>) -> bool {
        self.accepts(worse, better) && worse.cost - better.cost >= SHARE * (baseline.cost - worse.cost)
    }

    /// Looks for the best set of causes beside `baseline`.
    pub(super) fn run<'a>(&mut self, baseline: &State<'a>) -> Result<Found<'a>, DiagnoseError> {
        let first = self.first_scores(baseline)?;
        self.run_from(baseline, (baseline, first), Vec::new(), MOST_CAUSES)
    }

    /// `found`, looked for once more if the residuals of its leader show another noise than `floor`, which they may have hidden in:
    /// that is the floor then, and `baseline` weighed with it.
    pub(super) fn with_noise_seen<'a>(
        &mut self,
        baseline: &mut State<'a>,
        floor: &mut Floor,
        found: Found<'a>,
        is_clear: bool,
    ) -> Result<Found<'a>, DiagnoseError> {
        let seen = baseline::seen_floor(&found.leader)?;
        if found.leader.causes.is_empty() || baseline::is_same(floor, &seen, OTHER_NOISE) {
            return Ok(found);
        }
        *floor = seen;
        self.weigh(baseline, floor);
        self.run_again(baseline, found, floor, is_clear)
    }

    /// Looks once more with the noise of `floor`, from where the causes ended in `found`; not for others where its leader `is_clear`.
    fn run_again<'a>(
        &mut self,
        baseline: &State<'a>,
        found: Found<'a>,
        floor: &Floor,
        is_clear: bool,
    ) -> Result<Found<'a>, DiagnoseError> {
        self.expanded.clear();
        let with_causes = found.tried.iter().filter(|state| !state.causes.is_empty());
        let again: Vec<State<'a>> = match is_clear {
            true => [&found.leader].into_iter().chain(with_causes.take(SHORT_LIST)).cloned().collect(),
            false => with_causes.filter(|state| state.causes.len() == 1).take(SHORT_LIST).cloned().collect(),
        };
        let again = self.counts.of_each(again, |mut state, counts| {
            state.weigh(floor);
            state.descend(counts).then_some(state)
        });
        let mut known: Vec<State<'a>> = again.into_iter().flatten().collect();
        let leader = sets(&found.leader);
        match known.first().filter(|first| is_clear && sets(first) == leader).cloned() {
            Some(leader) => {
                let first = self.first_scores(baseline)?;
                known.push(baseline.clone());
                known.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
                Ok(Found { first, leader, tried: known })
            }
            None => {
                known.retain(|state| state.causes.len() == 1);
                let first = self.first_scores(baseline)?;
                self.run_from(baseline, (baseline, first), known, MOST_CAUSES)
            }
        }
    }

    /// Looks once more, from the model's own values, and adds what is better to `found`: a baseline that has bent far to cover
    /// for a strong cause points to others. Sets hold up to `most` causes.
    pub(super) fn run_anew<'a>(
        &mut self,
        baseline: &State<'a>,
        found: &mut Found<'a>,
        most: usize,
    ) -> Result<(), DiagnoseError> {
        let mut start = State { linear: Vec::new(), ..baseline.clone() };
        start.point.values = baseline.parameters.start();
        if !start.stay(&mut self.counts) {
            return Ok(());
        }
        self.expanded.clear();
        let first = self.first_scores(&start)?;
        self.says("trying causes at several sizes")?;
        let known = self.scanned(&start, &first);
        let anew = self.run_from(baseline, (&start, first), known, most)?;
        found.tried.extend(anew.tried);
        found.tried.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
        let (old, new) = (&found.leader, &anew.leader);
        let is_better = match new.causes.len().cmp(&old.causes.len()) {
            Ordering::Less => !self.needs(baseline, new, old),
            Ordering::Equal => new.bic() < old.bic(),
            Ordering::Greater => self.needs(baseline, old, new),
        };
        if is_better {
            found.leader = anew.leader;
        }
        Ok(())
    }

    fn first_scores(&mut self, state: &State<'_>) -> Result<Scores, DiagnoseError> {
        self.says("scoring every cause")?;
        Ok(self.score(state))
    }

    /// Looks for the best set of up to `most` causes beside `baseline`, whose first causes are added at `start`, with its scores
    /// `first`, unless they are `known`.
    fn run_from<'a>(
        &mut self,
        baseline: &State<'a>,
        (start, first): (&State<'a>, Scores),
        known: Vec<State<'a>>,
        most: usize,
    ) -> Result<Found<'a>, DiagnoseError> {
        let mut tried: Vec<State<'a>> = vec![baseline.clone()];
        let mut leader = baseline.clone();
        let mut beam: Vec<State<'a>> = Vec::new();
        let matters = negligible(self.noise_m, baseline.count());
        if self.promises(start, &first, matters) {
            self.says("refitting the most promising causes")?;
            beam = self.expand(start, &first, known);
        }
        for depth in 1..=most {
            beam.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
            beam.truncate(SHORT_LIST);
            tried.extend(beam.iter().cloned());
            let Some(best) = beam.first() else { break };
            if !self.needs(baseline, &leader, best) {
                break;
            }
            leader = best.clone();
            let mut scores = self.score(&leader);
            let mut least = matters.max(SHARE * (baseline.cost - leader.cost));
            let mut more = depth < most && self.promises(&leader, &scores, least);
            if more && depth == 1 && self.started_anew(baseline, &mut beam, &mut leader) {
                tried.extend(beam.iter().cloned());
                scores = self.score(&leader);
                least = matters.max(SHARE * (baseline.cost - leader.cost));
                more = self.promises(&leader, &scores, least);
            }
            let mut next = Vec::new();
            let leaves_much = leader.cost > (1.0 + LEFT) * leader.count() as f64;
            if more || leaves_much && depth < most {
                self.says("looking for a further cause")?;
                if more {
                    next = self.expand(&leader, &scores, Vec::new());
                }
                for mut other in beam.iter().skip(1).take(BEAM - 1).cloned() {
                    if other.descend(&mut self.counts) {
                        let scores = self.score(&other);
                        // alone, it has the leader to overtake
                        if more || self.promises(&other, &scores, least + other.cost - leader.cost) {
                            next.extend(self.expand(&other, &scores, Vec::new()));
                        }
                    }
                }
            }
            beam = next;
        }
        if leader.causes.len() > 1 {
            self.says("exchanging and dropping causes")?;
            leader = self.improved(baseline, leader, &mut tried)?;
            tried.push(leader.clone());
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
            let offsets = state.point.offsets.clone();
            let mut anew = state.started_at(&Point { values: baseline.parameters.start(), offsets });
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
                // from where the leader is as well: what it has found beside the cause must not count for the cause
                let near = self.refit(baseline, &others, &leader);
                let known = tried.iter().find(|state| sets(state) == names).cloned();
                let both = near.into_iter().chain(known);
                let Some(mut smaller) = both.min_by(|a, b| a.cost.total_cmp(&b.cost)) else { continue };
                if !self.needs(baseline, &smaller, &leader) {
                    best = Some(smaller);
                    break;
                }
                if self.expanded.contains(&names) || !smaller.descend(&mut self.counts) {
                    continue;
                }
                let scores = self.score(&smaller);
                for other in self.expand(&smaller, &scores, Vec::new()) {
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
