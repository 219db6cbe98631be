//! The diagnosis in words: for a terminal, and for the top of the page.

use std::fmt::Write as _;

use ident::description::Suspect;
use ident::diagnose::{
    CauseParameter, Diagnosis, NamedCause, NextExperiment, Resembled, UnknownForce, Verdict,
};

use super::format::{millimetres, significant, whole_percent};
use super::verdict::ratio_text;

/// `value unit (lower to upper)`.
pub(super) fn value(parameter: &CauseParameter) -> String {
    let unit = if parameter.unit == "1" { String::new() } else { format!(" {}", parameter.unit) };
    match parameter.ci95 {
        Some([lower, upper]) => {
            format!(
                "{}{unit} ({} to {})",
                significant(parameter.value),
                significant(lower),
                significant(upper)
            )
        }
        None => format!("{}{unit}", significant(parameter.value)),
    }
}

/// The simulation's error with and without the named causes; where there is a fit, its headline says it.
pub(super) fn error(diagnosis: &Diagnosis) -> Option<String> {
    let (before, floor_m) = (diagnosis.error_m(false)?, diagnosis.floor_m());
    let after = diagnosis.error_m(true).filter(|_| !diagnosis.causes.is_empty());
    let named =
        after.map_or(String::new(), |after| format!("; with the named causes, by {} mm", millimetres(after)));
    let ratio = ratio_text(before / floor_m);
    Some(format!(
        "The simulation is off by {} mm, {ratio} times the noise of {} mm{named}.",
        millimetres(before),
        millimetres(floor_m)
    ))
}

/// Sentences that qualify the verdict.
pub(super) fn details(diagnosis: &Diagnosis) -> Vec<String> {
    let suspect = |suspect: &Suspect| {
        format!("In {:.0} of 100 such cases: {}.", (100.0 * suspect.probability).floor(), suspect.sentence)
    };
    let mut list: Vec<String> = diagnosis.suspects.iter().map(suspect).collect();
    for cause in &diagnosis.causes {
        let numbers: Vec<String> = cause
            .parameters
            .iter()
            .filter(|parameter| !parameter.name.contains('@'))
            .map(|parameter| format!("{} = {}", parameter.name, value(parameter)))
            .collect();
        if !numbers.is_empty() {
            list.push(format!("{}, 95 % intervals in brackets.", numbers.join(", ")));
        }
        if !cause.aliases.is_empty() {
            list.push(format!(
                "No video of these runs tells {} from {}.",
                cause.label(),
                cause.aliases.join(", ")
            ));
        }
    }
    if let Some(heldout) = &diagnosis.heldout {
        let runs =
            if heldout.how == "holdout" { "held-out runs" } else { "each run in turn left out of the fit" };
        list.push(format!(
            "On {runs} the residual goes from {} to {} mm, noise alone leaves {}: a gain of {} % ({} to {} %).",
            millimetres(heldout.rms_before_m),
            millimetres(heldout.rms_after_m),
            millimetres(heldout.noise_floor_m),
            whole_percent(heldout.gain),
            whole_percent(heldout.gain_ci95[0]),
            whole_percent(heldout.gain_ci95[1])
        ));
    }
    if diagnosis.verdict == Verdict::Unexplained {
        if let Some(remainder) = diagnosis.remainder.as_ref().filter(|_| !diagnosis.established.is_empty()) {
            list.push(format!(
                "With the established causes {} mm are left, {} % of the squared residuals beyond noise.",
                millimetres(remainder.rms_m),
                whole_percent(remainder.share)
            ));
        }
        list.extend(
            diagnosis.remainder.as_ref().and_then(|remainder| remainder.force.as_ref()).map(unknown_force),
        );
        if !diagnosis.partial.is_empty() {
            let names: Vec<String> = diagnosis.partial.iter().map(NamedCause::label).collect();
            list.push(format!("Best description, not a named cause: {}.", names.join(" + ")));
        }
        if let Some(follows) = diagnosis.residuals.follows.first().filter(|follows| follows.share > 0.05) {
            list.push(format!(
                "The residuals depend most on {} ({:.0} % of their squares){}.",
                follows.what,
                100.0 * follows.share,
                diagnosis
                    .residuals
                    .frequency_hz
                    .map_or(String::new(), |hz| format!("; their main frequency is {hz:.1} Hz"))
            ));
        }
    }
    list.extend(diagnosis.remarks.iter().map(|remark| capital(remark)));
    if !diagnosis.bent.is_empty() {
        let moved: Vec<String> = diagnosis
            .bent
            .iter()
            .take(4)
            .map(|bent| {
                format!("{} {} instead of {}", bent.name, significant(bent.before), significant(bent.after))
            })
            .collect();
        list.push(format!("Without it the fit was biased: {}.", moved.join(", ")));
    }
    list
}

/// A next experiment in one line, without its command.
fn advice(next: &NextExperiment) -> String {
    let apart = next.separates.join(" and ");
    match &next.separates[..] {
        _ if next.proposal.is_some() => format!(
            "{}: raises the separation of {apart} from {} to {} noise variances",
            next.what,
            significant(next.before),
            significant(next.after)
        ),
        [] => format!("{}.", next.what),
        [one] => format!("to check {one}: {}.", next.what),
        _ => format!("{}: tells {apart} apart.", next.what),
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters
        .next()
        .map_or(String::new(), |first| first.to_uppercase().chain(letters).collect::<String>() + ".")
}

/// Next experiments listed in a terminal. Chosen.
const LISTED_EXPERIMENTS_MAX: usize = 3;

/// The diagnosis as lines for a terminal.
pub fn diagnosis_summary(diagnosis: &Diagnosis) -> String {
    diagnosis_lines(diagnosis, error(diagnosis))
}

/// The lines of the diagnosis with the sentence `error`, which is left out where a fit's headline says it.
pub(super) fn diagnosis_lines(diagnosis: &Diagnosis, error: Option<String>) -> String {
    let mut text = format!("{}: {}\n", diagnosis.verdict.name(), diagnosis.sentence);
    for detail in error.into_iter().chain(details(diagnosis)) {
        let _ = writeln!(text, "- {detail}");
    }
    let advised = || diagnosis.next_experiments.iter().take(LISTED_EXPERIMENTS_MAX);
    let mut typed = "";
    for next in advised() {
        let _ = writeln!(text, "- Next: {}", advice(next));
        if !next.command.is_empty() && next.command != typed {
            typed = &next.command;
            let _ = writeln!(text, "  {typed}");
        }
    }
    if advised().any(|next| next.proposal.is_some() && next.command.is_empty()) {
        text.push_str(
            "  With --config CONFIG, the rig's config, a config is written for each proposed run.\n",
        );
    }
    text
}

fn unknown_force(force: &UnknownForce) -> String {
    let joints: Vec<&str> = force.joints.iter().map(|joint| joint.joint.as_str()).collect();
    let resembled = |other: &Resembled| format!("{} ({} %)", other.name, whole_percent(other.share));
    let resembles: Vec<String> = force.resembles.iter().map(resembled).collect();
    format!(
        "An unknown force on {}, a function of angle and rate, explains {} % ({} to {} %) of the remaining residuals on runs that it was not \
         fitted to{}.",
        joints.join(", "),
        whole_percent(force.heldout.gain),
        whole_percent(force.heldout.gain_ci95[0]),
        whole_percent(force.heldout.gain_ci95[1]),
        match resembles.is_empty() {
            true => "; no cause resembles it".into(),
            false => format!("; parts of it could come from {}", resembles.join(", ")),
        }
    )
}
