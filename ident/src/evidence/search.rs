//! The search: a pool of sets of causes, each at its optimum, grown best first.
//!
//! About the optimum of a set all candidates are looked at (`Fitter::expand`), and every set one move away has a score at once, as far as all
//! is linear: cause added, dropped, exchanged (for another cause, form, element or hidden start), or a by-run form *split* into a form that
//! names and one more cause. Such predictions rank, refits decide. The search ends when no prediction comes near the best.
//!
//! An unknown force can stand in for a cause at its own optimum. So where the best set keeps one, the search looks once more from where
//! that set is without it, and refits what would be best there.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use super::atoms::Form;
use super::columns::{Column, columns, has_deviations};
use super::fit::{Effort, Fitted, Fitter, MOST_STEPS};
use super::linear::{Bench, Point, RunColumns};
use super::priors::{OFF, Scales};
use super::score::{Scored, TAU_START, better, taus};
use crate::fit::counts::Counts;

/// What is predicted to be within so many nats of the best is refitted: odds of 20 to 1 (a prototype, chosen).
const NEAR: f64 = 3.0;
/// So many refits that change nothing about which set is best are enough (chosen): in linear regime predictions are right to a tenth of a nat.
const MOST_IN_VAIN: usize = 8;
/// A gain that is worth a step of the climb, in nats.
const WORTH_A_CAUSE: f64 = 0.5;
/// The same for a set of as many causes: what stood elsewhere is predicted from further away (chosen by a prototype: quartiles of 0 and 6 nats too
/// low).
const NEAR_EXCHANGED: f64 = 8.0;
/// A set that is so many nats below the best once the unknown is let in is not followed any further (chosen: three times what refits gained
/// over predictions in 19 of 20 sets of a prototype).
const HOPELESS_BELOW_BEST_NATS: f64 = 100.0;
/// Sets fitted without the unknown, and how many of these to the end (a prototype, chosen).
const SCOUTS: usize = 6;
const FINISHED_SCOUTS: usize = 2;
/// The same where a set is known already that explains as much (chosen: half of the time).
const FEW_SCOUTS: [usize; 2] = [3, 1];
/// Steps of a scout.
const SCOUT_STEPS: usize = 3;

/// What a model leaves over the noise, in squares, beyond which causes are looked for from its own values too (chosen: five times the noise).
const FAR_FROM_LINEAR: f64 = 25.0;

/// A set of causes: places in the list of atoms, rising.
pub(super) type Set = Vec<usize>;

/// A set one move from a fitted one.
#[derive(Debug, Clone)]
pub(super) struct Predicted {
    pub(super) scored: Scored,
    /// The place in the pool of what it was predicted from.
    parent: usize,
}

/// The sets found so far.
pub(super) struct Pool<'b, 'a> {
    pub(super) fitter: Fitter<'b, 'a>,
    pub(super) fitted: Vec<Fitted>,
    /// Columns of those that are not expanded yet, by place.
    columns: BTreeMap<usize, Vec<RunColumns>>,
    pub(super) predicted: BTreeMap<Set, Predicted>,
    /// What cannot be simulated wherever it was tried: there is no such explanation, whatever is predicted of it.
    impossible: BTreeSet<Set>,
    pub(super) fits: usize,
}

impl<'b, 'a> Pool<'b, 'a> {
    pub(super) fn new(fitter: Fitter<'b, 'a>) -> Self {
        Self {
            fitter,
            fitted: Vec::new(),
            columns: BTreeMap::new(),
            predicted: BTreeMap::new(),
            impossible: BTreeSet::new(),
            fits: 0,
        }
    }

    fn bench(&self) -> &'b Bench<'a> {
        self.fitter.bench
    }

    /// The place of the best.
    pub(super) fn best(&self) -> Option<usize> {
        (0..self.fitted.len()).max_by(|&a, &b| {
            self.fitted[a].scored.ln_z.total_cmp(&self.fitted[b].scored.ln_z).then(b.cmp(&a))
        })
    }

