//! What to do next: the run, or the look elsewhere, that tells the leader from its rivals.

use std::collections::BTreeMap;

use super::detect::BEYOND_DOUBT_COST;
use super::result::{Diagnosis, NamedCause, NextExperiment, Verdict};
use crate::design::{self, Prospect, Sized, Worth, runs::Proposal};
use crate::experiment::Experiment;
use crate::fit::counts::Counts;
use crate::hypothesis::candidates::Term;
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;

/// A run worth making.
pub type Next = Proposal;

/// Runs listed for one question.
const MOST_LISTED: usize = 5;
/// Cost by which two causes must differ to be told apart reliably: the cost at which a cause is seen beyond doubt.
const TOLD_APART_COST: f64 = BEYOND_DOUBT_COST;
/// A run that adds less than this share to what the runs tell already is none to recommend.
const WORTHWHILE_SHARE: f64 = 0.1;

/// Advice, best first, and the runs in it.
pub(super) fn next(
    experiment: &Experiment,
    baseline: &State<'_>,
    (leader, rival): (&State<'_>, Option<&State<'_>>),
    floor: &Floor,
    diagnosis: &Diagnosis,
    counts: &Counts,
) -> (Vec<NextExperiment>, Vec<Next>) {
    let (mut advice, mut runs) = (Vec::new(), Vec::new());
    let mut list = |list: &[Worth], names: &[String]| {
        for worth in list.iter().take(MOST_LISTED).filter(|w| w.after > (1.0 + WORTHWHILE_SHARE) * w.before) {
            advice.push(advised(worth, names.to_vec()));
            runs.push(worth.proposal.clone());
        }
    };
    let is_open = diagnosis.verdict == Verdict::Ambiguous && diagnosis.complete;
    let rivals = rival.filter(|_| is_open).and_then(|rival| rivals(leader, rival));
    let mut apart = None;
    if let Some((a, b)) = &rivals {
        let names = vec![a.0.cause.name().to_owned(), b.0.cause.name().to_owned()];
        let pair = (std::slice::from_ref(a), Some(b));
        let worths = design::separating(experiment, baseline, floor, counts, pair);
        list(&worths, &names);
        apart = Some((names, worths.first().map_or(0.0, |worth| worth.after)));
    }
    if diagnosis.verdict == Verdict::Suspected {
        let causes: Vec<Sized> = leader.causes.iter().map(|term| sized(term, leader)).collect();
        let names: Vec<String> = diagnosis.causes.iter().map(NamedCause::label).collect();
        list(&design::separating(experiment, baseline, floor, counts, (&causes, None)), &names);
    }
    if let Some((names, _)) = apart.filter(|(_, best)| *best < TOLD_APART_COST) {
        advice.extend(elsewhere(&names));
    }
    for cause in &diagnosis.causes {
        advice
            .extend(cause.aliases.iter().filter_map(|alias| elsewhere(&[cause.name.clone(), alias.clone()])));
    }
    match diagnosis.verdict {
        Verdict::Suspected => advice.insert(0, repeated(HELD_OUT)),
        Verdict::Unexplained => advice.insert(0, repeated(TWICE)),
        _ => {}
    }
    let described = [&diagnosis.causes, &diagnosis.established, &diagnosis.partial];
    let mut looked_at: Vec<&NamedCause> = Vec::new();
    for cause in described.into_iter().flatten() {
        if looked_at.iter().all(|other| other.name != cause.name) {
            looked_at.push(cause);
        }
    }
    advice.extend(looked_at.into_iter().map(|cause| measured(&cause.check, &[cause.label()])));
    (advice, runs)
}

/// What one more run is good for where nothing has checked what is named.
const HELD_OUT: &str = "make one more run, from another pose or with other strokes, and hold it out (`rig experiment RUN --holdout \
                        OTHER`): what is named must help there too";
/// And where nothing is.
const TWICE: &str = "make the same run twice: what differs between the two is no property of the mechanism";

/// A run to make by hand, for what only one more can show.
fn repeated(what: &str) -> NextExperiment {
    NextExperiment { kind: "repeat".into(), ..measured(what, &[]) }
}

