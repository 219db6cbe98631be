//! The verdict: what is named, what is not, and why.

use sim::Cause;

use super::floor::Floor;
use super::gates::{constancy, fitness};
use super::result::{
    Alternative, ConstancyTest, Diagnosis, Fitness, HeldOut, NamedCause, NoiseFloor, PerRun, Verdict,
    Whiteness,
};
use super::search::{AS_GOOD, BETTER, Found, sets};
use super::state::State;
use super::{candidates, detect, extend, gain, heldout, residuals};
use crate::experiment::{Experiment, Spike};
use crate::fit::counts::Counts;
use crate::text::millimetres;

/// A number this near to a bound, as a share of their distance, is at it.
const AT_BOUND: f64 = 0.02;

/// Puts together what was found; also the state that describes the runs best.
pub(super) fn verdict<'a>(
    experiment: &'a Experiment,
    fitted: &[Cause],
    baseline: &State<'a>,
    found: &Found<'a>,
    floor: &Floor,
    counts: &mut Counts,
) -> (Diagnosis, State<'a>) {
    let before = fitness(baseline, floor);
    let accepted = !found.leader.causes.is_empty();
    // where nothing is accepted, the best that was tried is a description at most
    let best = found.tried.iter().find(|state| !state.causes.is_empty() && state.bic() < baseline.bic());
    let leader = if accepted { &found.leader } else { best.unwrap_or(baseline) };
    let explained = baseline.cost - leader.cost;
    let after = if leader.causes.is_empty() { before } else { fitness(leader, floor) };
    let tests = constancy(leader, baseline.parameters.len());
    let mut more = Counts::default();
    let (heldout, gained) = rayon::join(
        || heldout::fitness(experiment, leader, floor, counts),
        || match leader.causes.is_empty() {
            true => None,
            false => gain::gain(experiment, baseline, leader, floor, &mut more),
        },
    );
    counts.add(&more);
    let count = baseline.count();

    let mut remarks = Vec::new();
    let verdict = if !accepted {
        if before.objects(0.0, floor.noise_m, count) {
            Verdict::Unexplained
        } else {
            Verdict::NothingDetectable
        }
    } else {
        remarks = objections(&after, heldout.as_ref(), &tests, explained, (floor.noise_m, count));
        // what each run has its own of cannot be told beforehand
        if leader.causes.iter().all(|term| term.free(&leader.model).own.is_empty()) {
            remarks.extend(gained.as_ref().and_then(HeldOut::objection));
        }
        match leader.causes.len() {
            _ if !remarks.is_empty() => Verdict::Unexplained,
            1 => Verdict::Cause,
            _ => Verdict::Causes,
        }
    };
    let (rivals, others): (Vec<Rival>, Vec<Rival>) =
        rivals(experiment, found).into_iter().partition(|rival| rival.behind <= AS_GOOD);
    let verdict = match verdict {
        Verdict::Cause | Verdict::Causes if !rivals.is_empty() => Verdict::Ambiguous,
        other => other,
    };
    let rivals: Vec<Alternative> = rivals.into_iter().map(|rival| rival.set).collect();
    let names = matches!(verdict, Verdict::Cause | Verdict::Causes | Verdict::Ambiguous);
    if names {
        remarks.extend(others.iter().map(Rival::remark));
    }
    remarks.extend(experiment.runs.iter().filter_map(|run| Spike::sentence(&run.id, &run.set_aside)));
    let describes = names || verdict == Verdict::Unexplained;
    let leader = if describes { leader.clone() } else { baseline.clone() };
    let list = named(experiment, baseline, &leader, &tests, found);
    let sentence = sentence(verdict, &list, &rivals, &before, floor);
    let diagnosis = Diagnosis {
        verdict,
        sentence,
        causes: if names { list.clone() } else { Vec::new() },
        alternatives: if verdict == Verdict::Ambiguous { rivals } else { Vec::new() },
        fitted: fitted.iter().map(|cause| cause.name().to_owned()).collect(),
        whiteness: Whiteness {
            before,
            after: if describes { after } else { before },
            heldout,
            explainable: (1.0 - (floor.noise_m / before.rms_m).powi(2)).clamp(0.0, 1.0),
            constancy: if describes { tests.into_iter().map(|(test, _)| test).collect() } else { Vec::new() },
        },
        noise_m: floor.noise_m,
        noise: NoiseFloor {
            source: source(floor),
            correlation: floor.correlation,
            correlation_std: floor.correlation_std,
            degrees: floor.degrees,
            stated_m: experiment.noise_m,
            runs: floor.runs.clone(),
        },
        heldout: gained.filter(|_| describes),
        detectable: detect::detectable(baseline, &found.first),
        next_experiments: Vec::new(),
        partial: if verdict == Verdict::Unexplained { list } else { Vec::new() },
        bent: if names { extend::bent(baseline, &leader) } else { Vec::new() },
        residuals: residuals::residuals(baseline, &leader, floor),
        remarks,
    };
    (diagnosis, leader)
}