    /// Searches until nothing near the best is left, or nobody waits any longer; whether it came to its end. `says` is told what is tried.
    /// `from`: a set that was best before, and where.
    pub(super) fn search(
        &mut self,
        from: Option<&(Set, Point)>,
        counts: &mut Counts,
        says: &mut dyn FnMut(&str) -> bool,
    ) -> bool {
        let (point, scales) = self.fitter.baseline();
        // there is an answer however little time there is
        let mut first = Counts::default();
        let Some(mut start) = self.quiet(&[], point, scales.1, MOST_STEPS, &mut first) else { return false };
        counts.add(&first);
        let known =
            from.and_then(|(set, point)| self.quiet(set, point.clone(), TAU_START, MOST_STEPS, counts));
        if let Some(known) = known.filter(|known| known.0.scored.ln_z > start.0.scored.ln_z) {
            self.keep(std::mem::replace(&mut start, known).0);
        }
        if !self.climb(start, None, counts, says) {
            return false;
        }
        let mut chosen_otherwise: BTreeSet<Set> = BTreeSet::new();
        let mut climbed: BTreeSet<(Set, Option<usize>)> = BTreeSet::new();
        let (mut in_vain, mut leader) = (0, None);
        loop {
            if counts.is_stopped() {
                return false;
            }
            let Some(best) = self.best() else { return false };
            if leader != Some(best) {
                (in_vain, leader) = (0, Some(best));
            }
            if !self.fitted[best].is_expanded {
                self.expand(best, counts);
                continue;
            }
            if let Some(set) = self.choices(best).into_iter().find(|set| !chosen_otherwise.contains(set)) {
                if !says(&self.label(&set)) {
                    return false;
                }
                self.choose(best, &set, counts);
                chosen_otherwise.insert(set);
                continue;
            }
            let set = self.fitted[best].setting.set.clone();
            let from_off = (self.fitted[best].scored.scales != OFF).then_some(None);
            let mut ways = set.iter().copied().map(Some).chain(from_off);
            if let Some(gone) = ways.find(|gone| climbed.insert((set.clone(), *gone))) {
                let rest: Set = set.iter().copied().filter(|atom| Some(*atom) != gone).collect();
                if !self.climb_from(best, &rest, gone, counts, says) {
                    return false;
                }
                continue;
            }
            if let Some(set) = self.nearest(best).filter(|_| in_vain < MOST_IN_VAIN) {
                if !says(&self.label(&set)) {
                    return false;
                }
                in_vain += 1;
                self.refit(set, counts);
                continue;
            }
            let near = |&place: &usize| {
                !self.fitted[place].is_expanded
                    && self.fitted[place].scored.ln_z > self.fitted[best].scored.ln_z - NEAR
            };
            if let Some(place) = (0..self.fitted.len()).find(near).filter(|_| in_vain < MOST_IN_VAIN) {
                self.expand(place, counts);
                continue;
            }
            return true;
        }
    }

    /// `set` fitted from `point`, the unknown off.
    fn quiet(
        &mut self,
        set: &[usize],
        point: Point,
        tau: usize,
        steps: usize,
        counts: &mut Counts,
    ) -> Option<(Fitted, Vec<RunColumns>)> {
        self.fits += 1;
        let setting = self.bench().setting(set);
        self.fitter.fit(
            setting,
            point,
            (OFF, tau),
            Effort { unknown: false, steps, least: f64::NEG_INFINITY },
            counts,
        )
    }

    /// Climbs from `set`, some of the causes of the best, without any of the class of `gone`.
    fn climb_from(
        &mut self,
        best: usize,
        set: &[usize],
        gone: Option<usize>,
        counts: &mut Counts,
        says: &mut dyn FnMut(&str) -> bool,
    ) -> bool {
        let from = &self.fitted[best];
        let setting = self.bench().setting(set);
        let point = Point { sizes: from.sizes_in(&setting.columns), ..from.point.clone() };
        let (tau, most) = (from.scored.tau, from.setting.set.len() + 1);
        let Some(start) = self.quiet(set, point, tau, MOST_STEPS, counts) else {
            return !counts.is_stopped();
        };
        self.climb(start, gone.map(|gone| (gone, most)), counts, says)
    }

