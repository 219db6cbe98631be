//! Sets of causes that explain the runs about as well as each other.
//!
//! The held-out runs are asked as well: by how much more probable one set had them than another is as good an evidence as the
//! fitted ones, and no number follows it.

use sim::Cause;

use super::gates::goodness_of_fit;
use super::heldout;
use super::result::Alternative;
use super::sets::{BETTER_DELTA_BIC, Found, sets};
use crate::experiment::Experiment;
use crate::fit::counts::Counts;
use crate::hypothesis::candidates;
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;

/// A hidden number this near to a bound, as a share of the bounds' width, has run into it: the least cost is beyond.
const HIDDEN_AT_BOUND_SHARE: f64 = 0.02;

/// Sets that the search, by the BIC, has no further behind than this are gone into: twice what they may be
/// behind in the end, as held-out runs may still move them.
const NEAR_RIVAL_DELTA_BIC: f64 = 2.0 * BETTER_DELTA_BIC;

/// What a number costs that one of two sets has more, where they come near each other. The BIC's ln n expects numbers that a single
/// observation shows: it would have a tether for an offset, which is a tether fixed far away, and one number of another cause for two
/// of a faint one.
///
/// # Source
/// H. Akaike, "A new look at the statistical model identification", IEEE Transactions on Automatic Control 19 (1974) 716-723.
const NUMBER_AIC_COST: f64 = 2.0;

/// Another set of causes that explains the runs.
pub(super) struct Rival {
    pub(super) set: Alternative,
    /// How much worse than the leader's its BIC is, with what held-out runs say.
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

/// How the sets nearest to the leader compare with it.
#[derive(Default)]
pub(super) struct Contest<'a> {
    /// Other sets within reach of the leader, nearest first.
    pub(super) rivals: Vec<Rival>,
    /// What had led by the fitted runs alone, where it no longer does.
    pub(super) overtaken: Option<State<'a>>,
}

/// A set of causes that may lead.
struct Contender<'a> {
    state: State<'a>,
    /// [`heldout::deviance`].
    heldout: Option<f64>,
}

/// Decides which of the sets near the leader of `found` leads, and says which others are within reach of it.
pub(super) fn contest<'a>(
    experiment: &'a Experiment,
    found: &mut Found<'a>,
    floor: &Floor,
    counts: &mut Counts,
) -> Contest<'a> {
    let Some(baseline) = found.tried.iter().find(|state| state.causes.is_empty()) else {
        return Contest::default();
    };
    let (cost, bic, count) = (baseline.cost, baseline.bic(), baseline.count());
    // what is nearly as good as what leaves too much leaves as much
    if goodness_of_fit(&found.leader, floor).objects(cost - found.leader.cost, floor, count) {
        return Contest::default();
    }
    let mut states = vec![found.leader.clone()];
    for state in found.tried.iter().filter(|state| !state.causes.is_empty()) {
        let known = states.iter().any(|other| sets(other) == sets(state));
        let near = behind(state, &found.leader, found.leader.ln_count()) <= NEAR_RIVAL_DELTA_BIC;
        if near && !known && !is_wider(state, &found.leader, experiment) {
            states.push(state.clone());
        }
    }
    if states.len() == 1 {
        return Contest::default();
    }
    let contenders = counts.of_each(states, |state, counts| gone_into(experiment, state, floor, counts));
    let by_heldout = |rival: &Contender<'_>, leader: &Contender<'_>| {
        rival.heldout.zip(leader.heldout).map_or(0.0, |(rival, leader)| rival - leader)
    };
    // the BIC, by which sets are sought, is hard on hidden numbers, and knows of the fitted runs alone
    let first = &contenders[0];
    let as_many = contenders.iter().filter(|other| other.state.causes.len() == first.state.causes.len());
    let whole = first.state.ln_count();
    let ahead =
        as_many.map(|other| (behind(&other.state, &first.state, whole) + by_heldout(other, first), other));
    let leader = ahead.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(first, |(_, other)| other);
    let mut rivals: Vec<Rival> = Vec::new();
    for other in contenders.iter().filter(|other| !is_wider(&other.state, &leader.state, experiment)) {
        let by_fitted = behind(&other.state, &leader.state, NUMBER_AIC_COST);
        let behind = by_fitted + by_heldout(other, leader);
        if behind <= BETTER_DELTA_BIC {
            let names = sets(&other.state).into_iter().map(str::to_owned).collect();
            rivals.push(Rival {
                set: Alternative { names, probability: None, delta_bic: bic - other.state.bic() },
                behind,
            });
        }
    }
    rivals.sort_by(|a, b| a.behind.total_cmp(&b.behind));
    let overtaken = (sets(&leader.state) != sets(&first.state)).then(|| first.state.clone());
    found.leader = leader.state.clone();
    for contender in contenders {
        let names = sets(&contender.state);
        found.tried.retain(|state| sets(state) != names);
        found.tried.push(contender.state);
    }
    found.tried.sort_by(|a, b| a.bic().total_cmp(&b.bic()));
    Contest { rivals, overtaken }
}

/// Whether the causes of `state` hold those of `leader`, which cannot be told from their aliases.
pub(super) fn is_wider(state: &State<'_>, leader: &State<'_>, experiment: &Experiment) -> bool {
    let class = |state: &State<'_>| -> Vec<&'static str> {
        let of = |name: &'static str| {
            let aliases = name.parse().map(|cause: Cause| candidates::aliases(cause, experiment));
            aliases.unwrap_or_default().into_iter().chain([name]).min().unwrap_or(name)
        };
        sets(state).into_iter().map(of).collect()
    };
    let theirs = class(state);
    class(leader).iter().all(|name| theirs.contains(name))
}

/// `state` at its optimum, and what held-out runs say of it.
fn gone_into<'a>(
    experiment: &'a Experiment,
    mut state: State<'a>,
    floor: &Floor,
    counts: &mut Counts,
) -> Contender<'a> {
    let known = state.clone();
    if !state.descend(counts) {
        state = known;
    }
    let heldout = heldout::deviance(experiment, &state, floor, counts);
    Contender { state, heldout }
}

/// How much worse `rival` is than `leader`, as a BIC, but that of numbers that one has more than the other a hidden one (where a
/// tether is fixed, where a stop begins) costs [`NUMBER_AIC_COST`], and a size the rival `per_size`. A hidden number at a bound makes the
/// rival another cause, and costs it the BIC's whole.
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
    let charge = match stands_in(rival) {
        true => all * whole,
        false => sizes * a_size + hidden * NUMBER_AIC_COST,
    };
    charge + rival.choice_cost() - leader.choice_cost() - saved
}

/// Whether a hidden number of a cause of `state` is at a bound.
pub(super) fn stands_in(state: &State<'_>) -> bool {
    state.causes.iter().flat_map(|term| &term.hidden).any(|(name, _)| holds_bound(state, name))
}

/// Whether the number of `state` called `name` is at a bound.
pub(super) fn holds_bound(state: &State<'_>, name: &str) -> bool {
    let place = state.parameters.free.iter().position(|parameter| parameter.name() == name);
    place.is_some_and(|place| {
        let (scale, value) = (&state.parameters.free[place].scale, state.point.values[place]);
        let near = HIDDEN_AT_BOUND_SHARE * scale.width();
        value - scale.lower() <= near || scale.upper() - value <= near
    })
}
