//! The verdict: what is named, what is not, and why, as `diagnosis.json` has it.

use sim::Cause;

use super::bent::bent;
use super::constancy::constancy;
use super::goodness::goodness_of_fit;
use super::remarks::{fitted_in_part, held_in_drops, seen_from_above};
use super::residuals::{remainder, residuals};
use super::result::{
    Alternative, CauseParameter, ConstancyTest, Diagnosis, NamedCause, NoiseFloor, PerRun, Remainder,
    Unknown, Verdict, Whiteness,
};
use super::unknown_force::unknown_force;
use super::{detect, gain, heldout, words};
use crate::evidence::{Form, Found, FoundCause, Standing};
use crate::experiment::{Experiment, Spike};
use crate::fit::counts::Counts;
use crate::hypothesis::candidates::{self, possible};
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;

/// Where no set of causes is named, but none at all is less probable than this, the sets are told.
const NONE_IS_LEFT: f64 = 0.05;
/// Sets of causes that are told, the best first, and how probable they are at least.
const MOST_SETS: usize = 5;
const TOLD_SET: f64 = 0.05;

/// Puts together what was found of the runs beside `baseline`; `fitted`: causes that are no candidates.
pub(super) fn verdict(
    experiment: &Experiment,
    fitted: &[Cause],
    baseline: &State<'_>,
    found: &Found<'_>,
    floor: &Floor,
    counts: &mut Counts,
) -> Diagnosis {
    let evidence = &found.evidence;
    let is_named = |cause: &&FoundCause| cause.standing == Standing::Named;
    let names_any = evidence.causes.iter().any(|cause| is_named(&cause));
    let none = evidence.sets.iter().find(|set| set.labels.is_empty()).map_or(0.0, |set| set.probability);
    let is_open = !names_any && !found.leader.causes.is_empty() && none < NONE_IS_LEFT;
    // a search that was ended before it found anything has not seen that there is nothing
    let untried = !evidence.complete && !names_any;
    let described = if names_any { &found.named } else { &found.leader };
    let mut more = counts.apart();
    let (held, gained) = match described.causes.is_empty() {
        true => (heldout::goodness_of_fit(experiment, described, floor, counts), None),
        false => rayon::join(
            || heldout::goodness_of_fit(experiment, described, floor, counts),
            || gain::gain(experiment, baseline, described, floor, &mut more),
        ),
    };
    counts.add(&more);
    let checked = gained.as_ref().is_some_and(|gained| gained.gain > 0.0);
    let verdict = match evidence.causes.iter().filter(is_named).count() {
        _ if !evidence.is_explained() || untried => Verdict::Unexplained,
        0 if is_open => Verdict::Ambiguous,
        0 => Verdict::NothingDetectable,
        _ if !checked => Verdict::Suspected,
        1 => Verdict::Cause,
        _ => Verdict::Causes,
    };
    let is_silent = verdict == Verdict::NothingDetectable;
    let after = if is_silent { baseline } else { described };
    let tests = constancy(after, baseline.parameters.len());
    let list = |is_told: &dyn Fn(&FoundCause) -> bool| -> Vec<NamedCause> {
        let told = evidence.causes.iter().filter(|cause| is_told(cause));
        told.map(|cause| named(cause, experiment, &found.run_ids, &tests)).collect()
    };
    let known = list(&|cause| cause.standing == Standing::Named);
    // the best set, as far as it is not named
    let is_leading = |cause: &FoundCause| {
        found.leader.causes.iter().any(|term| term.cause == cause.term.cause)
            && cause.standing != Standing::Named
    };
    let (causes, partial, established) = match verdict {
        Verdict::NothingDetectable => (Vec::new(), Vec::new(), Vec::new()),
        // what no other run confirms is no more than a description
        Verdict::Unexplained if !checked => (Vec::new(), [known, list(&is_leading)].concat(), Vec::new()),
        Verdict::Unexplained => (Vec::new(), list(&is_leading), known),
        Verdict::Ambiguous => (list(&is_leading), Vec::new(), Vec::new()),
        _ => (known, Vec::new(), Vec::new()),
    };
    let alternatives = if verdict == Verdict::Ambiguous { alternatives(found) } else { Vec::new() };
    let sentence = words::sentence(verdict, &causes, &alternatives, &established, &evidence.causes);
    let mut remarks = words::doubts(verdict, &evidence.causes, gained.as_ref());
    if evidence.is_explained() && evidence.unexplained > TOLD_SET {
        remarks.push(format!(
            "perhaps something is at work that nothing explains: {:.0} % probable",
            100.0 * evidence.unexplained
        ));
    }
    if untried && found.leader.causes.is_empty() {
        remarks.push("there was no time to search for causes".into());
    }
    if !is_silent {
        remarks.extend(fitted_in_part(experiment, &baseline.parameters));
        remarks.extend(held_in_drops(baseline));
    }
    remarks.extend(seen_from_above(experiment));
    remarks.extend(experiment.runs.iter().flat_map(|run| run.lost.iter().map(|lost| lost.sentence(&run.id))));
    remarks.extend(experiment.runs.iter().filter_map(|run| Spike::sentence(&run.id, &run.set_aside)));
    let candidates = possible(experiment, fitted);
    let remainder = (verdict == Verdict::Unexplained).then(|| Remainder {
        force: unknown_force(experiment, &found.named, &candidates, floor, counts),
        ..remainder(baseline, &found.named, floor)
    });
    let before = goodness_of_fit(baseline, floor);
    let [repeatable_force, own_force, slip] = evidence.unknown;
    Diagnosis {
        suspects: Vec::new(),
        verdict,
        sentence,
        causes,
        alternatives,
        fitted: fitted.iter().map(|cause| cause.name().to_owned()).collect(),
        whiteness: Whiteness {
            before,
            after: goodness_of_fit(after, floor),
            heldout: held,
            explainable: (1.0 - (floor.measured_m() / before.rms_m).powi(2)).clamp(0.0, 1.0),
            constancy: tests.into_iter().map(|(test, _)| test).collect(),
        },
        noise_m: floor.measured_m(),
        noise: noise(experiment, floor),
        checked: gained.as_ref().map_or("none", |gained| &gained.how).to_owned(),
        heldout: gained.filter(|_| !is_silent),
        detectable: detect::detectable(experiment, baseline, &candidates, counts),
        next_experiments: Vec::new(),
        partial,
        remainder,
        established,
        unknown: Unknown { gain: evidence.unnamed, repeatable_force, own_force, slip },
        unfitted: evidence.unfitted,
        complete: evidence.complete,
        bent: if is_silent { Vec::new() } else { bent(baseline, after) },
        residuals: residuals(baseline, after, floor),
        remarks,
    }
}

