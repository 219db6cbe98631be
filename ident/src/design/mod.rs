//! The next runs: which of the possible ones would separate rival causes best, or determine loose parameters best.
//!
//! Every candidate run ([`runs`]) is simulated with the fitted model, and its derivatives join those of the runs that
//! there are. Two rivals are as far apart as the cost by which one, at the size that was fitted, exceeds what the
//! fitted coefficients, the starts of the runs and the other rival can imitate; of both directions the smaller counts
//! (T-optimality); a cause that nothing has checked yet is to show as far as it can. For loose parameters what counts is the standard
//! deviation that the run leaves.
//!
//! # Source
//! A. C. Atkinson, V. V. Fedorov, "The design of experiments for discriminating between two rival models", Biometrika 62
//! (1975) 57-70.

pub mod runs;

use nalgebra::DMatrix;
use rayon::prelude::*;

use crate::experiment::{Experiment, Run};
use crate::fit::counts::Counts;
use crate::fit::problem::Term;
use crate::hypothesis::candidates::Term as CauseTerm;
use crate::hypothesis::nuisances::covariance;
use crate::hypothesis::score::Scores;
use crate::hypothesis::state::State;
use crate::initial::Estimate;
use crate::loss::{Weighting, observations};
use crate::noise::floor::{Floor, RunFloor};
use crate::simulate::Rehearsal;
use runs::Proposal;

/// A proposed run and what it would add.
#[derive(Debug, Clone, PartialEq)]
pub struct Worth {
    /// The proposed run.
    pub proposal: Proposal,
    /// Cost by which the rivals differ with the runs there are; of a loose parameter, its standard deviation.
    pub before: f64,
    /// The same with this run added.
    pub after: f64,
}

/// A cause with the values of its parameters, by name.
pub(crate) type Sized = (CauseTerm, Vec<(String, f64)>);

/// Runs that separate two rivals, best first; or in which `causes`, all of which are at work, show most, where there is no `rival`. `state` is
/// the baseline; `counts` says whether anybody waits for them.
pub(crate) fn separating(
    experiment: &Experiment,
    state: &State<'_>,
    floor: &Floor,
    counts: &Counts,
    (causes, rival): (&[Sized], Option<&Sized>),
) -> Vec<Worth> {
    let all: Vec<&Sized> = causes.iter().chain(rival).collect();
    let terms: Vec<CauseTerm> = all.iter().map(|(term, _)| term.clone()).collect();
    let sizes: Vec<&[(String, f64)]> = all.iter().map(|(_, sizes)| sizes.as_slice()).collect();
    let cause_places: Vec<usize> = (0..causes.len()).collect();
    let rival_places: Vec<usize> = rival.map(|_| causes.len()).into_iter().collect();
    let separation = |state: &State<'_>| {
        let scores = Scores::new(state, &terms, counts);
        let cost = distinct_cost(&scores, &sizes, &cause_places, &rival_places);
        if rival_places.is_empty() {
            return cost;
        }
        cost.min(distinct_cost(&scores, &sizes, &rival_places, &cause_places))
    };
    // coefficients that a bound stops in these runs may leave it in the next: without residuals none is stopped
    let mut state = state.clone();
    state.linear.iter_mut().for_each(|linear| linear.residuals.fill(0.0));
    let before = separation(&state);
    let one = |proposal: Proposal| {
        let run = proposal.run(experiment);
        let after = separation(&with_run(experiment, &state, floor, &proposal, &run, counts)?);
        Some(Worth { proposal, before, after })
    };
    let mut list: Vec<Worth> = runs::proposals(experiment, floor).into_par_iter().filter_map(one).collect();
    list.sort_by(|a, b| b.after.total_cmp(&a.after));
    list
}

/// A proposed run and the uncertainty of several parameters that it would leave.
#[derive(Debug, Clone, PartialEq)]
pub struct Prospect {
    /// The proposed run.
    pub proposal: Proposal,
    /// Standard deviation of each, in its SI unit.
    pub std: Vec<f64>,
}