    /// Climbs with the unknown off, a cause at a time, from `start`, and takes every set on the way into the pool, the unknown let in: an unknown
    /// that is there from the beginning imitates what it should reveal. `without`: an atom whose class is left alone, and how many causes
    /// there may be: what explains as much with two causes more is too dear by their odds.
    fn climb(
        &mut self,
        start: (Fitted, Vec<RunColumns>),
        without: Option<(usize, usize)>,
        counts: &mut Counts,
        says: &mut dyn FnMut(&str) -> bool,
    ) -> bool {
        let (mut at, own) = start;
        let [scouted, finished] = if without.is_some() { FEW_SCOUTS } else { [SCOUTS, FINISHED_SCOUTS] };
        let mut way = Vec::new();
        let mut fresh = Some(own);
        loop {
            way.push((at.setting.set.clone(), at.point.clone(), at.scored.tau, at.scored.ln_z));
            let Some(columns) = fresh.take() else { break };
            self.fitter.expand(&mut at, columns, false, counts);
            let mut list = self.neighbours(&at, 0, false);
            list.retain(|(_, predicted)| predicted.scored.ln_z > at.scored.ln_z);
            list.sort_by(|a, b| b.1.scored.ln_z.total_cmp(&a.1.scored.ln_z));
            let atoms = &self.bench().atoms.list;
            if let Some((gone, most)) = without {
                let is_gone = |&atom: &usize| atoms[atom].class == atoms[gone].class;
                list.retain(|(set, _)| set.len() <= most && !set.iter().any(is_gone));
            }
            // a force by run is a sponge as long as something else is missing
            let is_sponge = |set: &Set| {
                let mut fresh = set.iter().filter(|atom| !at.setting.set.contains(atom));
                fresh.any(|&atom| !atoms[atom].differs && atoms[atom].form != Form::All)
            };
            if list.iter().any(|(set, _)| !is_sponge(set)) {
                list.retain(|(set, _)| !is_sponge(set));
            }
            // several causes and laws rather than several forms of one
            let mut seen = BTreeSet::new();
            let laws = |set: &Set| -> Vec<String> { set.iter().map(|&atom| atoms[atom].law()).collect() };
            list.retain(|(set, _)| seen.insert(laws(set)));
            let mut scouts: Vec<Fitted> = Vec::new();
            for (set, predicted) in list.into_iter().take(scouted) {
                if !says(&self.label(&set)) || counts.is_stopped() {
                    self.keep(at);
                    return false;
                }
                let setting = self.bench().setting(&set);
                let target = self.fitter.target(&setting, &at.point, &at.gram, &predicted.scored);
                let scout = target
                    .and_then(|point| self.quiet(&set, point, predicted.scored.tau, SCOUT_STEPS, counts));
                scouts.extend(scout.map(|(scout, _)| scout));
            }
            if at.setting.set.is_empty() && without.is_none() && self.fitter.misfit(&at) > FAR_FROM_LINEAR {
                scouts.extend(self.scouts_of_own_values(counts, says));
            }
            scouts.sort_by(|a, b| b.scored.ln_z.total_cmp(&a.scored.ln_z));
            let mut next: Option<(Fitted, Vec<RunColumns>)> = None;
            for scout in scouts.into_iter().take(finished) {
                let found = self.quiet(&scout.setting.set, scout.point, scout.scored.tau, MOST_STEPS, counts);
                let ln_z = next.as_ref().map_or(at.scored.ln_z + WORTH_A_CAUSE, |(next, _)| next.scored.ln_z);
                next = found.filter(|(found, _)| found.scored.ln_z > ln_z).or(next);
            }
            let Some((fitted, own)) = next else { break };
            // whoever waits no longer has what was found on the way
            self.keep(std::mem::replace(&mut at, fitted));
            fresh = Some(own);
        }
        self.keep(at);
        // where it leads is what matters where the way began at a set that is known
        let between = if without.is_some() { 1..way.len().saturating_sub(1).max(1) } else { 0..0 };
        way.drain(between);
        for (set, point, tau, ln_z) in way {
            let is_better =
                |known: &Fitted| known.is_free && known.setting.set == set && known.scored.ln_z > ln_z;
            if !self.fitted.iter().any(is_better) {
                self.add(set, point, (OFF, tau), counts);
            }
        }
        !counts.is_stopped()
    }