/// Why the description is none of a cause.
fn objections(
    after: &Fitness,
    heldout: Option<&Fitness>,
    tests: &[(ConstancyTest, Vec<PerRun>)],
    explained: f64,
    (noise_m, count): (f64, usize),
) -> Vec<String> {
    let mut list = Vec::new();
    if after.objects(explained, noise_m, count) {
        list.push(format!(
            "what is left is no noise: {:.0} noise variances beyond it ({:.0} standard deviations)",
            after.excess, after.z
        ));
    }
    if let Some(heldout) = heldout.filter(|heldout| heldout.objects(explained, noise_m, count)) {
        list.push(format!(
            "on held-out runs what is left is no noise: {:.0} noise variances beyond it ({:.0} standard deviations)",
            heldout.excess, heldout.z
        ));
    }
    for (test, _) in tests.iter().filter(|(test, _)| test.objects(explained)) {
        list.push(format!(
            "{} differs from run to run: chi-square {:.0} with {} degrees of freedom",
            test.parameter, test.chi2, test.degrees
        ));
    }
    list
}

/// Another set of causes that explains the runs.
struct Rival {
    set: Alternative,
    /// How much worse than the leader's its BIC is.
    behind: f64,
}

impl Rival {
    fn remark(&self) -> String {
        format!(
            "{} describes these runs nearly as well: a BIC of {:.1} behind, odds of 1 to {:.0}",
            self.set.names.join(" + "),
            self.behind,
            (0.5 * self.behind).exp()
        )
    }
}

