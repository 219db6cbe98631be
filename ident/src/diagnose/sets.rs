//! Sets of causes: which there may be, and when one is better than another.

use sim::Cause;

use crate::experiment::{DiagnoseConfig, Experiment, Use};
use crate::fit::counts::Counts;
use crate::hypothesis::candidates::{self, Term, possible};
use crate::hypothesis::score::Scores;
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;
use ground::statistics::chi2_survival;

/// A set of causes is better when its BIC is lower by more than this: odds of 150 to 1.
pub(super) const BETTER_DELTA_BIC: f64 = 10.0;
/// Chance that any of all candidates looks this good where nothing is.
const FALSE_ALARM_P: f64 = 1e-4;
/// Causes in a set, a choice: each further one costs a stage of refits.
pub(super) const MOST_CAUSES: usize = 3;
/// Causes refitted in full at each stage, a choice: each costs a descent.
pub(super) const SHORT_LIST: usize = 5;
/// A further cause saves at least this share of the cost that the causes before it have saved: what is less is how these are
/// modelled.
pub(super) const FURTHER_CAUSE_SHARE: f64 = 0.01;
/// Cost saved an observation, in noise variances, below which a cause is there but does not matter: a twentieth of the noise's
/// standard deviation.
const NEGLIGIBLE_VARIANCES: f64 = 0.0025;
/// Root mean square of a coordinate below which nothing matters, however certain \[m\], where nobody says what pictures get wrong
/// with the pose: that may be a tenth of a pixel.
pub(super) const NEGLIGIBLE_M: f64 = 2e-5;
/// A cause that explains so much cost has bent the baseline so far that what bent it may not be what it points to.
pub(super) const FAR_BENT_COST: f64 = 2000.0;
/// A set that explains more than that is beyond doubt where every other one is behind by as much and by this share of it.
const FAR_BEHIND_SHARE: f64 = 0.1;
/// Nothing is beyond doubt that leaves more than this of each observation, in noise variances: what explains the rest may
/// explain it all.
const WELL_EXPLAINED_VARIANCES: f64 = 3.0;

/// The cost below which something may be there but does not matter, in `count` observations with the noise of `floor`.
pub(super) fn negligible(floor: &Floor, count: usize) -> f64 {
    // what follows the pose, where it is known, has left the cost already
    let pictures = if floor.pose_std_m.is_some() { 0.0 } else { NEGLIGIBLE_M / floor.noise_m };
    NEGLIGIBLE_VARIANCES.max(pictures.powi(2)) * count as f64
}

/// What was found.
#[derive(Clone)]
pub(super) struct Found<'a> {
    /// Every set that was refitted, by BIC, the baseline among them.
    pub(super) tried: Vec<State<'a>>,
    /// The accepted one; the baseline where there is none.
    pub(super) leader: State<'a>,
    /// Scores of all candidates against the baseline.
    pub(super) first: Scores,
    /// The leader with one of its causes in another element each.
    pub(super) elsewhere: Vec<State<'a>>,
}

impl<'a> Found<'a> {
    /// The best set that was refitted of the causes of `state` but the one called `name`.
    pub(super) fn without(&self, state: &State<'_>, name: &str) -> Option<&State<'a>> {
        let rest: Vec<&str> = sets(state).into_iter().filter(|own| *own != name).collect();
        self.tried.iter().find(|state| sets(state) == rest)
    }

    /// Whether the leader is beyond doubt: it explains very much, leaves little, and nothing else comes near.
    pub(super) fn is_clear(&self, baseline: &State<'_>) -> bool {
        let leader = sets(&self.leader);
        let far = FAR_BENT_COST.max(FAR_BEHIND_SHARE * (baseline.cost - self.leader.cost));
        let holds_leader = |state: &State<'_>| leader.iter().all(|name| sets(state).contains(name));
        let mut others = self.tried.iter().filter(|state| !holds_leader(state));
        let explained = self.leader.cost < WELL_EXPLAINED_VARIANCES * self.leader.count() as f64;
        !leader.is_empty() && explained && others.all(|other| other.bic() - self.leader.bic() > far)
    }
}

/// The candidates and what they may be combined with.
pub(super) struct Search<'b> {
    pub(super) experiment: &'b Experiment,
    candidates: Vec<Term>,
    pub(super) counts: Counts,
    /// The noise.
    pub(super) floor: Floor,
    /// Sets to which every candidate was tried to be added.
    pub(super) expanded: Vec<Vec<&'static str>>,
    /// The causes that lead.
    pub(super) leading: Vec<&'static str>,
    stage: &'b mut dyn FnMut(&str) -> bool,
}

