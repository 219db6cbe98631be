//! What these runs would have shown: the smallest size of every cause.

use std::collections::BTreeMap;

use sim::Cause;
use sim::causes::Role;

use super::result::Detectable;
use crate::experiment::Experiment;
use crate::fit::counts::Counts;
use crate::hypothesis::candidates::{self, Term};
use crate::hypothesis::score::Scores;
use crate::hypothesis::state::State;

/// Cost saved at which a cause is seen beyond doubt: of one number, 5.5 standard deviations from neutral.
pub(super) const BEYOND_DOUBT_COST: f64 = 30.0;

/// For each size of each cause the smallest that would raise the cost by 30 whatever the fitted numbers do; of hidden
/// numbers, at the value where it shows best.
pub(super) fn detectable(
    experiment: &Experiment,
    state: &State<'_>,
    causes: &[Cause],
    counts: &Counts,
) -> Vec<Detectable> {
    let terms = |cause: &Cause| Term::all(*cause, &experiment.model, 1, 1.0, &experiment.diagnose.elements);
    let terms: Vec<Term> = causes.iter().flat_map(terms).filter(|term| !term.is_choice()).collect();
    let scores = Scores::new(state, &terms, counts);
    let mut squares: Vec<((usize, String), f64)> = Vec::new();
    for (place, column) in scores.columns.iter().enumerate() {
        let square = scores.projected.column(place).norm_squared();
        let key = (column.candidate, column.name.clone());
        match squares.iter_mut().find(|(known, _)| *known == key) {
            // each run has its own: together they show it
            Some((_, sum)) => *sum += square,
            None => squares.push((key, square)),
        }
    }
    let mut list: Vec<Detectable> = Vec::new();
    let mut limits: BTreeMap<String, f64> = BTreeMap::new();
    for ((candidate, name), square) in squares {
        let term = &scores.list[candidate];
        let model = term.added_to(&state.model);
        let parameters = candidates::names(term.cause, &model);
        let Some((_, info)) = parameters.iter().find(|(known, _)| *known == name) else { continue };
        if info.role == Role::Switch {
            // the hidden number says how much of it there is
            let Some((hidden, value)) = term.hidden.first() else { continue };
            let unit = parameters.iter().find(|(known, _)| known == hidden).map_or("", |(_, info)| info.unit);
            let highest = limits.entry(hidden.clone()).or_insert(0.0);
            if square >= BEYOND_DOUBT_COST {
                *highest = highest.max(*value);
            }
            let smallest = Some(*highest).filter(|rate| *rate > 0.0);
            put(&mut list, Detectable { name: hidden.clone(), smallest, unit: unit.into() }, f64::max);
            continue;
        }
        let size = (BEYOND_DOUBT_COST / square.max(f64::MIN_POSITIVE)).sqrt();
        let most = info.bounds[1].abs().max(info.bounds[0].abs());
        let smallest = Some(size).filter(|size| *size <= most);
        put(&mut list, Detectable { name, smallest, unit: info.unit.into() }, f64::min);
    }
    list.sort_by(|a, b| a.name.cmp(&b.name));
    list
}

fn put(list: &mut Vec<Detectable>, entry: Detectable, better: impl Fn(f64, f64) -> f64) {
    match list.iter_mut().find(|known| known.name == entry.name) {
        Some(known) => {
            known.smallest = match (known.smallest, entry.smallest) {
                (Some(a), Some(b)) => Some(better(a, b)),
                (a, b) => a.or(b),
            };
        }
        None => list.push(entry),
    }
}
