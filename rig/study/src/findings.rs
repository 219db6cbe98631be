//! What a study's numbers say together.

use std::collections::BTreeMap;

use ground::random_effects::{Measured, holm, random_effects, same_in_groups, trend};
use ground::statistics::{chi2_survival, median};
use report::{CommonNumber, Disagreement, FollowedTrend, Sameness, Shift, Twins};

use crate::inputs::Conditions;
use crate::results::{Number, Quantity, TaskResult};
use crate::task::Task;

/// Rarer than this is no chance.
const SIGNIFICANT_P: f64 = 0.05;
/// Draws that a bootstrap needs before its scatter stands for a fit's own standard deviation (Efron and Tibshirani, 6.4: 25 tell already).
const LEAST_DRAWS: usize = 25;
/// All pairs are compared of so many experiments; of more, each is compared with its neighbours in the list that far. Chosen: it bounds the time.
const MOST_COMPARED: usize = 200;
/// Two variations are said to differ in a number where it moves by more standard deviations (chosen).
const SHIFT_SIGMAS: f64 = 2.0;
const SECONDS_PER_DAY: f64 = 86_400.0;

/// Numbers as they come in, task by task.
#[derive(Debug, Default)]
pub(crate) struct Gathered {
    /// By variation and number, each in the order in which they came: what each experiment says.
    numbers: BTreeMap<(usize, usize), BTreeMap<usize, Said>>,
    names: Vec<(String, String)>,
    places: BTreeMap<String, usize>,
    twins: BTreeMap<(usize, Vec<String>), usize>,
    fits: BTreeMap<usize, usize>,
}

/// What one experiment says of a number.
#[derive(Debug, Default)]
struct Said {
    /// The fit's loss, what it says, and whether the data determine that: the best of several seeds.
    best: Option<(f64, Measured, bool)>,
    /// What draws of a bootstrap say.
    draws: Vec<f64>,
}

impl Said {
    /// Value and standard deviation, where the data determine it.
    fn measured(&self) -> Option<Measured> {
        let (_, best, is_determined) = self.best?;
        let std = if self.draws.len() >= LEAST_DRAWS { scatter(&self.draws) } else { best.std };
        let is_usable = is_determined && std.is_finite() && std > 0.0 && best.value.is_finite();
        is_usable.then_some(Measured { value: best.value, std })
    }
}

/// Sample standard deviation.
fn scatter(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt()
}

impl Gathered {
    /// Takes in the result of a task of the experiment and variation of these places.
    pub(crate) fn add(&mut self, subject: usize, variation: usize, task: &Task, result: &TaskResult) {
        let is_draw = task.resample.is_some();
        let loss =
            result.numbers.iter().find(|number| number.quantity == Quantity::Fit && number.name == "loss");
        let loss = loss.map_or(0.0, |number| number.value);
        if !is_draw {
            *self.fits.entry(variation).or_default() += 1;
            for group in &result.unidentifiable {
                *self.twins.entry((variation, group.clone())).or_default() += 1;
            }
        }
        let about = |number: &&Number| matches!(number.quantity, Quantity::Parameter | Quantity::Cause);
        for number in result.numbers.iter().filter(about) {
            let place = self.place(number);
            let said = self.numbers.entry((variation, place)).or_default().entry(subject).or_default();
            if is_draw {
                said.draws.push(number.value);
                continue;
            }
            let is_free = number.determined.unwrap_or(true) && !number.at_bound.unwrap_or(false);
            let measured = Measured { value: number.value, std: number.std.unwrap_or(f64::NAN) };
            if said.best.is_none_or(|(best, ..)| loss < best) {
                said.best = Some((loss, measured, is_free));
            }
        }
    }

    fn place(&mut self, number: &Number) -> usize {
        if let Some(&place) = self.places.get(&number.name) {
            return place;
        }
        self.names.push((number.name.clone(), number.unit.clone()));
        self.places.insert(number.name.clone(), self.names.len() - 1);
        self.names.len() - 1
    }

