//! From scores to the set of causes that explains the runs best: full refits of a short list, a beam, a swap, and
//! elimination.
//!
//! One cause after the other fails where two strong ones hide each other: so the three best sets go on, not one; in the
//! end each cause must earn its place in the set, and may be exchanged for another.

use std::cmp::Ordering;

use super::DiagnoseError;
use super::baseline;
use super::baseline::Stamps;
use super::seek::Standing;
use super::sets::{FURTHER_CAUSE_SHARE, Found, MOST_CAUSES, SHORT_LIST, Search, names, negligible, sets};
use crate::fit::problem::Point;
use crate::hypothesis::candidates::Term;
use crate::hypothesis::score::Scores;
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;

/// Sets that go on to the next cause, a choice: each costs a stage of refits.
const BEAM_WIDTH: usize = 3;
/// A leader to which nothing can be added may still stand in for two causes that resemble it, if what it leaves exceeds the
/// noise's squares by this share: then the sets behind it go on.
const LEFT_BEYOND_NOISE_SHARE: f64 = 0.1;
/// Noise floors that differ by less than this share are the same: a search with the other would end as this one did.
const SAME_NOISE_SHARE: f64 = 0.04;

impl Search<'_> {
    /// From here on noise is that of `floor`, for `baseline` too, which goes to its optimum with it.
    pub(super) fn weigh(&mut self, baseline: &mut State<'_>, floor: &Floor) {
        self.floor = floor.clone();
        baseline.weigh(floor);
        baseline.descend(&mut self.counts);
    }

    /// Looks for the best set of causes beside `baseline`.
    pub(super) fn run<'a>(&mut self, baseline: &State<'a>) -> Found<'a> {
        let first = self.first_scores(baseline);
        self.run_from(baseline, (baseline, first), Vec::new(), MOST_CAUSES)
    }

    /// `standing`, looked for once more if the residuals of its leader show another noise than its floor, which they may have hidden in:
    /// that is the floor then, and the baseline weighed with it.
    pub(super) fn with_noise_seen<'a>(
        &mut self,
        standing: Standing<'a>,
        is_clear: bool,
    ) -> Result<Standing<'a>, DiagnoseError> {
        let floor = baseline::seen_floor(&standing.found.leader, Stamps::Exact)?;
        let is_same = baseline::is_same(&standing.floor, &floor, SAME_NOISE_SHARE);
        if standing.found.leader.causes.is_empty() || is_same {
            return Ok(standing);
        }
        let Standing { mut baseline, found, .. } = standing;
        self.weigh(&mut baseline, &floor);
        let found = self.run_again(&baseline, found, &floor, is_clear);
        Ok(Standing { baseline, floor, found })
    }

    /// Looks once more with the noise of `floor`, from where the causes ended in `found`; not for others where its leader `is_clear`.
    fn run_again<'a>(
        &mut self,
        baseline: &State<'a>,
        found: Found<'a>,
        floor: &Floor,
        is_clear: bool,
    ) -> Found<'a> {
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
                let first = self.first_scores(baseline);
                known.push(baseline.clone());
                known.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
                Found { first, leader, tried: known, elsewhere: Vec::new() }
            }
            None => {
                known.retain(|state| state.causes.len() == 1);
                let first = self.first_scores(baseline);
                self.run_from(baseline, (baseline, first), known, MOST_CAUSES)
            }
        }
    }

    /// Looks once more, from the model's own values, and adds what is better to `found`: a baseline that has bent far to cover
    /// for a strong cause points to others. Sets hold up to `most` causes.
    pub(super) fn run_anew<'a>(&mut self, baseline: &State<'a>, found: &mut Found<'a>, most: usize) {
        let mut start = State { linear: Vec::new(), ..baseline.clone() };
        start.point.values = baseline.parameters.start();
        if !start.stay(&mut self.counts) {
            return;
        }
        self.expanded.clear();
        let first = self.first_scores(&start);
        self.says("trying causes at several sizes");
        let known = self.scanned(&start, &first);
        let anew = self.run_from(baseline, (&start, first), known, most);
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
    }

    fn first_scores(&mut self, state: &State<'_>) -> Scores {
        self.says("scoring every cause");
        self.score(state)
    }

    /// Looks for the best set of up to `most` causes beside `baseline`, whose first causes are added at `start`, with its scores
    /// `first`, unless they are `known`.
    fn run_from<'a>(
        &mut self,
        baseline: &State<'a>,
        (start, first): (&State<'a>, Scores),
        known: Vec<State<'a>>,
        most: usize,
    ) -> Found<'a> {
        let mut tried: Vec<State<'a>> = vec![baseline.clone()];
        let mut leader = baseline.clone();
        let mut beam: Vec<State<'a>> = Vec::new();
        let matters = negligible(&self.floor, baseline.count());
        if self.promises(start, &first, matters) {
            self.says("refitting the most promising causes");
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
            self.leading = sets(&leader);
            let mut scores = self.score(&leader);
            let mut least = matters.max(FURTHER_CAUSE_SHARE * (baseline.cost - leader.cost));
            let mut more = depth < most && self.promises(&leader, &scores, least);
            if more && depth == 1 && self.started_anew(baseline, &mut beam, &mut leader) {
                tried.extend(beam.iter().cloned());
                scores = self.score(&leader);
                least = matters.max(FURTHER_CAUSE_SHARE * (baseline.cost - leader.cost));
                more = self.promises(&leader, &scores, least);
            }
            let mut next = Vec::new();
            let leaves_much = leader.cost > (1.0 + LEFT_BEYOND_NOISE_SHARE) * leader.count() as f64;
            if more || leaves_much && depth < most {
                self.says("looking for a further cause");
                if more {
                    next = self.expand(&leader, &scores, Vec::new());
                }
                for mut other in beam.iter().skip(1).take(BEAM_WIDTH - 1).cloned() {
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
            self.says("exchanging and dropping causes");
            leader = self.improved(baseline, leader, &mut tried);
            tried.push(leader.clone());
        }
        tried.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
        self.leading = sets(&leader);
        Found { tried, leader, first, elsewhere: Vec::new() }
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
        for state in beam.iter_mut().take(BEAM_WIDTH) {
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
    ) -> State<'a> {
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
        leader
    }
}

fn without(causes: &[Term], dropped: usize) -> Vec<Term> {
    causes.iter().enumerate().filter(|(place, _)| *place != dropped).map(|(_, term)| term.clone()).collect()
}