impl<'b> Search<'b> {
    pub(super) fn new(
        experiment: &'b Experiment,
        fitted: &[Cause],
        floor: &Floor,
        counts: Counts,
        stage: &'b mut dyn FnMut(&str) -> bool,
    ) -> Self {
        let DiagnoseConfig { odds, prior, elements, .. } = &experiment.diagnose;
        let fitted_runs = || experiment.runs.iter().filter(|run| run.usage == Use::Fit);
        let span_s: f64 = fitted_runs()
            .filter_map(|run| Some(run.trajectory.time_s.last()? - run.trajectory.time_s.first()?))
            .sum();
        // where hidden numbers are chosen among many, each is as much less likely
        let odds =
            |cause: Cause| odds.get(cause.name()).map_or(1.0, |odds| odds.get()) / cause.starts(span_s);
        let runs = fitted_runs().count();
        let all = |cause: Cause| {
            Term::knowing(Term::all(cause, &experiment.model, runs, odds(cause), elements), prior)
        };
        let candidates = possible(experiment, fitted).into_iter().flat_map(all).collect();
        let (expanded, leading) = (Vec::new(), Vec::new());
        Self { experiment, candidates, counts, floor: floor.clone(), expanded, leading, stage }
    }

    /// Tells the observer what is done now, beside what leads so far. Whoever has had enough ends the search with what it has.
    pub(super) fn says(&mut self, stage: &str) {
        let so_far = match self.leading.is_empty() {
            true => String::new(),
            false => format!("; so far: {}", self.leading.join(" + ")),
        };
        if !(self.stage)(&format!("{stage}{so_far}")) {
            self.counts.stop();
        }
    }

    /// Whether it was ended before its end.
    pub(super) fn is_cut(&self) -> bool {
        self.counts.is_stopped()
    }

    /// Candidates that may join `state`.
    pub(super) fn open(&self, state: &State<'_>) -> Vec<Term> {
        let taken = |term: &&Term| state.causes.iter().any(|own| self.is_same(own, term));
        self.candidates.iter().filter(|term| !taken(term)).cloned().collect()
    }

    pub(super) fn score(&mut self, state: &State<'_>) -> Scores {
        let open = self.open(state);
        self.counts.rollouts += (open.len() * state.terms.len()) as u64;
        Scores::new(state, &open, &self.counts)
    }

    /// Whether `better` is so much better than `worse` that it is no chance.
    pub(super) fn accepts(&self, worse: &State<'_>, better: &State<'_>) -> bool {
        let gain = worse.cost - better.cost;
        let numbers = better.added.saturating_sub(worse.added).max(1);
        // in which element a cause sits is a choice of its own, which `choice_cost` counts
        let causes = self.candidates.iter().filter(|term| !term.is_choice()).count() as f64;
        let places = (0.5 * (better.choice_cost() - worse.choice_cost())).exp().max(1.0);
        let chance = chi2_survival(gain, numbers as f64) * causes * places;
        worse.bic() - better.bic() > BETTER_DELTA_BIC
            && chance < FALSE_ALARM_P
            && gain > negligible(&self.floor, better.count())
            && self.exceeds_pictures(worse, better)
    }

    /// Whether what `better` explains beyond `worse` is larger than what pictures get wrong with the pose: this may be alike in all
    /// poses, a scale or a shift by a hundredth of a pixel.
    fn exceeds_pictures(&self, worse: &State<'_>, better: &State<'_>) -> bool {
        let Some(pose_std_m) = self.floor.pose_std_m else { return true };
        let squares = |state: &State<'_>| -> Option<f64> {
            let runs = (0..state.terms.len()).map(|run| state.raw_residuals(run));
            runs.map(|raw| Some(raw?.iter().map(|x| x * x).sum::<f64>())).sum()
        };
        let explained = squares(worse).zip(squares(better)).map(|(worse, better)| worse - better);
        explained.is_some_and(|squares| squares > pose_std_m.powi(2) * better.count() as f64)
    }

    /// Whether `better` is so much better than `worse`, with fewer causes, that it is neither chance nor how those are modelled.
    pub(super) fn needs(&self, baseline: &State<'_>, worse: &State<'_>, better: &State<'_>) -> bool {
        self.accepts(worse, better)
            && worse.cost - better.cost >= FURTHER_CAUSE_SHARE * (baseline.cost - worse.cost)
    }

    /// Whether two candidates are of one cause, or of aliases.
    pub(super) fn is_same(&self, one: &Term, other: &Term) -> bool {
        one.cause == other.cause
            || candidates::aliases(one.cause, self.experiment).contains(&other.cause.name())
    }
}

/// Names of the causes of `state`, sorted.
pub(super) fn sets(state: &State<'_>) -> Vec<&'static str> {
    names(&state.causes)
}

/// Names of `causes`, sorted.
pub(super) fn names(causes: &[Term]) -> Vec<&'static str> {
    let mut names: Vec<&'static str> = causes.iter().map(|term| term.cause.name()).collect();
    names.sort_unstable();
    names
}
