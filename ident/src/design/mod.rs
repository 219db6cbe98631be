//! The next runs: which of those that could be made would tell rival causes apart, or pin down what is loose.
//!
//! Every candidate run ([`runs`]) is simulated with the fitted model, and its derivatives join those of the runs that
//! there are. Two rivals are as far apart as the cost by which one, at the size that was fitted, exceeds what the
//! fitted coefficients, the starts of the runs and the other rival can imitate; of both directions the smaller counts
//! (T-optimality). For loose parameters what counts is the variance that the run takes away (A-optimality).
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

/// What a proposed run is worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Worth {
    /// The run.
    pub proposal: Proposal,
    /// Cost by which the rivals differ with the runs there are; of a loose parameter, its standard deviation.
    pub before: f64,
    /// And with this run as well.
    pub after: f64,
}

/// Runs that separate two rivals with these sizes of their numbers, best first. `state` is the baseline; `counts` says whether
/// anybody waits for them.
pub(crate) fn separating(
    experiment: &Experiment,
    state: &State<'_>,
    floor: &Floor,
    counts: &Counts,
    rivals: [&(CauseTerm, Vec<(String, f64)>); 2],
) -> Vec<Worth> {
    let proposals = runs::proposals(experiment, floor);
    let terms = [rivals[0].0.clone(), rivals[1].0.clone()];
    let sizes = [&rivals[0].1, &rivals[1].1];
    // coefficients that a bound stops in these runs may leave it in the next: without residuals none is stopped
    let mut state = state.clone();
    state.linear.iter_mut().for_each(|linear| linear.residuals.fill(0.0));
    let before = separation(&Scores::new(&state, &terms, counts), sizes);
    let one = |proposal: &Proposal| {
        let run = proposal.run(experiment);
        let with = joined(experiment, &state, floor, proposal, &run, counts)?;
        let after = separation(&Scores::new(&with, &terms, counts), sizes);
        Some(Worth { proposal: proposal.clone(), before, after })
    };
    ranked(proposals.par_iter().filter_map(one).collect(), |worth| -worth.after)
}

/// Runs that pin down the fitted parameter called `name`, best first.
pub(crate) fn pinning(
    experiment: &Experiment,
    state: &State<'_>,
    floor: &Floor,
    name: &str,
    counts: &Counts,
) -> Vec<Worth> {
    let Some(which) = state.parameters.free.iter().position(|p| p.names.iter().any(|n| n == name)) else {
        return Vec::new();
    };
    let std = |state: &State<'_>| covariance(state).map(|covariance| covariance[(which, which)].sqrt());
    let Some(before) = std(state) else { return Vec::new() };
    let one = |proposal: &Proposal| {
        let run = proposal.run(experiment);
        let after = std(&joined(experiment, state, floor, proposal, &run, counts)?)?;
        Some(Worth { proposal: proposal.clone(), before, after })
    };
    ranked(runs::proposals(experiment, floor).par_iter().filter_map(one).collect(), |worth| worth.after)
}

fn ranked(mut list: Vec<Worth>, by: impl Fn(&Worth) -> f64) -> Vec<Worth> {
    list.sort_by(|a, b| by(a).total_cmp(&by(b)));
    list
}

/// `state` with a run that has not been made; its residuals are 0. `None` where it cannot be simulated.
fn joined<'b>(
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
    let own = Floor { runs: vec![RunFloor { id: run.id.clone(), std_m, interval_s }], ..floor.clone() };
    alone.weigh(&own);
    let mut linear = alone.problem().linearise(&alone.point, true, &mut counts.apart())?;
    linear.iter_mut().for_each(|linear| linear.residuals.fill(0.0));
    let mut with = state.clone();
    with.terms.append(&mut alone.terms);
    with.point.offsets.append(&mut alone.point.offsets);
    with.linear.append(&mut linear);
    Some(with)
}

/// How far apart two rivals are: the smaller of what either has that the other cannot imitate.
fn separation(scores: &Scores, sizes: [&Vec<(String, f64)>; 2]) -> f64 {
    let own = |candidate: usize| -> Vec<usize> {
        (0..scores.columns.len()).filter(|&c| scores.columns[c].candidate == candidate).collect()
    };
    let beyond = |a: usize, b: usize| {
        let columns = own(a);
        let mut effect = DMatrix::zeros(scores.projected.nrows(), 1);
        for &column in &columns {
            let size = sizes[a].iter().find(|(name, _)| *name == scores.columns[column].name);
            let size = size.map_or(0.0, |(_, size)| *size);
            effect.column_mut(0).axpy(size, &scores.projected.column(column), 1.0);
        }
        let mut other = scores.projected.select_columns(&own(b));
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
    };
    beyond(0, 1).min(beyond(1, 0))
}
