//! The verdict in words.

use super::result::{Alternative, HeldOut, NamedCause, Verdict};
use crate::evidence::{FoundCause, Standing};

/// The verdict in a sentence; `found`: all causes that are spoken of.
pub(super) fn sentence(
    verdict: Verdict,
    causes: &[NamedCause],
    alternatives: &[Alternative],
    established: &[NamedCause],
    found: &[FoundCause],
) -> String {
    let said: Vec<String> = causes.iter().map(said_of).collect();
    match verdict {
        Verdict::NothingDetectable => {
            "Nothing detectable: what the simulation leaves of the runs is noise.".to_owned()
        }
        Verdict::Suspected => {
            format!("Most likely, though no other run has confirmed it: {}.", said.join("; and "))
        }
        Verdict::Cause | Verdict::Causes => capital(&format!("{}.", said.join("; and "))),
        Verdict::Ambiguous => {
            let others = alternatives.iter().map(|other| match other.names.is_empty() {
                true => "nothing".into(),
                false => other.names.join(" + "),
            });
            let others: Vec<String> = others.collect();
            let or = if others.is_empty() { "something else".into() } else { others.join("; or ") };
            format!("{}, or as well: {or}. These runs cannot tell.", capital(&said.join("; and ")))
        }
        Verdict::Unexplained => {
            let differs = found.iter().filter(|cause| cause.standing == Standing::Resembles).map(differing);
            let known = established.iter().map(said_of);
            let known = known.reduce(|all, next| format!("{all}; and {next}"));
            let known = known.map(|known| format!("At work all the same: {known}"));
            let mut list = vec!["Something is wrong that no known cause explains".to_owned()];
            list.extend(differs.map(|said| capital(&said)));
            list.extend(known);
            format!("{}.", list.join(". "))
        }
    }
}

fn said_of(cause: &NamedCause) -> String {
    let how = match &cause.form {
        Some(form) => format!(", {form}"),
        None if cause.by_run => ", differently in each run".into(),
        None => String::new(),
    };
    match &cause.element {
        Some(element) => format!("{}, at {element} alone{how} ({})", cause.sentence, cause.label()),
        None => format!("{}{how} ({})", cause.sentence, cause.name),
    }
}

/// By run only: no force of that name is at work.
fn differing(cause: &FoundCause) -> String {
    format!("something differs from run to run and resembles {}", cause.term.info().name)
}

/// What leaves doubt about the verdict, or about parts of it; one sentence each.
pub(super) fn doubts(verdict: Verdict, found: &[FoundCause], gained: Option<&HeldOut>) -> Vec<String> {
    let mut list: Vec<String> = Vec::new();
    let percent = |probability: f64| format!("{:.0} %", 100.0 * probability);
    for cause in found {
        let name = cause.term.info().name;
        let places = cause.elsewhere.join(" or ");
        let label = match cause.elsewhere.is_empty() {
            true => cause.element.as_ref().map_or(name.to_owned(), |element| format!("{name}/{element}")),
            false => places.clone(),
        };
        match cause.standing {
            Standing::Named if cause.elsewhere.is_empty() => {}
            Standing::Named => list.push(format!("`{name}` is at work, as {places}: these runs cannot tell which")),
            Standing::Possible if verdict == Verdict::Ambiguous => {}
            Standing::Possible => {
                list.push(format!("perhaps also {label}: {} probable", percent(cause.probability)));
            }
            Standing::Suspected => list.push(format!(
                "{label} would explain part of the motion, but may stand in for what nothing explains"
            )),
            Standing::Resembles => list.push(format!(
                "{} ({} probable): that is no force of this name, but something that is not the same in all runs",
                differing(cause),
                percent(cause.probability)
            )),
        }
    }
    if let Some(gained) = gained.filter(|gained| gained.gain <= 0.0) {
        list.push(format!(
            "on runs that it was not fitted to, the description gains nothing: {:.1} %",
            100.0 * gained.gain
        ));
    }
    list
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
