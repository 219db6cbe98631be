//! Takes a fit through its stages: a descent; or a search; or, as long as more than the noise is left, a descent with
//! loose joints, one from the model's own values, a search, and descents from several starts.

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardUniform};

use super::checkpoint::{Checkpoint, Ended, Flow, INTERRUPTED, Observer, Origin, Progress, Stage};
use super::counts::Counts;
use super::error::FitError;
use super::least_squares::{Descent, End, Freedom};
use super::objective::Objective;
use super::problem::{Linear, Point};
use super::search::{Search, fit_starts};
use crate::cmaes::Restarts;
use crate::config::Method;
use crate::experiment::Experiment;
use crate::parameters::FreeParameter;

/// Candidates of the global search of `hybrid`, per parameter (chosen): enough to leave a bad optimum, no more.
const SEARCH_EVALUATIONS_PER_PARAMETER: u64 = 20;
/// Random points drawn per parameter, of which the best become starts (chosen).
const DRAWN_POINTS_PER_PARAMETER: usize = 8;
/// How many of the drawn points become starts (chosen).
const DRAWN_STARTS: usize = 1;
/// Cost over that of noise alone, up to which no other optimum is looked for (chosen).
const NOISE_COST_RATIO_MAX: f64 = 1.1;

/// Takes a fit through its stages.
pub(super) struct Driver<'a> {
    experiment: &'a Experiment,
    objective: &'a Objective<'a>,
    /// The thinned objective that descents begin on and a search uses; `None`: all of it is done on the whole objective.
    rough: Option<&'a Objective<'a>>,
    fingerprint: String,
    /// Loss that corresponds to a cost of 1 \[m2\].
    loss_m2: f64,
    /// The cost that noise alone would leave.
    noise_cost: f64,
}

/// Where a fit has ended.
pub(super) struct Arrival {
    pub(super) point: Point,
    /// Whether it has been linearised already, so that its rollouts are counted.
    pub(super) linearised: bool,
    /// The linearisation there, or half a standard deviation away, where it is at hand.
    pub(super) linear: Option<Vec<Linear>>,
    pub(super) stop_reason: String,
    /// All descents of `hybrid`, the best among them; empty with other methods.
    pub(super) ended: Vec<Ended>,
}

impl<'a> Driver<'a> {
    /// `rough`: the thinned objective that descents begin on, if any; `fingerprint`: of the experiment.
    pub(super) fn new(
        experiment: &'a Experiment,
        objective: &'a Objective<'a>,
        rough: Option<&'a Objective<'a>>,
        fingerprint: String,
    ) -> Self {
        let terms = &objective.problem.terms;
        let images: f64 = terms.iter().map(|term| term.rehearsal.run.weight * term.instants as f64).sum();
        // Of weights that may differ from cell to cell, the mean.
        let precisions: f64 = terms
            .iter()
            .flat_map(|term| term.observations.iter().map(|o| o.per_m.powi(2) / term.rehearsal.run.weight))
            .sum();
        let observations: usize = terms.iter().map(|term| term.observations.len()).sum();
        let noise_cost =
            terms.iter().map(|term| term.rehearsal.run.weight * term.observations.len() as f64).sum();
        let loss_m2 = observations as f64 / precisions / images;
        Self { experiment, objective, rough, fingerprint, loss_m2, noise_cost }
    }

    /// The beginning of a fit: at `warm`, if there is one.
    pub(super) fn first(&self, warm: Option<Point>, counts: &mut Counts) -> Checkpoint {
        let (config, objective) = (&self.experiment.fit, self.objective);
        let mut waiting = Vec::new();
        let searches = matches!(config.method, Method::Paper | Method::CmaEs);
        let stage = if searches && config.max_evaluations > 0 && !objective.parameters().is_empty() {
            let restarts = if config.method == Method::CmaEs { config.restarts } else { Restarts::None };
            let start = objective.problem.start();
            let search = Search::new(objective, start, restarts, config.seed, config.max_evaluations, counts);
            Stage::Search(Box::new(search))
        } else {
            let start = objective.problem.start();
            let loose = (config.method == Method::Hybrid && config.max_evaluations > 0)
                .then(|| self.loosened(&start))
                .flatten();
            if loose.as_ref().is_some_and(|loose| loose.values != start.values) {
                waiting.push((Origin::Model, start.clone()));
            }
            let limit = config.max_evaluations;
            match (warm, loose) {
                // With nothing to turn, the starts of the runs are all there is to fit.
                _ if limit == 0 || objective.parameters().is_empty() => {
                    let (start, cost) = fit_starts(objective, start, counts);
                    self.descent(Origin::Model, Descent::new(start, cost), limit, counts)
                }
                (Some(warm), _) => Stage::Descent {
                    origin: Origin::Warm,
                    descent: Descent::new(warm, None),
                    limit,
                    rough: None,
                },
                (None, Some(loose)) => {
                    self.descent(Origin::Loose, Descent::with_loose_joints(loose), limit, counts)
                }
                (None, None) => self.descent(Origin::Model, Descent::new(start, None), limit, counts),
            }
        };
        let experiment = self.fingerprint.clone();
        Checkpoint { experiment, counts: counts.clone(), stage, ended: Vec::new(), waiting }
    }