    /// One cause of each law, fitted from the model's own values: where much is missing, what is fitted anyway has gone far to make up for it, and
    /// what is linear there says nothing of where the cause itself would lead. Half of them at a time go on, twice as far.
    fn scouts_of_own_values(
        &mut self,
        counts: &mut Counts,
        says: &mut dyn FnMut(&str) -> bool,
    ) -> Vec<Fitted> {
        let state = &self.bench().state;
        let offsets = state.point.offsets.iter().map(|own| vec![0.0; own.len()]).collect();
        let own = Point { base: state.parameters.start(), offsets, sizes: Vec::new() };
        let Some((mut at, columns)) = self.quiet(&[], own, TAU_START, 0, counts) else { return Vec::new() };
        self.fitter.expand(&mut at, columns, false, counts);
        let mut list = self.neighbours(&at, 0, false);
        let atoms = &self.bench().atoms.list;
        list.retain(|(set, _)| set.iter().all(|&atom| atoms[atom].form == Form::All));
        list.sort_by(|a, b| b.1.scored.ln_z.total_cmp(&a.1.scored.ln_z));
        let mut seen = BTreeSet::new();
        list.retain(|(set, _)| set.iter().all(|&atom| seen.insert(atoms[atom].law())));
        let targets = list.into_iter().filter_map(|(set, predicted)| {
            let setting = self.bench().setting(&set);
            let point = self.fitter.target(&setting, &at.point, &at.gram, &predicted.scored)?;
            Some((set, point))
        });
        let mut left: Vec<(Set, Point)> = targets.collect();
        let mut steps = 1;
        loop {
            let mut scouts: Vec<Fitted> = Vec::new();
            for (set, point) in left {
                if counts.is_stopped() || !says(&self.label(&set)) {
                    return scouts;
                }
                scouts.extend(self.quiet(&set, point, TAU_START, steps, counts).map(|(scout, _)| scout));
            }
            // where each is on its way to, as far as that is linear
            let ahead = |scout: &Fitted| scout.scored.ln_z + scout.shortfall;
            scouts.sort_by(|a, b| ahead(b).total_cmp(&ahead(a)));
            scouts.truncate(scouts.len().div_ceil(2));
            if scouts.len() <= FINISHED_SCOUTS {
                return scouts;
            }
            left = scouts.into_iter().map(|scout| (scout.setting.set, scout.point)).collect();
            steps *= 2;
        }
    }

    /// Takes in what was fitted without the unknown, as far as its set is not there yet.
    fn keep(&mut self, quiet: Fitted) {
        if !self.fitted.iter().any(|known| known.setting.set == quiet.setting.set) {
            self.fitted.push(quiet);
        }
    }

    /// A set in words.
    pub(super) fn label(&self, set: &[usize]) -> String {
        let names: Vec<String> = set.iter().map(|&atom| self.bench().atoms.list[atom].label()).collect();
        if names.is_empty() { "nothing".into() } else { names.join(" + ") }
    }

    /// The best prediction near the best fit that is not fitted: first among those predicted from the best itself.
    fn nearest(&self, best: usize) -> Option<Set> {
        let (most, size) = (self.fitted[best].scored.ln_z, self.fitted[best].setting.set.len());
        let reach = |set: &Set| if set.len() == size { NEAR_EXCHANGED } else { NEAR };
        let near = self.predicted.iter().filter(|(set, found)| found.scored.ln_z > most - reach(set));
        // what was fitted may be predicted to be better from elsewhere: its fit has not gone to the end then
        let is_fresh = |set: &Set, ln_z: f64| {
            let same = |fitted: &&Fitted| fitted.setting.set == *set;
            self.fitted.iter().find(same).is_none_or(|known| known.scored.ln_z < ln_z - WORTH_A_CAUSE)
        };
        let fresh = near.filter(|(set, found)| is_fresh(set, found.scored.ln_z));
        fresh
            .max_by(|(_, a), (_, b)| {
                let key = |p: &Predicted| p.parent == best;
                key(a).cmp(&key(b)).then(a.scored.ln_z.total_cmp(&b.scored.ln_z))
            })
            .map(|(set, _)| set.clone())
    }

