//! What the pool says: probabilities, sizes, and what nothing names.

use std::collections::BTreeMap;

use super::Form;
use super::atoms::Atom;
use super::fit::Fitted;
use super::priors::{FORCE_SCALES, OFF, SLIP_SCALES, ln_scales};
use super::search::Pool;
use crate::hypothesis::candidates::Term;

/// A cause is named from this probability on: 19 to 1.
const NAMED: f64 = 0.95;
/// A cause that is less probable than this is not spoken of.
const SPOKEN_OF: f64 = 0.05;
/// Beside something unexplained that gains U nats, a force is named only from this share of U on: measured (by a prototype, with a margin
/// of 1.5; to be measured anew).
const GAIN_SHARE: f64 = 0.25;

/// What is said of a cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Standing {
    /// It is at work.
    Named,
    /// It may be: another set says otherwise with some probability.
    Possible,
    /// It would be named, were it not for something that nobody explains and that it may stand in for.
    Suspected,
    /// Something differs from run to run and resembles it.
    Resembles,
}

/// A number of a cause.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Size {
    /// As in the model.
    pub(crate) name: String,
    /// The runs, by their order among the fitted ones, where it is not all.
    pub(crate) runs: Vec<usize>,
    /// Mean, SI.
    pub(crate) value: f64,
    /// 95 % interval.
    pub(crate) ci95: [f64; 2],
}

/// A cause that is spoken of.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FoundCause {
    /// It, in its most probable element and form.
    pub(crate) term: Term,
    pub(crate) form: Form,
    /// The element that it sits in, where it is one beyond reasonable doubt.
    pub(crate) element: Option<String>,
    /// All elements that it may as well sit in, the most probable first, where that is in doubt.
    pub(crate) elsewhere: Vec<String>,
    /// Name shared with those that no video tells from it.
    pub(crate) class: String,
    /// What is said of it.
    pub(crate) standing: Standing,
    /// Probability of it, or of one that no video tells from it.
    pub(crate) probability: f64,
    /// By how many nats the best set is better than the best without it.
    pub(crate) gain: f64,
    /// Cause, element and form.
    pub(crate) label: String,
    /// Its numbers, over the likely sets that hold it so; filled in where the fitted runs are known (`described`).
    pub(crate) sizes: Vec<Size>,
}

/// What the runs say.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Evidence {
    /// Causes, most probable first.
    pub(crate) causes: Vec<FoundCause>,
    /// Probability that something is at work that nobody names: the unknown, or a force by run only.
    pub(crate) unexplained: f64,
    /// Gain of everything that nobody names: the unknown, and forces by run only \[nats\].
    pub(crate) unnamed: f64,
    /// Scales of the unknown in the best set: repeatable force, force of each run's own, both in units of what moves keypoints by their noise;
    /// slip, over the noise.
    pub(crate) unknown: [f64; 3],
    /// Sets of causes, as labels, with their probabilities and what each gains over none \[nats\], the best first.
    pub(crate) sets: Vec<LikelySet>,
    /// Probability of what was scored but not refitted.
    pub(crate) unfitted: f64,
    /// Whether the search came to its end.
    pub(crate) complete: bool,
}

/// A set of causes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LikelySet {
    pub(crate) labels: Vec<String>,
    pub(crate) probability: f64,
    pub(crate) gain: f64,
}

impl Evidence {
    /// Whether what is named, and noise, may be all that there is.
    pub(crate) fn is_explained(&self) -> bool {
        self.unexplained < NAMED
    }
}

