//! A set of causes as a fitted model: what a report, and whoever plans the next run, starts from.

use std::collections::BTreeMap;

use super::columns::Belief;
use super::fit::{Effort, Fitted, Fitter, MOST_STEPS};
use super::linear::{Bench, Point, Setting};
use super::search::Pool;
use super::verdict::{Evidence, FoundCause, Size, Standing};
use super::{Form, Found};
use crate::fit::counts::Counts;
use crate::hypothesis::candidates::Term;
use crate::hypothesis::state::State;

/// 95 % of a normal distribution lie within so many standard deviations.
const WITHIN_95: f64 = 1.959_964;
/// Sets whose sizes count, the most probable first, and how probable each is at least over the best (chosen).
const MOST_LIKELY: usize = 8;
const LIKELY_SHARE: f64 = 0.01;

/// The models behind `evidence`, and its sizes, as the first `fitted` runs have them; the best set's alone where nobody waits for more than
/// what was found. `None` where that cannot be simulated.
pub(super) fn described<'a>(
    pool: &Pool<'_, 'a>,
    fitted: usize,
    mut evidence: Evidence,
    is_awaited: bool,
) -> Option<Found<'a>> {
    let mut counts = Counts::default();
    let all = pool.fitter.bench;
    let run_ids = all.state.terms.iter().map(|term| term.rehearsal.run.id.clone()).collect();
    let own = (fitted < all.runs()).then(|| all.seeing(fitted));
    let bench = own.as_ref().unwrap_or(all);
    let fitter = Fitter::new(bench, pool.fitter.noise_share);
    let atoms = &bench.atoms.list;
    let best = &pool.fitted[pool.best()?];
    let classes = |fitted: &Fitted| -> Vec<&str> {
        let mut list: Vec<&str> = fitted.setting.set.iter().map(|&atom| &*atoms[atom].class).collect();
        list.sort_unstable();
        list
    };
    let effort = Effort { unknown: true, steps: MOST_STEPS, least: f64::NEG_INFINITY };
    // the same sets as the fitted runs alone have them
    let mut refit = |from: &Fitted, set: &[usize]| -> Option<Fitted> {
        let setting = bench.setting(set);
        let point = Point { sizes: from.sizes_in(&setting.columns), ..from.point.clone() };
        Some(fitter.fit(setting, point, (from.scored.scales, from.scored.tau), effort, &mut counts)?.0)
    };
    let mut order: Vec<&Fitted> = pool.fitted.iter().collect();
    order.sort_by(|a, b| b.scored.ln_z.total_cmp(&a.scored.ln_z));
    let weight = |fitted: &Fitted| (fitted.scored.ln_z - best.scored.ln_z).exp();
    let likely = order.iter().filter(|fitted| weight(fitted) > LIKELY_SHARE);
    let likely: Vec<&Fitted> = likely.take(if is_awaited { MOST_LIKELY } else { 1 }).copied().collect();
    let refitted: Vec<Option<Fitted>> = match own {
        Some(_) => likely.iter().map(|from| refit(from, &from.setting.set)).collect(),
        None => Vec::new(),
    };
    let own_of = |place: usize| refitted.get(place).map_or(Some(likely[place]), Option::as_ref);
    let list: Vec<(&Fitted, f64)> =
        (0..likely.len()).filter_map(|place| Some((own_of(place)?, weight(likely[place])))).collect();
    let leader = own_of(0)?;
    let rival = order.iter().find(|other| is_awaited && classes(other) != classes(best));
    let rival = rival.and_then(|rival| refit(rival, &rival.setting.set));
    let is_named = |&atom: &usize| {
        let same = |cause: &FoundCause| {
            cause.standing == Standing::Named && cause.class == atoms[atom].class && atoms[atom].is_named()
        };
        evidence.causes.iter().any(same)
    };
    let set: Vec<usize> = best.setting.set.iter().copied().filter(is_named).collect();
    let named = if set == best.setting.set { None } else { Some(refit(best, &set)?) };
    for cause in &mut evidence.causes {
        cause.sizes = sizes(bench, &list, &cause.label);
    }
    let mut state = |of: &Fitted| state(bench, fitted, (&of.setting, &of.point), &mut counts);
    let leader = state(leader)?;
    let named = match named {
        Some(named) => state(&named)?,
        None => leader.clone(),
    };
    let rival = rival.and_then(|rival| state(&rival));
    let best = (best.setting.set.clone(), best.point.clone());
    Some(Found { evidence, run_ids, leader, named, rival, best })
}

