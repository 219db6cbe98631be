//! Causes too strong for derivatives: each is tried at several sizes, from the model's own values.
//!
//! What bends the baseline out of shape is hidden from the score test, which looks along straight lines from there. A chain with a
//! rubber sleeve on each hinge moves otherwise altogether; only a simulation with sleeves shows it.

use super::sets::{SHORT_LIST, Search};
use crate::fit::problem::Point;
use crate::hypothesis::candidates::Term;
use crate::hypothesis::score::Scores;
use crate::hypothesis::state::State;

/// Sizes that are tried, over the one that would move the keypoints by as much as they are away, were all linear.
const TRIED_SIZES: [f64; 6] = [0.1, 0.3, 1.0, 3.0, 10.0, 30.0];
/// Descents that go on for as long as each saves more than this.
const WORTH_A_DESCENT_COST: f64 = 1.0;
const MOST_DESCENTS: usize = 4;

impl Search<'_> {
    /// `start`, which `scores` belong to, with each single cause at the size at which it comes nearest to the runs, the best of them
    /// refitted.
    pub(super) fn scanned<'a>(&mut self, start: &State<'a>, scores: &Scores) -> Vec<State<'a>> {
        // of the elements that a cause may sit in, the most promising: the others come to their turn where it leads
        let of = |index: usize| &scores.list[index];
        let is_first = |&index: &usize| {
            let mut forms =
                (0..scores.list.len()).filter(|&other| of(other).term.is_form_of(&of(index).term));
            forms.all(|other| match of(other).gain.total_cmp(&of(index).gain) {
                std::cmp::Ordering::Less => true,
                std::cmp::Ordering::Equal => other >= index,
                std::cmp::Ordering::Greater => false,
            })
        };
        let all: Vec<usize> = (0..scores.list.len()).filter(is_first).collect();
        let scanned = self.counts.of_each(all, |index, counts| {
            let term = &scores.list[index].term;
            let mut state = start.with(term);
            state.begin(term, start);
            let points = points(term, &state, |name| Some(start.cost.sqrt() / scores.length(index, name)?));
            let costs = state.problem().costs(&points, counts);
            let best = points.into_iter().zip(costs).min_by(|a, b| a.1.total_cmp(&b.1));
            best.map(|(point, cost)| State { point, cost, ..state })
        });
        let mut scanned: Vec<State<'a>> =
            scanned.into_iter().flatten().filter(|state| state.cost < start.cost).collect();
        scanned.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut best: Vec<State<'a>> = Vec::new();
        for state in scanned {
            let same =
                |other: &State<'a>| other.causes.iter().zip(&state.causes).all(|(a, b)| self.is_same(a, b));
            if best.len() < SHORT_LIST && !best.iter().any(same) {
                best.push(state);
            }
        }
        let noise_m = self.floor.noise_m;
        let refitted = self.counts.of_each(best, |mut state, counts| {
            for _ in 0..MOST_DESCENTS {
                let before = state.cost;
                state.replan(noise_m, counts);
                if !state.descend(counts) {
                    return None;
                }
                if before - state.cost < WORTH_A_DESCENT_COST {
                    break;
                }
            }
            Some(state)
        });
        refitted.into_iter().flatten().collect()
    }
}

/// Points of `state`, whose last cause is `term`, with each of its sizes in turn at some, of either sign, over what is `usual`.
fn points(term: &Term, state: &State<'_>, usual: impl Fn(&str) -> Option<f64>) -> Vec<Point> {
    if term.is_switch() {
        return vec![state.point.clone()];
    }
    let mut points = Vec::new();
    for (name, per_run, [lower, upper]) in term.directions(&state.model) {
        let place = state.parameters.free.iter().position(|parameter| parameter.name() == name);
        let (false, Some(place), Some(usual)) = (per_run, place, usual(&name)) else { continue };
        for size in TRIED_SIZES.iter().flat_map(|size| [size * usual, -size * usual]) {
            let mut point = state.point.clone();
            point.values[place] += size;
            if (lower..=upper).contains(&point.values[place]) {
                points.push(point);
            }
        }
    }
    points
}
