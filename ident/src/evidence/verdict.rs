//! What the pool says: probabilities, sizes, and what nothing names.

use std::collections::BTreeMap;

use super::atoms::Atom;
use super::columns::Belief;
use super::priors::{FORCE_SCALES, OFF, SLIP_SCALES, ln_scales};
use super::search::Pool;

/// A cause is named from this probability on: 19 to 1.
const NAMED: f64 = 0.95;
/// A cause that is less probable than this is not spoken of.
const SPOKEN_OF: f64 = 0.05;
/// Beside something unexplained that gains U nats, a force is named only from this share of U on: measured (by a prototype, with a margin
/// of 1.5; to be measured anew).
const GAIN_SHARE: f64 = 0.25;
/// 95 % of a normal distribution lie within so many standard deviations.
const WITHIN_95: f64 = 1.959_964;

/// What is said of a cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
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
pub struct Size {
    /// As in the model.
    pub name: String,
    /// The runs, by their order among the fitted ones, where it is not all.
    pub runs: Vec<usize>,
    /// Mean, SI.
    pub value: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
}

/// A cause that is spoken of.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundCause {
    /// Its name.
    pub name: String,
    /// Name, element and form.
    pub label: String,
    /// The element that it sits in, if it is one.
    pub element: Option<String>,
    /// Name shared with those that no video tells from it.
    pub class: String,
    /// What is said of it.
    pub standing: Standing,
    /// Probability of it, or of one that no video tells from it.
    pub probability: f64,
    /// By how many nats the best set is better than the best without it.
    pub gain: f64,
    /// Its numbers, over all sets that hold it in this form.
    pub sizes: Vec<Size>,
}

/// What the runs say.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// Causes, most probable first.
    pub causes: Vec<FoundCause>,
    /// Gain of everything that nobody names: the unknown, and forces by run only \[nats\].
    pub unnamed: f64,
    /// Scales of the unknown in the best set: repeatable force, force of each run's own, both in units of what moves keypoints by their noise;
    /// slip, over the noise.
    pub unknown: [f64; 3],
    /// The best set in words, and the logarithm of its evidence over that of none with no unknown.
    pub best: String,
    /// See there.
    pub ln_odds: f64,
    /// Probability of what was scored but not refitted.
    pub unfitted: f64,
    /// Noise over that of the floor.
    pub noise: f64,
    /// Whether the search came to its end.
    pub complete: bool,
    /// Sets fitted.
    pub fits: usize,
    /// Runs simulated; several that share a pass count each.
    pub rollouts: u64,
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
    if std::env::var("RIG_DEBUG").is_ok() {
        let mut l: Vec<_> = linear.iter().collect();
        l.sort_by(|a, b| b.1.total_cmp(&a.1));
        for (set, z) in l.iter().take(25) { eprintln!("  lin {:8.2} {}", z - most, pool.label(set)); }
        for (set, z) in l.iter().filter(|(s, _)| pool.label(s).contains("stiffness/q4")).take(5) { eprintln!("  lin {:8.2} {}", z - most, pool.label(set)); }
        for f in &pool.fitted { eprintln!("  fit {:8.2} {:?} free {} {}", f.scored.ln_z - most, f.scored.scales, f.is_free, pool.label(&f.setting.set)); }
    }
    let is_fitted = |set: &[usize]| pool.fitted.iter().any(|fitted| fitted.setting.set == set);
    // what is only predicted is never above what was fitted: predictions rank, refits decide
    sets.extend(linear.iter().filter(|(set, _)| !is_fitted(set)).map(|(set, z)| (&set[..], z.min(most))));
    let weights: Vec<f64> = sets.iter().map(|(_, z)| (z - most).exp()).collect();
    let all: f64 = weights.iter().sum();
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
        // in the form that is most probable
        let mut forms: BTreeMap<String, (f64, usize)> = BTreeMap::new();
        for ((set, _), weight) in sets.iter().zip(&weights).take(fitted) {
            for &atom in set.iter().filter(|atom| is(atom)) {
                forms.entry(atoms[atom].label()).or_insert((0.0, atom)).0 += weight;
            }
        }
        let chosen = forms.iter().max_by(|a, b| a.1.0.total_cmp(&b.1.0));
        let Some((label, &(_, atom))) = chosen else { continue };
        let gain = gain(&is);
        let standing = match probability {
            _ if !is_named => Standing::Resembles,
            p if p < NAMED => Standing::Possible,
            _ if atoms[atom].each_run && !is_wave_named => Standing::Suspected,
            _ if atoms[atom].is_force && gain < GAIN_SHARE * unnamed => Standing::Suspected,
            _ => Standing::Named,
        };
        causes.push(FoundCause {
            name: atoms[atom].cause().to_owned(),
            label: label.clone(),
            element: atoms[atom].term.element().map(str::to_owned),
            class,
            standing,
            probability,
            gain,
            sizes: sizes(pool, label),
        });
    }
    causes.sort_by(|a, b| b.probability.total_cmp(&a.probability).then(a.label.cmp(&b.label)));
    let none = pool.fitted.iter().find(|fitted| fitted.setting.set.is_empty());
    let [repeatable, own, slip] = best.scored.scales;
    Some(Evidence {
        causes,
        unnamed,
        unknown: [FORCE_SCALES[repeatable], FORCE_SCALES[own], SLIP_SCALES[slip]],
        best: pool.label(&best.setting.set),
        ln_odds: most - none.map_or(most, |none| none.scored.ln_z),
        unfitted: weights[fitted..].iter().sum::<f64>() / all,
        noise: best.scored.variance.sqrt(),
        complete,
        fits: pool.fits,
        rollouts: 0,
    })
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
    Some((best.scored.ln_z - bare.ln_z - chance).max(0.0))
}

/// The numbers of the atoms called `label`, over all fitted sets that hold one.
fn sizes(pool: &Pool<'_, '_>, label: &str) -> Vec<Size> {
    let atoms = &pool.fitter.bench.atoms;
    let holds = |set: &[usize]| set.iter().any(|&atom| atoms.list[atom].label() == label);
    let most =
        pool.fitted.iter().filter(|fitted| holds(&fitted.setting.set)).map(|fitted| fitted.scored.ln_z);
    let most = most.fold(f64::NEG_INFINITY, f64::max);
    let mut sums: BTreeMap<(String, Vec<usize>), [f64; 3]> = BTreeMap::new();
    for fitted in pool.fitted.iter().filter(|fitted| holds(&fitted.setting.set)) {
        let weight = (fitted.scored.ln_z - most).exp();
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
            let runs =
                if column.runs.len() == pool.fitter.bench.runs() { Vec::new() } else { column.runs.clone() };
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