    /// Fits `set` from a point and takes it in; whether it can be.
    fn add(&mut self, set: Set, point: Point, scales: (Scales, usize), counts: &mut Counts) -> bool {
        self.fits += 1;
        let setting = self.bench().setting(&set);
        let least = self
            .best()
            .map_or(f64::NEG_INFINITY, |best| self.fitted[best].scored.ln_z - HOPELESS_BELOW_BEST_NATS);
        let effort = Effort { unknown: true, steps: MOST_STEPS, least };
        let Some((fitted, columns)) = self.fitter.fit(setting, point, scales, effort, counts) else {
            self.predicted.remove(&set);
            if !counts.is_stopped() {
                self.impossible.insert(set);
            }
            return false;
        };
        let place = match self.fitted.iter().position(|known| known.setting.set == set) {
            Some(known)
                if self.fitted[known].is_free && self.fitted[known].scored.ln_z >= fitted.scored.ln_z =>
            {
                return true;
            }
            Some(known) => {
                self.fitted[known] = fitted;
                known
            }
            None => {
                self.fitted.push(fitted);
                self.fitted.len() - 1
            }
        };
        self.columns.insert(place, columns);
        true
    }

    /// The set at `best` with another choice made for one of its causes: no derivative leads from one to the other.
    fn choices(&self, best: usize) -> Vec<Set> {
        let atoms = &self.bench().atoms.list;
        let set = &self.fitted[best].setting.set;
        let mut list = Vec::new();
        for &own in set {
            let is_choice = |&other: &usize| {
                let (own, other) = (&atoms[own], &atoms[other]);
                let is_placed = own.term.cause == other.term.cause && own.term.element == other.term.element;
                is_placed && own.form == other.form && own.term.choices != other.term.choices
            };
            for other in (0..atoms.len()).filter(is_choice) {
                let mut next: Set = set.iter().map(|&atom| if atom == own { other } else { atom }).collect();
                next.sort_unstable();
                list.push(next);
            }
        }
        list
    }

    /// Fits `set` from where the set at `best` is, with the sizes that its causes have there.
    fn choose(&mut self, best: usize, set: &Set, counts: &mut Counts) {
        let setting = self.bench().setting(set);
        let from = &self.fitted[best];
        let numbers = &self.bench().atoms.numbers;
        let size = |column: &Column| {
            let same = |own: &Column| {
                numbers[own.number].name == numbers[column.number].name && own.runs == column.runs
            };
            let own = from.setting.columns.iter().position(same);
            own.filter(|_| !numbers[column.number].is_hidden).map_or(0.0, |place| from.point.sizes[place])
        };
        let point = Point { sizes: setting.columns.iter().map(size).collect(), ..from.point.clone() };
        let scales = (from.scored.scales, from.scored.tau);
        self.add(set.clone(), point, scales, counts);
    }

    /// Refits what was predicted.
    fn refit(&mut self, set: Set, counts: &mut Counts) {
        let Some(Predicted { scored, parent }) = self.predicted.get(&set).cloned() else { return };
        let setting = self.bench().setting(&set);
        let from = &self.fitted[parent];
        let target = self.fitter.target(&setting, &from.point, &from.gram, &scored);
        if let Some(point) = target {
            self.add(set.clone(), point, (scored.scales, scored.tau), counts);
        }
        // once from there is enough
        self.predicted.remove(&set);
    }

    fn expand(&mut self, place: usize, counts: &mut Counts) {
        let Some(columns) = self.columns.remove(&place) else {
            self.fitted[place].is_expanded = true;
            return;
        };
        self.fitter.expand(&mut self.fitted[place], columns, true, counts);
        let found = self.neighbours(&self.fitted[place], place, true);
        for (set, predicted) in found {
            let known = self.predicted.get(&set);
            if known.is_none_or(|known| known.scored.ln_z < predicted.scored.ln_z) {
                self.predicted.insert(set, predicted);
            }
        }
        self.columns.retain(|&other, _| other != place);
    }

