//! Other sets of causes that explain the runs about as well as the leader.

use sim::Cause;

use super::candidates;
use super::result::Alternative;
use super::search::{BETTER, Found, sets};
use super::state::State;
use crate::experiment::Experiment;
use crate::fit::counts::Counts;

/// A number this near to a bound, as a share of their distance, is at it.
const AT_BOUND: f64 = 0.02;

/// Another set of causes that explains the runs.
pub(super) struct Rival {
    pub(super) set: Alternative,
    /// How much worse than the leader's its BIC is.
    pub(super) behind: f64,
}

impl Rival {
    pub(super) fn remark(&self) -> String {
        format!(
            "{} describes these runs nearly as well: a BIC of {:.1} behind, odds of 1 to {:.0}",
            self.set.names.join(" + "),
            self.behind,
            (0.5 * self.behind).exp()
        )
    }
}

/// Other sets of causes within reach of the leader's BIC.
pub(super) fn rivals(experiment: &Experiment, found: &Found<'_>) -> Vec<Rival> {
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
    let explained = baseline.cost - found.leader.cost;
    let mut list: Vec<Rival> = Vec::new();
    for state in &found.tried {
        let names = sets(state);
        let theirs = class(&names);
        let wider = own.iter().all(|name| theirs.contains(name));
        let known =
            list.iter().any(|other| other.set.names.iter().map(String::as_str).eq(names.iter().copied()));
        // two numbers of a faint cause may pass for one of another
        let per_size = state.ln_count().min(faint(explained / state.added.max(1) as f64));
        let behind = behind(state, &found.leader, per_size);
        if names.is_empty() || wider || known || behind > BETTER {
            continue;
        }
        let names = names.into_iter().map(str::to_owned).collect();
        list.push(Rival { set: Alternative { names, delta_bic: baseline.bic() - state.bic() }, behind });
    }
    list
}

/// Puts another set of as many causes at the head of `found`, if one is ahead of its leader: the BIC, by which sets are sought,
/// is hard on hidden numbers.
pub(super) fn lead(found: &mut Found<'_>, counts: &mut Counts) {
    let leader = &found.leader;
    let rivals = found.tried.iter().filter(|state| state.causes.len() == leader.causes.len());
    let pairs = rivals.map(|rival| (behind(rival, leader, leader.ln_count()), rival));
    let ahead = pairs.filter(|(behind, _)| *behind < 0.0).min_by(|a, b| a.0.total_cmp(&b.0));
    let Some(mut rival) = ahead.map(|(_, rival)| rival.clone()) else { return };
    if rival.descend(counts) {
        found.leader = rival;
    }
}

/// What a number costs that saves this much: less than the BIC has it cost, which expects numbers that a single observation shows.
///
/// # Source
/// E. I. George, D. P. Foster, "Calibration and empirical Bayes variable selection", Biometrika 87 (2000) 731-747.
fn faint(saved: f64) -> f64 {
    1.0 + saved.max(1.0).ln()
}

/// How much worse `rival` is than `leader`, as a BIC. Of the numbers that one has more than the other each hidden one (where a tether
/// is fixed, where a stop begins) costs what one does that saves as much as it saves beside the other set: the BIC would have a
/// far tether for an offset. A size costs the rival `per_size`. A hidden number at a bound makes the rival another
/// cause, and costs it the BIC's whole.
fn behind(rival: &State<'_>, leader: &State<'_>, per_size: f64) -> f64 {
    let of_hidden = |state: &State<'_>| state.causes.iter().map(|term| term.hidden.len()).sum::<usize>();
    let saved = leader.cost - rival.cost;
    let all = rival.added as f64 - leader.added as f64;
    let hidden = of_hidden(rival) as f64 - of_hidden(leader) as f64;
    let (sizes, hidden) = match all - hidden {
        // hidden numbers of the one against sizes of the other: what counts is how many are left over
        sizes if sizes * hidden < 0.0 && all * hidden > 0.0 => (0.0, all),
        sizes if sizes * hidden < 0.0 => (all, 0.0),
        sizes => (sizes, hidden),
    };
    let whole = leader.ln_count();
    let a_size = if sizes > 0.0 { per_size } else { whole };
    let charge = match holds_bound(rival) {
        true => all * whole,
        false if hidden == 0.0 => sizes * a_size,
        false => sizes * a_size + hidden * faint(saved / hidden),
    };
    charge - saved
}

/// Whether a hidden number of a cause of `state` is at a bound.
fn holds_bound(state: &State<'_>) -> bool {
    state.causes.iter().flat_map(|term| &term.hidden).any(|(name, _)| {
        let place = state.parameters.free.iter().position(|parameter| parameter.name() == name);
        place.is_some_and(|place| {
            let (scale, value) = (&state.parameters.free[place].scale, state.point.values[place]);
            let near = AT_BOUND * scale.width();
            value - scale.lower() <= near || scale.upper() - value <= near
        })
    })
}