/// Sets of causes beside the best one.
fn alternatives(found: &Found<'_>) -> Vec<Alternative> {
    let others = found.evidence.sets.iter().skip(1).filter(|set| set.probability > TOLD_SET);
    let told = others.take(MOST_SETS).map(|set| Alternative {
        names: set.labels.clone(),
        probability: set.probability,
        delta_bic: 2.0 * set.gain,
    });
    told.collect()
}

/// A cause with its values in the runs called `ids`.
fn named(
    cause: &FoundCause,
    experiment: &Experiment,
    ids: &[String],
    tests: &[(ConstancyTest, Vec<PerRun>)],
) -> NamedCause {
    let info = cause.term.info();
    let is_its = |name: &str| cause.term.owns(name);
    let per_run = tests.iter().flat_map(|(_, runs)| runs).filter(|run| is_its(&run.parameter)).cloned();
    NamedCause {
        name: info.name.into(),
        by_run: matches!(cause.form, Form::CommonAndByRun | Form::ByRunOnly),
        form: match cause.form {
            Form::DropsOnly => Some("drops only".into()),
            Form::DropsByRun => Some("drops only, in each by another size".into()),
            Form::OneRun(run) => ids.get(run).map(|id| format!("{id} only")),
            _ => None,
        },
        element: cause.element.clone(),
        sentence: info.sentence.into(),
        check: info.check.into(),
        formula: info.formula.into(),
        aliases: candidates::aliases(cause.term.cause, experiment).into_iter().map(str::to_owned).collect(),
        parameters: parameters(cause, experiment, ids),
        probability: cause.probability,
        delta_bic: 2.0 * cause.gain,
        per_run: per_run.collect(),
    }
}

/// The values of a cause in runs called `ids`.
fn parameters(cause: &FoundCause, experiment: &Experiment, ids: &[String]) -> Vec<CauseParameter> {
    let known = candidates::names(cause.term.cause, &cause.term.added_to(&experiment.model));
    let unit = |name: &str| {
        let own = known.iter().find(|(own, _)| own == name);
        own.map_or_else(String::new, |(_, info)| info.unit.to_owned())
    };
    let mut list = Vec::new();
    let common = |name: &str| cause.sizes.iter().find(|size| size.name == name && size.runs.is_empty());
    for size in &cause.sizes {
        let unit = unit(&size.name);
        if size.runs.is_empty() {
            put(&mut list, size.name.clone(), size.value, size.ci95, unit);
            continue;
        }
        // a run's own deviation stands on what is common
        let (base, width) = common(&size.name)
            .map_or((0.0, 0.0), |common| (common.value, 0.5 * (common.ci95[1] - common.ci95[0])));
        let half = width.hypot(0.5 * (size.ci95[1] - size.ci95[0]));
        let value = base + size.value;
        for id in size.runs.iter().filter_map(|&run| ids.get(run)) {
            put(&mut list, format!("{}@{id}", size.name), value, [value - half, value + half], unit.clone());
        }
    }
    for (name, value) in &cause.term.choices {
        list.push(CauseParameter { name: name.clone(), value: *value, ci95: None, unit: unit(name) });
    }
    list
}

fn put(list: &mut Vec<CauseParameter>, name: String, value: f64, ci95: [f64; 2], unit: String) {
    list.push(CauseParameter { name, value, ci95: Some(ci95), unit });
}

/// Where the noise floor comes from.
fn noise(experiment: &Experiment, floor: &Floor) -> NoiseFloor {
    NoiseFloor {
        source: format!(
            "residuals of the still images ({:.0} % of all) and, while the mechanism moves, what of them is faster than a spline with a knot every 50 ms; {:.0} degrees of freedom",
            100.0 * floor.still_share,
            floor.degrees
        ),
        std_m: floor.noise_std_m,
        correlation: floor.correlation,
        correlation_std: floor.correlation_std,
        degrees: floor.degrees,
        stated_m: experiment.noise_m,
        pose_std_m: floor.pose_std_m,
        stamp_std_s: (floor.stamp_std_s > 0.0).then_some(floor.stamp_std_s),
        runs: floor.runs.clone(),
    }
}
