//! The verdict: what is named, what is not, and why.

use sim::Cause;

use super::gates::{constancy, goodness_of_fit};
use super::remarks::{fitted_in_part, held_in_drops, seen_from_above};
use super::result::{
    Alternative, ConstancyTest, Diagnosis, GoodnessOfFit, HeldOut, NamedCause, NoiseFloor, PerRun, Remainder,
    Verdict, Whiteness,
};
use super::rivals::{Contest, Rival};
use super::sets::{Found, sets};
use super::unknown_force::unknown_force;
use super::{detect, established, gain, heldout, intervals, residuals};
use crate::experiment::{Experiment, Spike};
use crate::fit::counts::Counts;
use crate::hypothesis::candidates::{self, possible};
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;

/// Within this of the best BIC another set is as good: odds below 2.7 to 1, which are "not worth more than a bare mention"
/// (R. E. Kass, A. E. Raftery, "Bayes Factors", Journal of the American Statistical Association 90 (1995) 773-795).
const AS_GOOD_DELTA_BIC: f64 = 2.0;

/// Puts together what was found; also the state that describes the runs best, and where that is not explained, what of it is beyond
/// doubt.
pub(super) fn verdict<'a>(
    experiment: &'a Experiment,
    fitted: &[Cause],
    baseline: &State<'a>,
    (found, contest, is_cut): (&Found<'a>, Contest<'a>, bool),
    floor: &Floor,
    counts: &mut Counts,
) -> (Diagnosis, State<'a>, Option<State<'a>>) {
    let before = goodness_of_fit(baseline, floor);
    let accepted = !found.leader.causes.is_empty();
    // where nothing is accepted, the best that was tried is a description at most
    let best = found.tried.iter().find(|state| !state.causes.is_empty() && state.bic() < baseline.bic());
    let leader = if accepted { &found.leader } else { best.unwrap_or(baseline) };
    let count = baseline.count();
    let gates = Gates::new(experiment, (baseline, before), leader, floor, counts);
    let mut remarks = Vec::new();
    if accepted {
        remarks = gates.objections(leader, found, floor);
        // held-out runs that have chosen the leader are no longer as strict with it
        if let Some(other) = contest.overtaken.filter(|_| remarks.is_empty()) {
            let gates = Gates::new(experiment, (baseline, before), &other, floor, counts);
            let beside = |said| format!("{}, first by the fitted runs: {said}", sets(&other).join(" + "));
            remarks = gates.objections(&other, found, floor).into_iter().map(beside).collect();
        }
    }
    // a search that was ended before it accepted anything has not seen that there is nothing
    let untried = !accepted && is_cut;
    if accepted && counts.is_stopped() || untried {
        remarks.push(UNCHECKED.into());
    }
    let (rivals, others): (Vec<Rival>, Vec<Rival>) =
        contest.rivals.into_iter().partition(|rival| rival.behind <= AS_GOOD_DELTA_BIC);
    let beyond_noise = before.objects(0.0, floor, count);
    // where the model leaves noise alone, what helps no other run is none of its faults
    let doubt = gates.gained.as_ref().and_then(HeldOut::none_perhaps);
    let faint = accepted && !beyond_noise && doubt.is_some_and(|doubt| remarks == [doubt]);
    if faint {
        let leader = sets(leader).join(" + ");
        remarks =
            remarks.iter().map(|said| format!("{leader} would fit a little better, but {said}")).collect();
    }
    let objected = !faint && !remarks.is_empty() || !accepted && beyond_noise || untried;
    let verdict = match leader.causes.len() {
        _ if faint => Verdict::NothingDetectable,
        _ if objected => Verdict::Unexplained,
        _ if !accepted => Verdict::NothingDetectable,
        _ if !rivals.is_empty() => Verdict::Ambiguous,
        _ if gates.gained.is_none() => Verdict::Suspected,
        1 => Verdict::Cause,
        _ => Verdict::Causes,
    };
    let rivals: Vec<Alternative> = rivals.into_iter().map(|rival| rival.set).collect();
    let names = !matches!(verdict, Verdict::NothingDetectable | Verdict::Unexplained);
    if names {
        remarks.extend(leader.causes.iter().filter_map(|term| place_unknown(term, leader, found)));
        if gates.followed {
            remarks.push(LEFT_OPEN.into());
        }
        remarks.extend(others.iter().map(Rival::remark));
    }
    if verdict != Verdict::NothingDetectable {
        remarks.extend(fitted_in_part(experiment, &baseline.parameters));
        remarks.extend(held_in_drops(baseline));
    }
    remarks.extend(seen_from_above(experiment));
    remarks.extend(experiment.runs.iter().flat_map(|run| run.lost.iter().map(|lost| lost.sentence(&run.id))));
    remarks.extend(experiment.runs.iter().filter_map(|run| Spike::sentence(&run.id, &run.set_aside)));
    let describes = names || verdict == Verdict::Unexplained;
    let leader = if describes { leader.clone() } else { baseline.clone() };
    let list = named(experiment, baseline, &leader, &gates.constancy, found, counts);
    let known = (verdict == Verdict::Unexplained)
        .then(|| established::established(experiment, baseline, (found, &leader), floor, counts));
    let beyond_doubt = known.as_ref().map_or(Vec::new(), |known| {
        named(experiment, baseline, &known.state, &known.constancy, found, counts)
    });
    let remainder = known.as_ref().map(|known| {
        let causes = possible(experiment, fitted);
        Remainder {
            force: unknown_force(experiment, &known.state, &causes, floor, counts),
            ..established::remainder(baseline, &known.state, floor)
        }
    });
    let sentence = sentence(verdict, &list, &rivals, &beyond_doubt);
    let checked = gates.gained.as_ref().map_or("none", |gained| &gained.how).to_owned();
    let diagnosis = Diagnosis {
        suspects: Vec::new(),
        verdict,
        sentence,
        causes: if names { list.clone() } else { Vec::new() },
        alternatives: if verdict == Verdict::Ambiguous { rivals } else { Vec::new() },
        fitted: fitted.iter().map(|cause| cause.name().to_owned()).collect(),
        whiteness: gates.whiteness(before, describes, floor),
        noise_m: floor.measured_m(),
        noise: noise(experiment, floor),
        heldout: gates.gained.filter(|_| describes),
        detectable: detect::detectable(baseline, &found.first),
        next_experiments: Vec::new(),
        partial: if verdict == Verdict::Unexplained { list } else { Vec::new() },
        remainder,
        established: beyond_doubt,
        unknown: None,
        checked,
        complete: true,
        bent: if names { intervals::bent(baseline, &leader) } else { Vec::new() },
        residuals: residuals::residuals(baseline, &leader, floor),
        remarks,
    };
    (diagnosis, leader, known.map(|known| known.state))
}