    /// Each number over all experiments, variation by variation.
    pub(crate) fn common(&self, subjects: &[String], variations: &[String]) -> Vec<CommonNumber> {
        let mut all: Vec<CommonNumber> = Vec::new();
        for (variation, title) in variations.iter().enumerate() {
            let first = all.len();
            for ((_, name), said) in self.numbers.range((variation, 0)..(variation + 1, 0)) {
                let (name, unit) = self.names[*name].clone();
                let each: Vec<(usize, Measured)> =
                    said.iter().filter_map(|(&subject, said)| Some((subject, said.measured()?))).collect();
                let measured: Vec<Measured> = each.iter().map(|(_, measured)| *measured).collect();
                let found = random_effects(&measured);
                let root = |tau2: f64| tau2.is_finite().then(|| tau2.sqrt());
                all.push(CommonNumber {
                    variation: title.clone(),
                    name,
                    unit,
                    count: each.len(),
                    left_out: said.len() - each.len(),
                    mean: found.map(|found| found.mean),
                    mean_ci95: found.map(|found| found.mean_ci95),
                    tau: found.map(|found| found.tau2.sqrt()),
                    tau_ci95: found.map(|found| (found.tau2_ci95[0].sqrt(), root(found.tau2_ci95[1]))),
                    i2: found.map(|found| found.i2),
                    p_same: found.map(|found| found.p_same),
                    says: Sameness::Open,
                    each: each
                        .into_iter()
                        .map(|(subject, measured)| (subjects[subject].clone(), measured.value, measured.std))
                        .collect(),
                });
            }
            let mut tested: Vec<&mut CommonNumber> =
                all[first..].iter_mut().filter(|number| number.p_same.is_some()).collect();
            let adjusted = holm(&tested.iter().filter_map(|number| number.p_same).collect::<Vec<_>>());
            for (number, p) in tested.iter_mut().zip(adjusted) {
                number.p_same = Some(p);
                number.says = if p < SIGNIFICANT_P { Sameness::Differs } else { Sameness::Same };
            }
        }
        all
    }

    /// What numbers follow, and how many such trends there might have been.
    pub(crate) fn trends(
        &self,
        conditions: &[&Conditions],
        variations: &[String],
    ) -> (Vec<FollowedTrend>, usize) {
        let mut all = Vec::new();
        for (&(variation, name), said) in &self.numbers {
            let (name, unit) = &self.names[name];
            let of = |follows: &str, slope: Option<(f64, [f64; 2])>, per: &str, p: f64| FollowedTrend {
                variation: variations[variation].clone(),
                name: name.clone(),
                follows: follows.into(),
                slope: slope.map(|(slope, _)| slope),
                slope_ci95: slope.map(|(_, ci95)| ci95),
                unit: if per.is_empty() { String::new() } else { format!("{unit} per {per}") },
                p,
            };
            let mut over = |follows: &str, per: &str, number: fn(&Conditions) -> Option<f64>| {
                let (measured, x) = beside(said, conditions, number);
                if let Some(found) = trend(&measured, &x) {
                    all.push(of(follows, Some((found.slope, found.slope_ci95)), per, found.p));
                }
            };
            over("time", "day", days);
            over("temperature", "°C", |conditions| conditions.temperature_c);
            let mut between = |follows: &str, group: fn(&Conditions) -> Option<&str>| {
                let (measured, group) = beside(said, conditions, group);
                if let Some(p) = same_in_groups(&measured, &group) {
                    all.push(of(follows, None, "", p));
                }
            };
            between("tank", |conditions| conditions.tank.as_deref());
            between("mechanism", |conditions| conditions.mechanism.as_deref());
        }
        let sought = all.len();
        let adjusted = holm(&all.iter().map(|trend| trend.p).collect::<Vec<_>>());
        all.iter_mut().zip(adjusted).for_each(|(trend, p)| trend.p = p);
        all.retain(|trend| trend.p < SIGNIFICANT_P);
        all.sort_by(|a, b| a.p.total_cmp(&b.p));
        (all, sought)
    }