/// Sums up `pool`.
pub(super) fn verdict(pool: &Pool<'_, '_>, complete: bool) -> Option<Evidence> {
    let atoms = &pool.fitter.bench.atoms.list;
    let best = &pool.fitted[pool.best()?];
    let most = best.scored.ln_z;
    let mut sets: Vec<(&[usize], f64)> =
        pool.fitted.iter().map(|fitted| (&fitted.setting.set[..], fitted.scored.ln_z)).collect();
    let fitted = sets.len();
    let linear = pool.about_best();
    let is_fitted = |set: &[usize]| pool.fitted.iter().any(|fitted| fitted.setting.set == set);
    // what is only predicted is never above what was fitted: predictions rank, refits decide. Where the search was ended before these, whatever
    // is predicted above holds may as well not be
    let predicted = linear.iter().filter(|(set, _)| !is_fitted(set));
    let (above, below): (Vec<_>, Vec<_>) = predicted.partition(|(_, z)| !complete && *z > most);
    sets.extend(below.iter().map(|(set, z)| (&set[..], z.min(most))));
    let untried = above.len() as f64;
    let weights: Vec<f64> = sets.iter().map(|(_, z)| (z - most).exp()).collect();
    let all = weights.iter().sum::<f64>() + untried;
    let share = |holds: &dyn Fn(&[usize]) -> bool| {
        let own = sets.iter().zip(&weights).filter(|((set, _), _)| holds(set));
        own.map(|(_, weight)| weight).sum::<f64>() / all
    };
    // free numbers in each run soak up what nobody knows: what has them by nature counts as unnamed until it has gained enough itself
    let with_waves = unnamed(pool, |atom| !atom.each_run)?;
    let gain = |is: &dyn Fn(&usize) -> bool| {
        let without = sets.iter().filter(|(set, _)| !set.iter().any(is));
        most - without.map(|(_, z)| *z).fold(f64::NEG_INFINITY, f64::max)
    };
    let is_wave_named = gain(&|&atom: &usize| atoms[atom].each_run) >= GAIN_SHARE * with_waves;
    let unnamed = if is_wave_named { unnamed(pool, |_| true)? } else { with_waves };
    // of a set that keeps the unknown, what it is without
    let quiet = |fitted: &Fitted| {
        if fitted.scored.scales == OFF {
            return 0.0;
        }
        let taus = fitted.scored.tau..fitted.scored.tau + 1;
        let Fitted { setting, gram, .. } = fitted;
        let off = pool.fitter.scorer(gram).score(&setting.set, &setting.columns, OFF, taus);
        off.map_or(0.0, |off| (off.ln_z - fitted.shortfall - most).exp())
    };
    let resembles = |set: &[usize]| set.iter().any(|&atom| !atoms[atom].is_named());
    let (mut open, mut total) = (0.0, 0.0);
    for (fitted, weight) in pool.fitted.iter().zip(&weights) {
        let quiet = quiet(fitted);
        total += weight + quiet;
        open += match (resembles(&fitted.setting.set), fitted.scored.scales == OFF) {
            (true, _) => weight + quiet,
            (false, false) => *weight,
            (false, true) => 0.0,
        };
    }
    let mut causes = Vec::new();
    let mut classes: Vec<(String, bool)> = sets
        .iter()
        .zip(&weights)
        .filter(|(_, weight)| **weight > SPOKEN_OF * all / sets.len() as f64)
        .flat_map(|((set, _), _)| set.iter().map(|&atom| (atoms[atom].class.clone(), atoms[atom].is_named())))
        .collect();
    classes.sort();
    classes.dedup();
    for (class, is_named) in classes {
        let is = |atom: &usize| atoms[*atom].class == class && atoms[*atom].is_named() == is_named;
        let probability = share(&|set| set.iter().any(is));
        if probability < SPOKEN_OF {
            continue;
        }
        let held = sets.iter().zip(&weights).take(fitted).flat_map(|((set, _), weight)| {
            set.iter().filter(|atom| is(atom)).map(move |&atom| (atom, *weight))
        });
        let places = shares(held.clone().map(|(atom, weight)| (atoms[atom].place(), atom, weight)));
        let Some(((place, _), place_share)) = places.first() else { continue };
        let forms = held.filter(|(atom, _)| atoms[*atom].place() == *place);
        let forms = shares(forms.map(|(atom, weight)| (atoms[atom].label(), atom, weight)));
        let Some(((label, atom), _)) = forms.first() else { continue };
        let (label, atom) = (label.clone(), *atom);
        let is_placed = *place_share >= NAMED;
        let likely = places.iter().filter(|(_, share)| *share >= SPOKEN_OF);
        let gain = gain(&is);
        let standing = match probability {
            _ if !is_named => Standing::Resembles,
            p if p < NAMED => Standing::Possible,
            _ if atoms[atom].each_run && !is_wave_named => Standing::Suspected,
            _ if atoms[atom].is_force && gain < GAIN_SHARE * unnamed => Standing::Suspected,
            _ => Standing::Named,
        };
        causes.push(FoundCause {
            term: atoms[atom].term.clone(),
            form: atoms[atom].form,
            element: atoms[atom].term.element().filter(|_| is_placed).map(str::to_owned),
            elsewhere: likely.filter(|_| !is_placed).map(|((place, _), _)| place.clone()).collect(),
            class,
            standing,
            probability,
            gain,
            sizes: Vec::new(),
            label,
        });
    }
    causes.sort_by(|a, b| b.probability.total_cmp(&a.probability).then(a.class.cmp(&b.class)));
    let [repeatable, own, slip] = best.scored.scales;
    Some(Evidence {
        causes,
        unexplained: open / total,
        unnamed,
        unknown: [FORCE_SCALES[repeatable], FORCE_SCALES[own], SLIP_SCALES[slip]],
        sets: likely_sets(pool, &weights[..fitted], all),
        unfitted: (weights[fitted..].iter().sum::<f64>() + untried) / all,
        complete,
    })
}