    /// Every set one move from `from`, scored; `free`: with the unknown wherever its evidence wants it.
    fn neighbours(&self, from: &Fitted, place: usize, free: bool) -> Vec<(Set, Predicted)> {
        let moves = self.moves(&from.setting.set).into_iter();
        let sets: Vec<Set> = moves.filter(|set| !self.impossible.contains(set)).collect();
        let atoms = &self.bench().atoms;
        let scorer = self.fitter.scorer(&from.gram);
        let at = from.scored.scales;
        let scored = |set: &Set| {
            let columns = columns(atoms, set);
            let taus = if has_deviations(&columns) { taus() } else { TAU_START..TAU_START + 1 };
            let mut best = scorer.score(set, &columns, OFF, taus.clone());
            if free && at != OFF {
                best = better(best, scorer.score(set, &columns, at, taus));
            }
            best
        };
        // what all scores share is worked out before they are made side by side
        let _ = (from.gram.reduced(at), from.gram.reduced(OFF));
        let scored: Vec<Option<Scored>> = sets.par_iter().map(scored).collect();
        let found = sets.into_iter().zip(scored);
        let mut found: Vec<(Set, Predicted)> = found
            .filter_map(|(set, scored)| Some((set, Predicted { scored: scored?, parent: place })))
            .collect();
        for (_, predicted) in &mut found {
            predicted.scored.ln_z -= from.shortfall;
        }
        for &gone in &from.setting.set {
            let amiss = self.amiss(&from.setting.set, gone, &found);
            let has =
                |set: &Set| set.iter().any(|&atom| atoms.list[atom].cause() == atoms.list[gone].cause());
            for (_, predicted) in found.iter_mut().filter(|(set, _)| !has(set)) {
                predicted.scored.ln_z -= amiss;
            }
        }
        found
    }

    /// By how much it is predicted too well how `set` is without `gone`, where that was fitted: a cause whose effect is not in proportion to its
    /// size is not linear as far as 0, and so all is predicted too well that lacks it.
    fn amiss(&self, set: &[usize], gone: usize, predicted: &[(Set, Predicted)]) -> f64 {
        let is_rest = |other: &Set| {
            other.len() + 1 == set.len()
                && !other.contains(&gone)
                && other.iter().all(|atom| set.contains(atom))
        };
        let fitted = self.fitted.iter().find(|fitted| is_rest(&fitted.setting.set));
        let rest = predicted.iter().find(|(other, _)| is_rest(other));
        fitted.zip(rest).map_or(0.0, |(fitted, (_, rest))| (rest.scored.ln_z - fitted.scored.ln_z).max(0.0))
    }

    /// Every set one move from `set`.
    fn moves(&self, set: &[usize]) -> BTreeSet<Set> {
        let atoms = &self.bench().atoms.list;
        let joined = |rest: &[usize], atom: usize| {
            let clashes = |&other: &usize| {
                atoms[other].term.cause == atoms[atom].term.cause || atoms[other].class == atoms[atom].class
            };
            let mut next = rest.to_vec();
            next.push(atom);
            next.sort_unstable();
            (!rest.iter().any(clashes)).then_some(next)
        };
        let mut all: BTreeSet<Set> = (0..atoms.len()).filter_map(|atom| joined(set, atom)).collect();
        for &gone in set {
            let rest: Set = set.iter().copied().filter(|&other| other != gone).collect();
            all.extend((0..atoms.len()).filter(|&atom| atom != gone).filter_map(|atom| joined(&rest, atom)));
            if matches!(atoms[gone].form, Form::CommonAndByRun | Form::ByRunOnly) {
                let forms = (0..atoms.len()).filter(|&form| {
                    atoms[form].is_placed_as(&atoms[gone])
                        && matches!(
                            atoms[form].form,
                            Form::All | Form::DropsOnly | Form::DropsByRun | Form::OneRun(_)
                        )
                });
                for split in forms.filter_map(|form| joined(&rest, form)) {
                    all.extend((0..atoms.len()).filter_map(|atom| joined(&split, atom)));
                }
            }
            all.insert(rest);
        }
        all
    }

    /// Scores once more what is a move from the best, from there.
    pub(super) fn about_best(&self) -> Vec<(Set, f64)> {
        let Some(best) = self.best() else { return Vec::new() };
        let list = self.neighbours(&self.fitted[best], best, true);
        list.into_iter().map(|(set, predicted)| (set, predicted.scored.ln_z)).collect()
    }
}