    /// Pairs of experiments that disagree on a number, the farthest first, and how many were compared.
    pub(crate) fn disagreements(
        &self,
        subjects: &[String],
        variations: &[String],
    ) -> (Vec<Disagreement>, usize) {
        let mut all = Vec::new();
        let mut compared = 0;
        let mut least_p = Vec::new();
        for (&(variation, name), said) in &self.numbers {
            let each: Vec<(usize, Measured)> =
                said.iter().filter_map(|(&subject, said)| Some((subject, said.measured()?))).collect();
            for (place, (one, a)) in each.iter().enumerate() {
                for (other, b) in each[place + 1..].iter().take(MOST_COMPARED) {
                    compared += 1;
                    let sigmas = (a.value - b.value).abs() / a.std.hypot(b.std);
                    let p = chi2_survival(sigmas * sigmas, 1.0);
                    if p >= SIGNIFICANT_P {
                        continue;
                    }
                    least_p.push(p);
                    all.push(Disagreement {
                        variation: variations[variation].clone(),
                        name: self.names[name].0.clone(),
                        experiments: [*one, *other].map(|subject| subjects[subject].clone()),
                        values: [a.value, b.value],
                        stds: [a.std, b.std],
                        sigmas,
                        p,
                    });
                }
            }
        }
        // Holm's steps over all that were compared: those left out above have a p that no step would let through
        least_p.resize(compared, 1.0);
        let adjusted = holm(&least_p);
        all.iter_mut().zip(adjusted).for_each(|(pair, p)| pair.p = p);
        all.retain(|pair| pair.p < SIGNIFICANT_P);
        all.sort_by(|a, b| b.sigmas.total_cmp(&a.sigmas));
        (all, compared)
    }

    /// Numbers that two variations say otherwise of the same experiments, the farthest first.
    pub(crate) fn shifts(&self, variations: &[String]) -> Vec<Shift> {
        let mut all = Vec::new();
        for a in 0..variations.len() {
            for b in a + 1..variations.len() {
                for ((_, name), said) in self.numbers.range((a, 0)..(a + 1, 0)) {
                    let Some(other) = self.numbers.get(&(b, *name)) else { continue };
                    let apart = |(subject, said): (&usize, &Said)| {
                        let (one, other) = (said.measured()?, other.get(subject)?.measured()?);
                        Some((other.value - one.value).abs() / one.std.max(other.std))
                    };
                    let mut sigmas: Vec<f64> = said.iter().filter_map(apart).collect();
                    let count = sigmas.len();
                    if let Some(median_sigmas) =
                        median(&mut sigmas, f64::total_cmp).filter(|it| *it > SHIFT_SIGMAS)
                    {
                        let variations = [a, b].map(|place| variations[place].clone());
                        all.push(Shift {
                            variations,
                            name: self.names[*name].0.clone(),
                            count,
                            median_sigmas,
                        });
                    }
                }
            }
        }
        all.sort_by(|a, b| b.median_sigmas.total_cmp(&a.median_sigmas));
        all
    }

    /// Groups of coefficients of which only a combination is seen, the most frequent first.
    pub(crate) fn twins(&self, variations: &[String]) -> Vec<Twins> {
        let of = |((variation, names), &count): (&(usize, Vec<String>), &usize)| Twins {
            variation: variations[*variation].clone(),
            names: names.clone(),
            count,
            of: self.fits.get(variation).copied().unwrap_or_default(),
        };
        let mut all: Vec<Twins> = self.twins.iter().map(of).collect();
        all.sort_by_key(|group| std::cmp::Reverse(group.count));
        all
    }
}

/// When an experiment began, in days since 1970.
fn days(conditions: &Conditions) -> Option<f64> {
    let began: jiff::Timestamp = conditions.began_utc.as_ref()?.parse().ok()?;
    Some(began.as_second() as f64 / SECONDS_PER_DAY)
}