/// Sums of weights by key, as shares of all, the largest first; each key with the first that has it of its largest weight.
fn shares(list: impl Iterator<Item = (String, usize, f64)>) -> Vec<((String, usize), f64)> {
    let mut sums: BTreeMap<String, (usize, f64, f64)> = BTreeMap::new();
    for (key, atom, weight) in list {
        let sum = sums.entry(key).or_insert((atom, weight, 0.0));
        if weight > sum.1 {
            (sum.0, sum.1) = (atom, weight);
        }
        sum.2 += weight;
    }
    let all: f64 = sums.values().map(|(.., sum)| sum).sum();
    let mut list: Vec<_> = sums
        .into_iter()
        .map(|(key, (atom, _, sum))| ((key, atom), sum / all.max(f64::MIN_POSITIVE)))
        .collect();
    list.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    list
}

/// The fitted sets, whose `weights` are a share of `all`.
fn likely_sets(pool: &Pool<'_, '_>, weights: &[f64], all: f64) -> Vec<LikelySet> {
    let atoms = &pool.fitter.bench.atoms.list;
    let none = pool.fitted.iter().find(|fitted| fitted.setting.set.is_empty());
    let mut list: Vec<LikelySet> = pool
        .fitted
        .iter()
        .zip(weights)
        .map(|(fitted, weight)| LikelySet {
            labels: fitted.setting.set.iter().map(|&atom| atoms[atom].place()).collect(),
            probability: weight / all,
            gain: none.map_or(0.0, |none| fitted.scored.ln_z - none.scored.ln_z),
        })
        .collect();
    list.sort_by(|a, b| b.probability.total_cmp(&a.probability).then(a.labels.cmp(&b.labels)));
    list
}

/// What everything that nobody names gains in the best set, as far as all is linear \[nats\]: the unknown, forces by run only, and what `spares`
/// does not spare.
fn unnamed(pool: &Pool<'_, '_>, spares: impl Fn(&Atom) -> bool) -> Option<f64> {
    let atoms = &pool.fitter.bench.atoms;
    let best = &pool.fitted[pool.best()?];
    let set = &best.setting.set;
    let counts = |&atom: &usize| atoms.list[atom].is_named() && spares(&atoms.list[atom]);
    let named: Vec<usize> = set.iter().copied().filter(counts).collect();
    if named == *set && best.scored.scales == OFF {
        return Some(0.0);
    }
    let columns = super::columns::columns(atoms, &named);
    let taus = best.scored.tau..best.scored.tau + 1;
    let bare = pool.fitter.scorer(&best.gram).score(&named, &columns, OFF, taus)?;
    // the chance of the scales is no gain
    let chance = ln_scales(best.scored.scales) - ln_scales(OFF);
    Some((best.scored.ln_z - (bare.ln_z - best.shortfall) - chance).max(0.0))
}
