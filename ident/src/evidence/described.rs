//! A set of causes as a fitted model: what a report, and whoever plans the next run, starts from.

use super::columns::{Column, columns};
use super::fit::{Fitted, MOST_STEPS};
use super::linear::{Bench, Point, Setting};
use super::search::Pool;
use super::verdict::{Evidence, Standing};
use super::{Form, Found};
use crate::fit::counts::Counts;
use crate::hypothesis::candidates::Term;
use crate::hypothesis::state::State;

/// The models behind `evidence`. They are small beside the search, so nobody is asked whether to go on. `None` where the best cannot be
/// simulated.
pub(super) fn described<'a>(pool: &Pool<'_, 'a>, evidence: Evidence) -> Option<Found<'a>> {
    let bench = pool.fitter.bench;
    let mut counts = Counts::default();
    let best = &pool.fitted[pool.best()?];
    let leader = state(bench, &best.setting, &best.point, &mut counts)?;
    let atoms = &bench.atoms.list;
    let is_named = |&atom: &usize| {
        let same = |cause: &&super::FoundCause| {
            cause.standing == Standing::Named && cause.class == atoms[atom].class && atoms[atom].is_named()
        };
        evidence.causes.iter().any(|cause| same(&cause))
    };
    let set: Vec<usize> = best.setting.set.iter().copied().filter(is_named).collect();
    let named = if set == best.setting.set {
        leader.clone()
    } else {
        let setting = bench.setting(&set);
        let point = Point { sizes: sizes_in(best, &setting.columns), ..best.point.clone() };
        let scales = (best.scored.scales, best.scored.tau);
        let (fitted, _) = pool.fitter.fit(setting, point, scales, (true, MOST_STEPS), &mut counts)?;
        state(bench, &fitted.setting, &fitted.point, &mut counts)?
    };
    let classes = |fitted: &Fitted| -> Vec<&str> {
        let mut list: Vec<&str> = fitted.setting.set.iter().map(|&atom| &*atoms[atom].class).collect();
        list.sort_unstable();
        list
    };
    let others = pool.fitted.iter().filter(|other| classes(other) != classes(best));
    let rival = others
        .max_by(|a, b| a.scored.ln_z.total_cmp(&b.scored.ln_z))
        .and_then(|other| state(bench, &other.setting, &other.point, &mut counts));
    Some(Found { evidence, leader, named, rival })
}

/// The sizes that `columns` have in `fitted`.
fn sizes_in(fitted: &Fitted, columns: &[Column]) -> Vec<f64> {
    let known = |column: &Column| {
        let own = fitted.setting.columns.iter().position(|other| other == column);
        own.map_or(0.0, |place| fitted.point.sizes[place])
    };
    columns.iter().map(known).collect()
}

/// `setting` at `point` as a fitted model; what is not the same in all runs is a number of each run's own there.
fn state<'a>(bench: &Bench<'a>, setting: &Setting, point: &Point, counts: &mut Counts) -> Option<State<'a>> {
    let mut state = State { linear: Vec::new(), ..bench.state.clone() };
    for &atom in &setting.set {
        let atom = &bench.atoms.list[atom];
        state = state.with(&Term { by_run: atom.form != Form::All, ..atom.term.clone() });
    }
    state.point.values[..point.base.len()].copy_from_slice(&point.base);
    for (own, given) in state.point.offsets.iter_mut().zip(&point.offsets) {
        own[..given.len()].copy_from_slice(given);
    }
    for run in 0..bench.runs() {
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
    debug_assert_eq!(columns(&bench.atoms, &setting.set).len(), setting.columns.len());
    state.stay(counts).then_some(state)
}