const LEFT_OPEN: &str = "the held-out runs are missed by more than noise, by no more than the fit leaves its numbers open: fitted \
                         together with the others they are repeated";

const UNCHECKED: &str = "there was no time to check it";

/// What the gates have found.
struct Gates {
    /// Cost saved.
    explained: f64,
    count: usize,
    after: GoodnessOfFit,
    heldout: Option<GoodnessOfFit>,
    constancy: Vec<(ConstancyTest, Vec<PerRun>)>,
    gained: Option<HeldOut>,
    /// Whether held-out runs are noise only once the numbers have followed them.
    followed: bool,
}

impl Gates {
    /// `before`: fitness of the baseline.
    fn new(
        experiment: &Experiment,
        (baseline, before): (&State<'_>, GoodnessOfFit),
        leader: &State<'_>,
        floor: &Floor,
        counts: &mut Counts,
    ) -> Self {
        let mut more = counts.apart();
        let (heldout, gained) = rayon::join(
            || heldout::goodness_of_fit(experiment, leader, floor, counts),
            || match leader.causes.is_empty() {
                true => None,
                false => gain::gain(experiment, baseline, leader, floor, &mut more),
            },
        );
        counts.add(&more);
        let after = if leader.causes.is_empty() { before } else { goodness_of_fit(leader, floor) };
        let mut gates = Self {
            explained: baseline.cost - leader.cost,
            count: baseline.count(),
            after,
            heldout,
            constancy: constancy(leader, baseline.parameters.len()),
            gained,
            followed: false,
        };
        // numbers that the fit leaves open may be anything elsewhere: that is no objection to the cause
        if !leader.causes.is_empty() && !gates.held_out_objections(leader, floor).is_empty() {
            let together = heldout::goodness_of_all(experiment, leader, floor, counts);
            if let Some(together) = together.filter(|fitness| !gates.beyond_noise(fitness, floor)) {
                gates.followed = true;
                gates.heldout = Some(together);
            }
        }
        gates
    }

    /// Whether residuals are noise; `describes`: after the description too, not `before` alone.
    fn whiteness(&self, before: GoodnessOfFit, describes: bool, floor: &Floor) -> Whiteness {
        let tests = self.constancy.iter().filter(|_| describes);
        Whiteness {
            before,
            after: if describes { self.after } else { before },
            heldout: self.heldout,
            explainable: (1.0 - (floor.measured_m() / before.rms_m).powi(2)).clamp(0.0, 1.0),
            constancy: tests.map(|(test, _)| test.clone()).collect(),
        }
    }

    fn beyond_noise(&self, fitness: &GoodnessOfFit, floor: &Floor) -> bool {
        fitness.objects(self.explained, floor, self.count)
    }

    /// Why `leader` is no description of a cause.
    fn objections(&self, leader: &State<'_>, found: &Found<'_>, floor: &Floor) -> Vec<String> {
        let mut list = Vec::new();
        if self.beyond_noise(&self.after, floor) {
            list.push(is_no_noise(&self.after));
        }
        for (test, _) in &self.constancy {
            // a small cause beside a large one drifts as what the large one leaves does: it is asked for what it explains itself
            let cause = test.parameter.split('/').next().unwrap_or_default();
            let own = found.without(leader, cause).map(|without| without.cost - leader.cost);
            if test.objects(own.unwrap_or(self.explained).min(self.explained)) {
                list.push(format!(
                    "{} differs from run to run: chi-square {:.0} with {} degrees of freedom",
                    test.parameter, test.chi2, test.degrees
                ));
            }
        }
        if !self.followed {
            list.extend(self.held_out_objections(leader, floor));
            list.extend(self.gained.as_ref().filter(|_| is_told(leader)).and_then(HeldOut::none_perhaps));
        }
        list
    }

    /// What the held-out runs say against `leader`, its numbers frozen.
    fn held_out_objections(&self, leader: &State<'_>, floor: &Floor) -> Vec<String> {
        let heldout = self.heldout.as_ref().filter(|fitness| self.beyond_noise(fitness, floor));
        let mut list: Vec<String> =
            heldout.map(|fitness| format!("on held-out runs {}", is_no_noise(fitness))).into_iter().collect();
        list.extend(
            self.gained.as_ref().filter(|_| is_told(leader)).and_then(|gained| gained.objection(floor)),
        );
        list
    }
}

/// Whether a run that `leader` was not fitted to should be predicted by it: what comes and goes within a run, as waves do, its first half
/// does not tell.
fn is_told(leader: &State<'_>) -> bool {
    leader.causes.iter().all(|term| term.by_run || term.free(&leader.model).own.is_empty())
}

fn is_no_noise(GoodnessOfFit { excess, z, .. }: &GoodnessOfFit) -> String {
    format!("what is left is no noise: {excess:.0} noise variances beyond it ({z:.0} standard deviations)")
}

/// The other elements that `term`, a cause of `leader`, could as well sit in.
fn doubts(term: &candidates::Term, leader: &State<'_>, found: &Found<'_>) -> Vec<String> {
    let same =
        |state: &&State<'_>| sets(state) == sets(leader) && state.bic() - leader.bic() <= AS_GOOD_DELTA_BIC;
    let other = |state: &State<'_>| {
        let own = state.causes.iter().find(|other| other.cause == term.cause)?;
        own.element().filter(|element| term.element() != Some(element)).map(str::to_owned)
    };
    found.elsewhere.iter().filter(same).filter_map(other).collect()
}

