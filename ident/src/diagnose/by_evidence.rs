//! A diagnosis by one evidence with an unknown in every hypothesis (`docs/evidence.md`): what is named, what is not, and why. It stands beside
//! the one that `rig diagnose` makes until it says as much wherever that does; nothing but an example calls it.

use std::time::{Duration, Instant};

use sim::Cause;

use super::baseline::Stamps;
use super::established::remainder;
use super::gates::{constancy, goodness_of_fit};
use super::intervals::bent;
use super::remarks::{fitted_in_part, held_in_drops, seen_from_above};
use super::residuals::residuals;
use super::result::{
    Alternative, CauseParameter, ConstancyTest, Diagnosis, NamedCause, PerRun, Remainder, Unknown, Verdict,
    Whiteness,
};
use super::unknown_force::unknown_force;
use super::verdict::noise;
use super::{DiagnoseError, Observer, baseline, detect, gain, heldout, words};
use crate::description::{self, Examined};
use crate::evidence::{Form, Found, FoundCause, Standing, evidence};
use crate::experiment::{Experiment, Spike};
use crate::fit::counts::Counts;
use crate::hypothesis::candidates::{self, Term, possible};
use crate::hypothesis::score::Scores;
use crate::hypothesis::state::State;
use crate::initial::free_parameters;
use crate::noise::floor::Floor;

/// Where no set of causes is named, but none at all is less probable than this, the sets are told.
const NONE_IS_LEFT: f64 = 0.05;
/// Sets of causes that are told, the best first, and how probable they are at least.
const MOST_SETS: usize = 5;
const TOLD_SET: f64 = 0.05;

/// A noise floor that differs by more than this share beside the best explanation is worth another search (chosen).
const OTHER_FLOOR_SHARE: f64 = 0.2;
/// What of the time limit the search may take: what it finds is to be described as well.
const SEARCH_SHARE: f64 = 0.75;

/// What explains the runs of `experiment`, and how probable that is; without advice for the next run.
///
/// # Errors
/// [`DiagnoseError`]; [`DiagnoseError::Interrupted`] where the observer has had enough before the model is fitted.
pub fn by_evidence(experiment: &Experiment, observer: &mut dyn Observer) -> Result<Diagnosis, DiagnoseError> {
    let began = Instant::now();
    experiment.check()?;
    let mut counts = Counts::until(observer.interrupted());
    if !observer.stage("looking through the files") {
        return Err(DiagnoseError::Interrupted);
    }
    let Examined { suspects, mended } = description::examine(experiment, &mut counts);
    let experiment = mended.as_ref().unwrap_or(experiment);
    let parameters = free_parameters(&experiment.model, experiment)?;
    let fitted = candidates::fitted(&experiment.model, &parameters);
    observer.stage("fitting the baseline");
    let fitted_model = baseline::baseline(experiment, parameters, Stamps::Scattered, &mut counts);
    if counts.is_stopped() {
        return Err(DiagnoseError::Interrupted);
    }
    let (mut baseline, mut floor) = fitted_model?;
    let limit_s = SEARCH_SHARE * experiment.diagnose.limit_s.get();
    let deadline = Duration::try_from_secs_f64(limit_s).ok().and_then(|limit| began.checked_add(limit));
    let mut searching = match deadline {
        Some(deadline) => counts.apart().by(deadline),
        None => counts.apart(),
    };
    let mut says = |set: &str| observer.stage(&format!("trying {set}"));
    let mut found = evidence(experiment, &baseline, &floor, None, &mut searching, &mut says)?;
    // noise is what the best explanation leaves, not what a model leaves that lacks something
    let left = baseline::seen_floor(&found.leader, Stamps::Scattered)?;
    if !searching.is_stopped() && !baseline::is_same(&floor, &left, OTHER_FLOOR_SHARE) {
        let mut again = baseline.clone();
        again.weigh(&left);
        if again.descend(&mut searching) {
            let once_more = evidence(experiment, &again, &left, Some(&found), &mut searching, &mut says)?;
            if once_more.evidence.complete || !found.evidence.complete {
                (baseline, floor, found) = (again, left, once_more);
            }
        }
    }
    let mut diagnosis = verdict(experiment, &fitted, &baseline, &found, &floor, &mut counts);
    diagnosis.lead_with(suspects);
    Ok(diagnosis)
}

/// Puts together what was found of the runs beside `baseline`; `fitted`: causes that are no candidates.
fn verdict(
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
        Verdict::Unexplained => (Vec::new(), list(&is_leading), known),
        Verdict::Ambiguous => (list(&is_leading), Vec::new(), Vec::new()),
        _ => (known, Vec::new(), Vec::new()),
    };
    let alternatives = if verdict == Verdict::Ambiguous { alternatives(found) } else { Vec::new() };
    let sentence = words::sentence(verdict, &causes, &alternatives, &established, &evidence.causes);
    let mut remarks = words::doubts(verdict, &evidence.causes, gained.as_ref());
    if evidence.is_explained() && evidence.unexplained > TOLD_SET {
        let chance = 100.0 * evidence.unexplained;
        remarks.push(format!("perhaps something is at work that nothing explains: {chance:.0} % probable"));
    }
    if untried {
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
    let terms = |cause: &Cause| Term::all(*cause, &experiment.model, 1, 1.0, &experiment.diagnose.elements);
    let scores = Scores::new(baseline, &candidates.iter().flat_map(terms).collect::<Vec<_>>(), counts);
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
        detectable: detect::detectable(baseline, &scores),
        next_experiments: Vec::new(),
        partial,
        remainder,
        established,
        unknown: Some(Unknown {
            gain: evidence.unnamed,
            unfitted: evidence.unfitted,
            repeatable_force,
            own_force,
            slip,
        }),
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
        probability: Some(set.probability),
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
            Form::OneRun(run) => ids.get(run).map(|id| format!("{id} only")),
            _ => None,
        },
        element: cause.element.clone(),
        sentence: info.sentence.into(),
        check: info.check.into(),
        formula: info.formula.into(),
        aliases: candidates::aliases(cause.term.cause, experiment).into_iter().map(str::to_owned).collect(),
        parameters: parameters(cause, experiment, ids),
        probability: Some(cause.probability),
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