/// A look at the tank, or at the files.
pub(super) fn measured(what: &str, separates: &[String]) -> NextExperiment {
    NextExperiment {
        kind: "measurement".into(),
        what: what.into(),
        command: String::new(),
        proposal: None,
        separates: separates.to_vec(),
        before: 0.0,
        after: 0.0,
    }
}

/// Runs that take most of the uncertainty of the parameters `names` away, which stand in `state` at the places `which`.
pub(super) fn pinning(
    experiment: &Experiment,
    state: &State<'_>,
    floor: &Floor,
    (names, which): (&[String], &[usize]),
    counts: &Counts,
) -> (Vec<NextExperiment>, Vec<Next>) {
    let (mut advice, mut runs): (Vec<NextExperiment>, Vec<Next>) = (Vec::new(), Vec::new());
    let Some((before, prospects)) = design::pinning(experiment, state, floor, which, counts) else {
        return (advice, runs);
    };
    for (place, name) in names.iter().enumerate() {
        let mut order: Vec<&Prospect> = prospects.iter().collect();
        order.sort_by(|a, b| a.std[place].total_cmp(&b.std[place]));
        for Prospect { proposal, std } in order.into_iter().take(MOST_LISTED) {
            let worth = Worth { proposal: proposal.clone(), before: before[place], after: std[place] };
            advice.push(advised(&worth, vec![name.clone()]));
            runs.push(worth.proposal);
        }
    }
    (advice, runs)
}

/// A run as it is advised; its config is written beside the diagnosis.
fn advised(worth: &Worth, separates: Vec<String>) -> NextExperiment {
    let Worth { proposal, before, after } = worth;
    NextExperiment {
        kind: proposal.kind().into(),
        what: proposal.words(),
        command: String::new(),
        proposal: Some(proposal.id.clone()),
        separates,
        before: *before,
        after: *after,
    }
}

/// A cause of each that the other has not, with its fitted sizes.
fn rivals(leader: &State<'_>, rival: &State<'_>) -> Option<(Sized, Sized)> {
    let differing = |state: &State<'_>, from: &State<'_>| -> Option<Sized> {
        let term = state.causes.iter().find(|term| from.causes.iter().all(|t| t.cause != term.cause))?;
        Some(sized(term, state))
    };
    Some((differing(leader, rival)?, differing(rival, leader)?))
}

/// `term` with the sizes that its numbers have in `state`.
fn sized(term: &Term, state: &State<'_>) -> Sized {
    let model = state.calibrated();
    let mut sizes: BTreeMap<String, f64> = BTreeMap::new();
    for (name, ..) in term.directions(&model) {
        sizes.insert(name.clone(), model.parameter(&name).unwrap_or(0.0));
    }
    // of numbers that each run has its own of, the largest
    for (name, nuisance) in term.free(&state.model).own {
        for (one, offsets) in state.terms.iter().zip(&state.point.offsets) {
            let place = one.rehearsal.nuisances.iter().position(|known| *known == nuisance);
            let value = place.map_or(0.0, |place| offsets[place]);
            let size = sizes.entry(name.clone()).or_insert(0.0);
            if value.abs() > size.abs() {
                *size = value;
            }
        }
    }
    let hidden =
        term.hidden.iter().map(|(name, start)| (name.clone(), model.parameter(name).unwrap_or(*start)));
    (Term { hidden: hidden.collect(), ..term.clone() }, sizes.into_iter().collect())
}

/// What tells two causes apart without a run: a ruler, a balance, a lamp.
fn elsewhere(names: &[String]) -> Option<NextExperiment> {
    let is = |list: &[&str]| names.iter().any(|name| list.contains(&name.as_str()));
    let what = if is(&["link_mass", "buoyancy"]) {
        "weigh each link dry and in water (to 0.01 g) and state both under [mechanism]"
    } else if is(&["servo_delay", "servo_lag", "camera_delay"]) {
        "let a lamp in the picture be switched by the servo board, or add a drop whose release is on the same clock"
    } else if is(&["camera_scale", "keypoint_slip", "camera_tilt", "lens", "camera_rotation"]) {
        "measure the scale: a ruler in the plane of motion, seen over at least half of the picture, gives metres_per_pixel under \
         [calibration]"
    } else if is(&["cob_offset", "tether"]) {
        "look at the straight mechanism at rest in another pose, and at its cable"
    } else {
        return None;
    };
    Some(measured(what, names))
}