    /// A descent that begins on the rough objective, if there is one, where it may use half of the evaluations up to `limit`.
    fn descent(&self, origin: Origin, descent: Descent, limit: u64, counts: &Counts) -> Stage {
        let rough = self.rough.filter(|_| limit > 0 && !self.objective.parameters().is_empty());
        let rough = rough.map(|_| limit - limit.saturating_sub(counts.evaluations) / 2);
        Stage::Descent { origin, descent, limit, rough }
    }

    /// The objective of a search or a rough descent.
    fn rough_or_whole(&self) -> &Objective<'_> {
        self.rough.unwrap_or(self.objective)
    }

    /// Continues from `state` to the end, or until the observer stops it or nobody waits any longer; an iteration cut short by that is as
    /// none.
    pub(super) fn finish(
        &self,
        mut state: Checkpoint,
        counts: &mut Counts,
        observer: &mut dyn Observer,
    ) -> Result<Arrival, FitError> {
        loop {
            let before = state.clone();
            self.step(&mut state, counts);
            if counts.is_stopped() {
                counts.return_to(&before.counts);
                state = before;
            }
            let (phase, cost, end, near) = match &state.stage {
                Stage::Search(search) => {
                    ("search", search.cost, search.stop().map(|stop| stop.name()), false)
                }
                Stage::Descent { descent, .. } => {
                    ("descent", descent.cost, descent.end.map(|end| end.name()), descent.near)
                }
            };
            state.counts = counts.clone();
            let best =
                state.ended.iter().filter_map(|ended| ended.cost).chain(cost).fold(f64::INFINITY, f64::min);
            let flow = observer.progress(&Progress {
                phase,
                evaluations: counts.evaluations,
                max_evaluations: self.experiment.fit.max_evaluations,
                rollouts: counts.rollouts,
                loss_m2: best * self.loss_m2,
                is_rough: match &state.stage {
                    Stage::Search(_) => self.rough.is_some(),
                    descent => is_rough(descent),
                },
                // where no stage follows, the descent is completed instead of reporting an answer early
                is_answer: (end.is_some() || near && !self.is_at_noise_level(cost))
                    && !is_rough(&state.stage),
                parameters: self.objective.parameters(),
                values: match &state.stage {
                    Stage::Search(search) => &search.anchor.values,
                    Stage::Descent { descent, .. } => &descent.point.values,
                },
                checkpoint: &state,
            });
            let flow = if counts.is_stopped() { Flow::Stop } else { flow };
            match (end, flow) {
                (Some(end), _) if self.is_over(&state.stage, &state.waiting, counts) => {
                    return self.arrive(state, end, counts);
                }
                (_, Flow::Stop) => return self.arrive(state, INTERRUPTED, counts),
                (Some(end), Flow::Continue) => {
                    let before = state.clone();
                    if !self.start_next_stage(&mut state, counts) {
                        return self.arrive(state, end, counts);
                    }
                    if counts.is_stopped() {
                        counts.return_to(&before.counts);
                        state = before;
                    }
                }
                (None, Flow::Continue) => {}
            }
        }
    }

    /// One iteration or generation of the stage that `state` is in; a state may be that of a stage that had just ended.
    fn step(&self, state: &mut Checkpoint, counts: &mut Counts) {
        match &mut state.stage {
            Stage::Search(search) if search.stop().is_none() => search.step(self.rough_or_whole(), counts),
            Stage::Descent { descent, limit, rough, .. } if descent.end.is_none() => {
                let (objective, limit) = match *rough {
                    Some(limit) => (self.rough_or_whole(), limit),
                    None => (self.objective, *limit),
                };
                descent.step(objective, Freedom::Everything, limit, counts);
                // near its end, a rough descent is continued on the whole objective
                if rough.is_some() && descent.near {
                    descent.end.get_or_insert(End::TolLoss);
                }
            }
            Stage::Search(_) | Stage::Descent { .. } => {}
        }
    }

    /// Whether nothing follows `stage`, which has ended.
    fn is_over(&self, stage: &Stage, waiting: &[(Origin, Point)], counts: &Counts) -> bool {
        match stage {
            _ if self.experiment.fit.method != Method::Hybrid => true,
            Stage::Search(_) => false,
            stage if is_rough(stage) => false,
            Stage::Descent { origin, descent, .. } if origin.precedes_search() => {
                self.search_evaluations(counts) == 0 || self.is_at_noise_level(descent.cost)
            }
            Stage::Descent { .. } => waiting.is_empty(),
        }
    }

    /// Whether `cost` is what noise alone leaves.
    fn is_at_noise_level(&self, cost: Option<f64>) -> bool {
        cost.is_some_and(|cost| cost <= NOISE_COST_RATIO_MAX * self.noise_cost)
    }

    /// Candidates that a search may try.
    fn search_evaluations(&self, counts: &Counts) -> u64 {
        let left = self.experiment.fit.max_evaluations.saturating_sub(counts.evaluations);
        (SEARCH_EVALUATIONS_PER_PARAMETER * self.objective.parameters().len() as u64).min(left / 4)
    }

    /// Replaces a stage that has ended by the next one; false where no stage is left.
    fn start_next_stage(&self, state: &mut Checkpoint, counts: &mut Counts) -> bool {
        let config = &self.experiment.fit;
        match &state.stage {
            Stage::Search(search) => {
                state.waiting = self.starts(search, state, counts);
            }
            &Stage::Descent { origin, ref descent, limit, rough: Some(_) } => {
                let descent = Descent::new(descent.point.clone(), None);
                state.stage = Stage::Descent { origin, descent, limit, rough: None };
                return true;
            }
            Stage::Descent { origin, descent, .. } => {
                let origin = *origin;
                state.ended.push(ended_at(origin, descent));
                if origin.precedes_search() && state.waiting.is_empty() {
                    let best = best(&state.ended)
                        .map_or_else(|| self.objective.problem.start(), |b| b.point.clone());
                    let most = self.search_evaluations(counts);
                    let search =
                        Search::new(self.rough_or_whole(), best, Restarts::None, config.seed, most, counts);
                    state.stage = Stage::Search(Box::new(search));
                    return true;
                }
            }
        }
        let shares = state.waiting.len() as u64;
        if shares == 0 {
            return false;
        }
        let (origin, point) = state.waiting.remove(0);
        let limit = counts.evaluations + config.max_evaluations.saturating_sub(counts.evaluations) / shares;
        state.stage = self.descent(origin, Descent::new(point, None), limit, counts);
        true
    }

    /// `point` with next to no dry friction, where the model may have some: a joint stuck by friction has zero gradient, so
    /// that a descent could not leave that state.
    fn loosened(&self, point: &Point) -> Option<Point> {
        let free = &self.objective.parameters().free;
        let loose = |(p, &x): (&FreeParameter, &f64)| if p.is_friction() { p.scale.loose(x) } else { x };
        let values = free.iter().zip(&point.values).map(loose).collect();
        free.iter().any(FreeParameter::is_friction).then(|| Point { values, offsets: point.offsets.clone() })
    }

    /// Where descents begin after a search, the most promising first.
    fn starts(&self, search: &Search, state: &Checkpoint, counts: &mut Counts) -> Vec<(Origin, Point)> {
        let parameters = self.objective.parameters();
        let mut list = Vec::new();
        let best = best(&state.ended).map_or(&search.anchor, |ended| &ended.point);
        // A descent from the same point would end where it did before.
        if search.anchor.values != best.values {
            list.push((Origin::Search, search.anchor.clone()));
        }
        let drawn: Vec<Point> =
            spread(parameters.len(), DRAWN_POINTS_PER_PARAMETER * parameters.len(), self.experiment.fit.seed)
                .iter()
                .map(|units| Point { values: parameters.values(units), offsets: best.offsets.clone() })
                .collect();
        let costs = self.rough_or_whole().costs(&drawn, true, counts);
        let mut order: Vec<usize> = (0..drawn.len()).filter(|&i| costs[i].is_finite()).collect();
        order.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]));
        list.extend(order.iter().take(DRAWN_STARTS).map(|&i| (Origin::Drawn, drawn[i].clone())));
        list
    }

    /// The best point of all stages.
    fn arrive(&self, state: Checkpoint, reason: &str, counts: &mut Counts) -> Result<Arrival, FitError> {
        if counts.is_stopped() {
            *counts = counts.for_last_words();
        }
        let Checkpoint { stage, mut ended, .. } = state;
        let last = match stage {
            Stage::Search(mut search) => {
                search.drop_anchor(self.rough_or_whole(), counts);
                let (point, cost) = (search.anchor.clone(), search.cost);
                let cost = if self.rough.is_some() { self.cost(&point, counts) } else { cost };
                let reason = reason.to_owned();
                Ended { origin: Origin::Search, point, cost, reason, settled: false, linear: None }
            }
            Stage::Descent { origin, descent, rough: Some(_), .. } => {
                let (cost, reason) = (self.cost(&descent.point, counts), reason.to_owned());
                Ended { origin, point: descent.point, cost, reason, settled: false, linear: None }
            }
            Stage::Descent { origin, descent, .. } => {
                let mut ended = ended_at(origin, &descent);
                if reason == INTERRUPTED {
                    // near the end the error bars of the last step's beginning will do
                    ended.linear = descent.linear;
                }
                Ended { reason: reason.to_owned(), ..ended }
            }
        };
        let several = !ended.is_empty();
        ended.push(last);
        let Some(best) = best(&ended) else {
            if counts.is_stopped() {
                return Err(FitError::Interrupted);
            }
            return Err(self.start_failed(&ended[0].point));
        };
        let stop_reason = if reason == INTERRUPTED { reason.to_owned() } else { best.reason.clone() };
        let Ended { point, settled, linear, .. } = best.clone();
        let ended = if several { ended } else { Vec::new() };
        Ok(Arrival { point, linearised: settled, linear, stop_reason, ended })
    }

    /// Cost of `point` on the whole objective; `None` where it cannot be simulated.
    fn cost(&self, point: &Point, counts: &mut Counts) -> Option<f64> {
        let costs = self.objective.costs(std::slice::from_ref(point), false, counts);
        costs.into_iter().find(|cost| cost.is_finite())
    }

    /// Which run cannot be simulated at `point`, and why.
    fn start_failed(&self, point: &Point) -> FitError {
        let problem = &self.objective.problem;
        let model = problem.parameters.applied(&point.values, problem.model);
        for (term, offsets) in problem.terms.iter().zip(&point.offsets) {
            if let Err(source) = term.rehearsal.simulate(&model, offsets, term.instants) {
                return FitError::Simulation { run: term.rehearsal.run.id.clone(), source };
            }
        }
        FitError::NoOptimum
    }
}