/// `setting` at `point` as a fitted model of the first `fitted` runs; what is not the same in all runs is a number of each run's own there.
fn state<'a>(
    bench: &Bench<'a>,
    fitted: usize,
    (setting, point): (&Setting, &Point),
    counts: &mut Counts,
) -> Option<State<'a>> {
    let mut state = State { linear: Vec::new(), ..bench.state.clone() };
    state.terms.truncate(fitted);
    state.point.offsets.truncate(fitted);
    for &atom in &setting.set {
        let atom = &bench.atoms.list[atom];
        state = state.with(&Term { by_run: atom.form != Form::All, ..atom.term.clone() });
    }
    state.point.values[..point.base.len()].copy_from_slice(&point.base);
    for (own, given) in state.point.offsets.iter_mut().zip(&point.offsets) {
        own[..given.len()].copy_from_slice(given);
    }
    for run in 0..fitted {
        for (&number, value) in setting.numbers.iter().zip(setting.values(&bench.atoms, &point.sizes, run)) {
            let name = &bench.atoms.numbers[number].name;
            if let Some(place) = state.parameters.free.iter().position(|free| free.name() == name) {
                let acts = setting.columns.iter().any(|c| c.number == number && c.acts_in(run));
                if acts {
                    state.point.values[place] = value;
                }
                continue;
            }
            let nuisances = &state.terms[run].rehearsal.nuisances;
            let own = nuisances.iter().position(|own| state.own_name(*own) == Some(name));
            if let Some(place) = own {
                state.point.offsets[run][place] = value;
            }
        }
    }
    state.stay(counts).then_some(state)
}

/// The numbers of the atoms called `label`, over those of `likely` that hold one, each with its weight.
fn sizes(bench: &Bench<'_>, likely: &[(&Fitted, f64)], label: &str) -> Vec<Size> {
    let atoms = &bench.atoms;
    let holds = |set: &[usize]| set.iter().any(|&atom| atoms.list[atom].label() == label);
    let mut sums: BTreeMap<(String, Vec<usize>), [f64; 3]> = BTreeMap::new();
    for &(fitted, weight) in likely.iter().filter(|(fitted, _)| holds(&fitted.setting.set)) {
        let mut place = 0;
        let own = |number: usize| {
            let has = |&atom: &usize| {
                atoms.list[atom].label() == label && atoms.list[atom].numbers.contains(&number)
            };
            fitted.setting.set.iter().any(has)
        };
        for (column, (size, found)) in
            fitted.setting.columns.iter().zip(fitted.point.sizes.iter().zip(&fitted.scored.sizes))
        {
            let variance = found.map(|_| {
                place += 1;
                fitted.scored.covariance[(place - 1, place - 1)]
            });
            if !own(column.number) {
                continue;
            }
            let known = &atoms.numbers[column.number];
            let start = if matches!(column.belief, Belief::Hidden(_)) { known.neutral } else { 0.0 };
            let value = start + found.unwrap_or(*size);
            let runs = if column.runs.len() == bench.runs() { Vec::new() } else { column.runs.clone() };
            let sum = sums.entry((known.name.clone(), runs)).or_default();
            sum[0] += weight;
            sum[1] += weight * value;
            sum[2] += weight * (variance.unwrap_or(0.0) + value * value);
        }
    }
    let size = |((name, runs), [weight, first, second]): ((String, Vec<usize>), [f64; 3])| {
        let value = first / weight;
        let half = WITHIN_95 * (second / weight - value * value).max(0.0).sqrt();
        Size { name, runs, value, ci95: [value - half, value + half] }
    };
    sums.into_iter().map(size).collect()
}