fn place_unknown(term: &candidates::Term, leader: &State<'_>, found: &Found<'_>) -> Option<String> {
    let own = term.element()?;
    let others = doubts(term, leader, found);
    let name = term.info().name;
    (!others.is_empty()).then(|| format!("{name} sits in {own}, or as well in {}", others.join(" or ")))
}

/// The causes of `leader` with their values.
fn named(
    experiment: &Experiment,
    baseline: &State<'_>,
    leader: &State<'_>,
    tests: &[(ConstancyTest, Vec<PerRun>)],
    found: &Found<'_>,
    counts: &Counts,
) -> Vec<NamedCause> {
    let values = intervals::values(leader, baseline.parameters.len(), counts);
    let of = |name: &str, cause: &str| name.split('/').next() == Some(cause);
    let one = |term: &candidates::Term| {
        let info = term.info();
        let without = found.without(leader, info.name).unwrap_or(baseline);
        NamedCause {
            name: info.name.into(),
            by_run: term.by_run,
            element: term.element().filter(|_| doubts(term, leader, found).is_empty()).map(str::to_owned),
            sentence: info.sentence.into(),
            check: info.check.into(),
            formula: info.formula.into(),
            aliases: candidates::aliases(term.cause, experiment).into_iter().map(str::to_owned).collect(),
            parameters: values.iter().filter(|value| of(&value.name, info.name)).cloned().collect(),
            probability: None,
            form: None,
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

/// Where the noise floor comes from.
pub(super) fn noise(experiment: &Experiment, floor: &Floor) -> NoiseFloor {
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

fn sentence(
    verdict: Verdict,
    list: &[NamedCause],
    rivals: &[Alternative],
    established: &[NamedCause],
) -> String {
    let how = |cause: &NamedCause| if cause.by_run { ", differently in each run" } else { "" };
    let of = |cause: &NamedCause| match &cause.element {
        Some(element) => format!("{}, at {element} alone{} ({})", cause.sentence, how(cause), cause.label()),
        None => format!("{}{} ({})", cause.sentence, how(cause), cause.name),
    };
    let said: Vec<String> = list.iter().map(of).collect();
    match verdict {
        Verdict::NothingDetectable => {
            "Nothing detectable: what the simulation leaves of the runs is noise.".to_owned()
        }
        Verdict::Suspected => {
            format!("Most likely, though no other run has checked it: {}.", said.join("; and "))
        }
        Verdict::Cause | Verdict::Causes => capital(&format!("{}.", said.join("; and "))),
        Verdict::Ambiguous => {
            let others: Vec<String> = rivals.iter().map(|rival| rival.names.join(" + ")).collect();
            format!(
                "{}, or as well: {}. These runs cannot tell.",
                capital(&said.join("; and ")),
                others.join("; or ")
            )
        }
        Verdict::Unexplained => {
            let known: Vec<String> = established.iter().map(of).collect();
            let beyond_doubt = match known.is_empty() {
                true => String::new(),
                false => format!(" Beyond doubt: {}.", known.join("; and ")),
            };
            format!("Something is wrong that no known cause explains.{beyond_doubt}")
        }
    }
}

pub(super) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