/// Other sets of causes within reach of the leader's BIC.
fn rivals(experiment: &Experiment, found: &Found<'_>) -> Vec<Rival> {
    let leader = sets(&found.leader);
    let class = |names: &[&'static str]| -> Vec<&'static str> {
        let mut names: Vec<&'static str> = names
            .iter()
            .map(|&name| {
                let aliases = name.parse().map(|cause: Cause| candidates::aliases(cause, experiment));
                aliases.unwrap_or_default().into_iter().chain([name]).min().unwrap_or(name)
            })
            .collect();
        names.sort_unstable();
        names
    };
    let own = class(&leader);
    let Some(baseline) = found.tried.iter().find(|state| state.causes.is_empty()) else { return Vec::new() };
    let mut list: Vec<Rival> = Vec::new();
    for state in &found.tried {
        let names = sets(state);
        let theirs = class(&names);
        let wider = own.iter().all(|name| theirs.contains(name));
        let known =
            list.iter().any(|other| other.set.names.iter().map(String::as_str).eq(names.iter().copied()));
        let behind = behind(state, &found.leader, baseline.cost - found.leader.cost);
        if names.is_empty() || wider || known || behind > BETTER {
            continue;
        }
        let names = names.into_iter().map(str::to_owned).collect();
        list.push(Rival { set: Alternative { names, delta_bic: baseline.bic() - state.bic() }, behind });
    }
    list
}

/// How much worse `rival` is than `leader`, as a BIC. Where a tether is fixed or a stop begins is chosen to suit, and makes a cause
/// no less likely to be the true one: such hidden numbers do not count against the rival, unless one is at a bound and makes it
/// another cause; nor may they turn a set with more numbers into one with fewer. A number more costs the rival no more than one of
/// the size in question would, of which `explained` is the cost saved: the BIC expects effects that a single observation shows, and
/// has two numbers of a faint cause pass for one of another.
///
/// # Source
/// E. I. George, D. P. Foster, "Calibration and empirical Bayes variable selection", Biometrika 87 (2000) 731-747: 1 + ln of the
/// cost saved by each number.
fn behind(rival: &State<'_>, leader: &State<'_>, explained: f64) -> f64 {
    let hidden = |state: &State<'_>| state.causes.iter().map(|term| term.hidden.len()).sum::<usize>();
    let numbers = |with_hidden: bool| {
        let count =
            |state: &State<'_>| state.added as f64 - if with_hidden { 0.0 } else { hidden(state) as f64 };
        count(rival) - count(leader)
    };
    let is_free = |name: &str| {
        let place = rival.parameters.free.iter().position(|parameter| parameter.name() == name);
        place.is_none_or(|place| {
            let (scale, value) = (rival.parameters.free[place].scale, rival.point.values[place]);
            let near = AT_BOUND * scale.width();
            value - scale.lower() > near && scale.upper() - value > near
        })
    };
    let free = rival.causes.iter().flat_map(|term| &term.hidden).all(|(name, _)| is_free(name));
    let more = match (numbers(true), numbers(false)) {
        (all, _) if !free => all,
        (all, sizes) if all * sizes < 0.0 => 0.0,
        (all, sizes) => all.min(sizes),
    };
    let mut each = leader.ln_count();
    if more > 0.0 {
        each = each.min(1.0 + (explained / rival.added.max(1) as f64).max(1.0).ln());
    }
    rival.cost - leader.cost + more * each
}

/// The causes of `leader` with their values.
fn named(
    experiment: &Experiment,
    baseline: &State<'_>,
    leader: &State<'_>,
    tests: &[(ConstancyTest, Vec<PerRun>)],
    found: &Found<'_>,
) -> Vec<NamedCause> {
    let values = extend::values(leader, baseline.parameters.len());
    let of = |name: &str, cause: &str| name.split('/').next() == Some(cause);
    let one = |term: &candidates::Term| {
        let info = term.info();
        // the best set without this one, of those that were refitted
        let rest: Vec<&str> = sets(leader).into_iter().filter(|name| *name != info.name).collect();
        let without = found.tried.iter().find(|state| sets(state) == rest).unwrap_or(baseline);
        NamedCause {
            name: info.name.into(),
            sentence: info.sentence.into(),
            formula: info.formula.into(),
            aliases: candidates::aliases(term.cause, experiment).into_iter().map(str::to_owned).collect(),
            parameters: values.iter().filter(|value| of(&value.name, info.name)).cloned().collect(),
            delta_bic: without.bic() - leader.bic(),
            per_run: tests
                .iter()
                .flat_map(|(_, runs)| runs)
                .filter(|run| of(&run.parameter, info.name))
                .cloned()
                .collect(),
        }
    };
    leader.causes.iter().map(one).collect()
}

fn source(floor: &Floor) -> String {
    format!(
        "residuals of the still images ({:.0} % of all) and, while the mechanism moves, what of them is faster than a spline with a knot every 50 ms; {:.0} degrees of freedom",
        100.0 * floor.still_share,
        floor.degrees
    )
}

fn sentence(
    verdict: Verdict,
    list: &[NamedCause],
    rivals: &[Alternative],
    before: &Fitness,
    floor: &Floor,
) -> String {
    let said: Vec<String> = list.iter().map(|cause| format!("{} ({})", cause.sentence, cause.name)).collect();
    match verdict {
        Verdict::NothingDetectable => format!(
            "Nothing detectable: the simulation repeats the runs down to their noise of {} mm.",
            millimetres(floor.noise_m)
        ),
        Verdict::Cause | Verdict::Causes => capital(&format!("{}.", said.join("; and "))),
        Verdict::Ambiguous => {
            let others: Vec<String> = rivals.iter().map(|rival| rival.names.join(" + ")).collect();
            format!(
                "{}, or as well: {}. These runs cannot tell.",
                capital(&said.join("; and ")),
                others.join("; or ")
            )
        }
        Verdict::Unexplained => format!(
            "Something is wrong that no known cause explains: residuals of {} mm against a noise of {} mm.",
            millimetres(before.rms_m),
            millimetres(floor.noise_m)
        ),
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