/// How well the parameters of `state` at the places `which` are known, and how well each run that could be made would let them be
/// known; `None` where the runs there are leave everything open.
pub(crate) fn pinning(
    experiment: &Experiment,
    state: &State<'_>,
    floor: &Floor,
    which: &[usize],
    counts: &Counts,
) -> Option<(Vec<f64>, Vec<Prospect>)> {
    let std = |state: &State<'_>| -> Option<Vec<f64>> {
        let covariance = covariance(state)?;
        Some(which.iter().map(|&place| covariance[(place, place)].sqrt()).collect())
    };
    let before = std(state)?;
    let one = |proposal: Proposal| {
        let run = proposal.run(experiment);
        let std = std(&with_run(experiment, state, floor, &proposal, &run, counts)?)?;
        Some(Prospect { proposal, std })
    };
    Some((before, runs::proposals(experiment, floor).into_par_iter().filter_map(one).collect()))
}

/// `state` with a run that has not been made; its residuals are 0. `None` where it cannot be simulated.
fn with_run<'b>(
    experiment: &Experiment,
    state: &State<'b>,
    floor: &Floor,
    proposal: &Proposal,
    run: &'b Run,
    counts: &Counts,
) -> Option<State<'b>> {
    if counts.is_stopped() {
        return None;
    }
    let model = state.calibrated();
    let estimate = Estimate { start: proposal.start(experiment), release: None };
    let weighting = Weighting { noise_m: floor.noise_m, use_stated: false, run_weight: 1.0 };
    let list = observations(&run.trajectory, weighting, |_| true);
    let mut alone = State { linear: Vec::new(), ..state.clone() };
    alone.terms = vec![Term::new(Rehearsal::new(&model, run, estimate, floor.noise_m), list)];
    alone.point.offsets = vec![vec![0.0; alone.terms[0].rehearsal.nuisances.len()]];
    let interval_s = floor.runs.first().map_or(0.01, |run| run.interval_s);
    let std_m = vec![floor.noise_m; run.trajectory.keypoints.len()];
    let run_floor = Floor { runs: vec![RunFloor { id: run.id.clone(), std_m, interval_s }], ..floor.clone() };
    alone.weigh(&run_floor);
    let mut linear = alone.problem().linearise(&alone.point, true, &mut counts.apart())?;
    linear.iter_mut().for_each(|linear| linear.residuals.fill(0.0));
    let mut with = state.clone();
    with.terms.append(&mut alone.terms);
    with.point.offsets.append(&mut alone.point.offsets);
    with.linear.append(&mut linear);
    Some(with)
}

/// Cost of the part of the effect of the candidates at `places`, with parameters of these `sizes`, that those at `others` cannot imitate.
fn distinct_cost(scores: &Scores, sizes: &[&[(String, f64)]], places: &[usize], others: &[usize]) -> f64 {
    let of = |candidates: &[usize]| -> Vec<usize> {
        (0..scores.columns.len()).filter(|&c| candidates.contains(&scores.columns[c].candidate)).collect()
    };
    let mut effect = DMatrix::zeros(scores.projected.nrows(), 1);
    for column in of(places) {
        let known = sizes[scores.columns[column].candidate];
        let size = known.iter().find(|(name, _)| *name == scores.columns[column].name);
        effect.column_mut(0).axpy(size.map_or(0.0, |(_, size)| *size), &scores.projected.column(column), 1.0);
    }
    let mut other = scores.projected.select_columns(&of(others));
    for mut column in other.column_iter_mut() {
        let norm = column.norm();
        column /= norm.max(f64::MIN_POSITIVE);
    }
    if other.ncols() > 0 {
        let basis = other.qr().q();
        let within = basis.tr_mul(&effect);
        effect.gemm(-1.0, &basis, &within, 1.0);
    }
    effect.norm_squared()
}