/// What experiments say, beside what is `known` of them, where both are there.
fn beside<'c, T>(
    said: &BTreeMap<usize, Said>,
    conditions: &[&'c Conditions],
    known: impl Fn(&'c Conditions) -> Option<T>,
) -> (Vec<Measured>, Vec<T>) {
    said.iter().filter_map(|(&subject, said)| Some((said.measured()?, known(conditions[subject])?))).unzip()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::example;

    fn result(value: f64, std: f64) -> TaskResult {
        let number = Number {
            quantity: Quantity::Parameter,
            name: "g1/blunt".into(),
            unit: "1".into(),
            value,
            std: Some(std),
            ci95: None,
            determined: Some(true),
            at_bound: Some(false),
        };
        TaskResult {
            task: String::new(),
            numbers: vec![number],
            unidentifiable: vec![vec!["g1/blunt".into(), "g1/slender".into()]],
            verdict: None,
            fit: None,
            diagnosis: None,
        }
    }

    fn gathered(values: &[f64]) -> (Gathered, Vec<String>) {
        let mut gathered = Gathered::default();
        for (subject, &value) in values.iter().enumerate() {
            gathered.add(subject, 0, &example(), &result(value, 0.1));
        }
        (gathered, (0..values.len()).map(|subject| format!("run-{subject}")).collect())
    }

    #[test]
    fn a_coefficient_that_drifts_differs_and_follows_the_time_and_its_ends_disagree() {
        let variations = ["as it is".to_owned()];
        let (found, subjects) = gathered(&[1.0, 1.5, 2.0, 2.5, 3.0]);
        let common = found.common(&subjects, &variations);
        assert_eq!((common[0].says, common[0].count), (Sameness::Differs, 5), "{common:?}");
        assert!((common[0].mean.unwrap() - 2.0).abs() < 1e-9);
        let conditions: Vec<Conditions> = (1..=5)
            .map(|day| Conditions {
                began_utc: Some(format!("2026-11-0{day}T08:00:00Z")),
                ..Conditions::default()
            })
            .collect();
        let conditions: Vec<&Conditions> = conditions.iter().collect();
        let (trends, sought) = found.trends(&conditions, &variations);
        assert_eq!((trends.len(), sought, trends[0].follows.as_str()), (1, 1, "time"));
        assert!((trends[0].slope.unwrap() - 0.5).abs() < 1e-9 && trends[0].unit == "1 per day");
        let (pairs, compared) = found.disagreements(&subjects, &variations);
        assert_eq!((compared, pairs[0].experiments.clone()), (10, ["run-0", "run-4"].map(str::to_owned)));
        assert_eq!(found.twins(&variations)[0].count, 5);
    }

    #[test]
    fn one_number_everywhere_is_the_same_and_nobody_disagrees() {
        let variations = ["as it is".to_owned()];
        let (found, subjects) = gathered(&[1.0, 1.05, 0.93, 1.08]);
        assert_eq!(found.common(&subjects, &variations)[0].says, Sameness::Same);
        assert!(found.disagreements(&subjects, &variations).0.is_empty());
    }

    #[test]
    fn draws_of_a_bootstrap_stand_for_the_fit_s_own_deviation_and_models_are_compared() {
        let variations = ["one".to_owned(), "other".to_owned()];
        let (mut found, subjects) = gathered(&[1.0, 1.0]);
        let draw = Task { resample: Some(crate::resample::tests::draw(1)), ..example() };
        for number in 0..50 {
            found.add(0, 0, &draw, &result(if number % 2 == 0 { 0.0 } else { 2.0 }, 0.1));
        }
        let std = found.common(&subjects, &variations)[0].each[0].2;
        assert!((std - (50.0 / 49.0_f64).sqrt()).abs() < 1e-9, "{std}");
        assert!(found.shifts(&variations).is_empty());
        for subject in 0..2 {
            found.add(subject, 1, &example(), &result(9.0, 0.1));
        }
        let shifts = found.shifts(&variations);
        assert_eq!((shifts[0].count, shifts[0].name.as_str()), (2, "g1/blunt"));
    }
}