fn is_rough(stage: &Stage) -> bool {
    matches!(stage, Stage::Descent { rough: Some(_), .. })
}

fn ended_at(origin: Origin, descent: &Descent) -> Ended {
    let reason = descent.end.map_or(String::new(), |end| end.name().to_owned());
    let Descent { point, cost, settled, linear, .. } = descent.clone();
    Ended { origin, point, cost, reason, settled, linear: linear.filter(|_| settled) }
}

/// The one that cost least, the first of equals.
pub(super) fn best(ended: &[Ended]) -> Option<&Ended> {
    let simulated = ended.iter().filter_map(|ended| Some((ended, ended.cost?)));
    simulated.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(ended, _)| ended)
}

/// `count` points of the unit box, shape (count, dimension): in every coordinate one in each `count`-th of it.
///
/// # Source
/// M. D. McKay, R. J. Beckman, W. J. Conover, "A Comparison of Three Methods for Selecting Values of Input
/// Variables in the Analysis of Output from a Computer Code", Technometrics 21 (1979) 239-245.
pub(crate) fn spread(dimension: usize, count: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    // The streams from 0 on are the generations of the search.
    random.set_stream(u64::MAX);
    let mut points = vec![vec![0.0; dimension]; count];
    for coordinate in 0..dimension {
        let mut places: Vec<usize> = (0..count).collect();
        places.shuffle(&mut random);
        for (point, place) in points.iter_mut().zip(places) {
            let within: f64 = StandardUniform.sample(&mut random);
            point[coordinate] = (place as f64 + within) / count as f64;
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawn_points_visit_every_part_of_every_coordinate() {
        let points = spread(3, 7, 1);
        for coordinate in 0..3 {
            let mut parts: Vec<usize> =
                points.iter().map(|point| (point[coordinate] * 7.0) as usize).collect();
            parts.sort_unstable();
            assert_eq!(parts, [0, 1, 2, 3, 4, 5, 6]);
        }
        assert_ne!(spread(3, 7, 1), spread(3, 7, 2));
    }
}
