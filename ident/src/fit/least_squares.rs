//! Bounded Levenberg-Marquardt over parameters and nuisances together.
//!
//! Each iteration linearises every run and solves the damped normal equations for several dampings side by side, with more
//! damping until the cost falls. It ends where the linearisation predicts no worthwhile decrease. A parameter at a bound
//! whose slope points outward is held for the iteration, steps are cut off at the bounds. The normal equations are those of an arrow: parameters touch every run, nuisances their
//! own run only.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::counts::Counts;
use super::objective::Objective;
use super::problem::{Linear, Point};
use crate::config::Loss;
use crate::noise::lasting;
use crate::parameters::Parameters;

/// A descent under way. Serialising it loses nothing.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Descent {
    pub(crate) point: Point,
    /// JSON knows no infinity: `None` where the point cannot be simulated, or has not been.
    pub(crate) cost: Option<f64>,
    damping: f64,
    /// Small decreases in a row.
    small: u32,
    /// Iterations for which the joints' dry friction still stays as it is.
    pub(super) frictions_wait: u32,
    pub(crate) end: Option<End>,
    /// Whether the last step has lowered the cost so little that the points differ by less than their error bars.
    #[serde(skip)]
    pub(super) near: bool,
    /// Whether the point has been linearised.
    pub(super) settled: bool,
    /// The linearisation at the point, or that the last step began with where the point is `near` but not `settled`; of plain
    /// squares only, and found again after a resumption.
    #[serde(skip)]
    pub(super) linear: Option<Vec<Linear>>,
}

/// Why a descent ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum End {
    /// The cost no longer falls noticeably.
    TolLoss,
    /// No step, however short, lowers the cost.
    TolStep,
    /// No evaluations are left.
    MaxEvaluations,
    /// The start itself cannot be simulated.
    Failed,
}

impl End {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::TolLoss => "tol-loss",
            Self::TolStep => "tol-step",
            Self::MaxEvaluations => "max-evaluations",
            Self::Failed => "simulation-failed",
        }
    }
}

/// What a descent may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Freedom {
    Everything,
    /// Parameters stay; only the starts of the runs move.
    Nuisances,
}

/// No step is made for a decrease of the cost below this share of one degree of freedom's cost (chosen): that is a tenth of a
/// standard deviation of the parameters.
const MIN_DECREASE_SHARE: f64 = 0.01;
/// Dampings tried at once, as multiples of the last good one (chosen; 8 candidates share the lanes of one pass).
const DAMPING_MULTIPLES: [f64; 8] = [1e-2, 1e-1, 1.0, 1e1, 1e2, 1e3, 1e4, 1e5];
/// Below this many times that decrease, half a standard deviation, the descent is near its end (chosen).
const NEAR_END_DECREASE_RATIO: f64 = 25.0;
/// Small decreases in a row that end a descent (chosen).
const SMALL_DECREASES_TO_STOP: u32 = 2;
/// Damping of a descent's first trial, as a share of the curvature (chosen).
const INITIAL_DAMPING: f64 = 1e-3;
/// Damping at and below which a step counts as undamped, and the largest one tried (both chosen).
const MIN_DAMPING: f64 = 1e-9;
const MAX_DAMPING: f64 = 1e9;
/// Factor by which the damping falls after a decrease as predicted and rises after a failed step; each further failure in a row
/// raises it by this factor more (chosen).
const DAMPING_FACTOR: f64 = 10.0;
/// A decrease of at least this share of the predicted one shows that the linearisation holds over the step (chosen).
const PREDICTED_DECREASE_SHARE_MIN: f64 = 0.5;
/// Iterations of a descent with loose joints in which their friction is held (chosen).
const FRICTION_HELD_ITERATIONS: u32 = 3;
/// Ridge, as a share of the largest curvature, that keeps the equations solvable in directions that nothing depends on (chosen).
const RIDGE_SHARE: f64 = 1e-12;

impl Descent {
    /// A descent from `point`, whose cost may be known already.
    pub(crate) fn new(point: Point, cost: Option<f64>) -> Self {
        Self {
            point,
            cost,
            damping: INITIAL_DAMPING,
            small: 0,
            frictions_wait: 0,
            end: None,
            near: false,
            settled: false,
            linear: None,
        }
    }

    /// A descent from a `point` whose joints have next to no dry friction. That stays so for some iterations, in which
    /// damping takes up what it can: friction that may grow from the first does so wherever the motion is not yet repeated,
    /// and holds the joints then.
    pub(super) fn with_loose_joints(point: Point) -> Self {
        Self { frictions_wait: FRICTION_HELD_ITERATIONS, ..Self::new(point, None) }
    }

    /// Takes steps until the descent ends by itself.
    pub(crate) fn run(&mut self, objective: &Objective<'_>, freedom: Freedom, counts: &mut Counts) {
        while self.end.is_none() {
            self.step(objective, freedom, u64::MAX, counts);
        }
    }

    /// One iteration: linearise, try, take the best.
    pub(crate) fn step(
        &mut self,
        objective: &Objective<'_>,
        freedom: Freedom,
        max_evaluations: u64,
        counts: &mut Counts,
    ) {
        let by_parameters = freedom == Freedom::Everything;
        let free = if by_parameters { objective.parameters().len() } else { 0 };
        if by_parameters && counts.evaluations + 2 > max_evaluations {
            self.end = Some(End::MaxEvaluations);
            return;
        }
        let Some((linear, data)) = objective.linearise(&self.point, by_parameters, counts) else {
            (self.cost, self.end) = (None, Some(End::Failed));
            return;
        };
        let mut normal = Normal::new(objective, &self.point, free, &linear, data);
        let waits = by_parameters && self.frictions_wait > 0;
        if waits {
            self.frictions_wait -= 1;
            normal.hold_frictions(objective.parameters());
        }
        let settings = TrialSettings {
            by_parameters,
            dampings: &DAMPING_MULTIPLES,
            min_decrease: normal.min_decrease,
            max_evaluations,
        };
        let before = self.point.clone();
        self.try_steps(objective, &normal, &settings, counts);
        self.near &= !waits;
        let is_plain = by_parameters && objective.loss == Loss::Squares;
        self.settled = is_plain && self.point == before;
        self.linear = (self.settled || is_plain && self.near).then_some(linear);
    }

    /// One iteration with derivatives that are known already, as [`Problem::linearise`](super::problem::Problem::linearise)
    /// would find them; for a loss of plain squares. `small`: share of the cost that is not worth a step.
    pub(crate) fn step_with(
        &mut self,
        objective: &Objective<'_>,
        linear: &[Linear],
        small: f64,
        counts: &mut Counts,
    ) {
        let free = objective.parameters().len();
        let data = linear.iter().map(|linear| linear.residuals.norm_squared()).sum();
        let normal = Normal::new(objective, &self.point, free, linear, data);
        let min_decrease = small * normal.cost;
        let settings =
            TrialSettings { by_parameters: true, dampings: &[1.0], min_decrease, max_evaluations: u64::MAX };
        self.try_steps(objective, &normal, &settings, counts);
    }

    /// Tries steps of rising damping until one lowers the cost.
    fn try_steps(
        &mut self,
        objective: &Objective<'_>,
        normal: &Normal,
        settings: &TrialSettings<'_>,
        counts: &mut Counts,
    ) {
        let (cost, min_decrease) = (normal.cost, settings.min_decrease);
        self.cost = Some(cost);
        if normal.largest_decrease() <= min_decrease {
            self.end = Some(End::TolLoss);
            return;
        }
        let mut raise = DAMPING_FACTOR;
        loop {
            let mut steps: Vec<(f64, Point, f64)> = settings
                .dampings
                .iter()
                .map(|factor| (factor * self.damping).max(MIN_DAMPING))
                .filter(|damping| *damping <= MAX_DAMPING)
                .map(|damping| {
                    let (trial, predicted) = normal.trial(objective, &self.point, damping);
                    (damping, trial, predicted)
                })
                // Where friction starts to stick or a bound is met, the prediction fails at every length of step.
                .filter(|(_, _, predicted)| !(0.0..=min_decrease).contains(predicted))
                .collect();
            let Some(longest) = steps.last().map(|(damping, _, _)| *damping) else {
                self.end = Some(End::TolStep);
                return;
            };
            if settings.by_parameters {
                let left = settings.max_evaluations.saturating_sub(counts.evaluations);
                steps.truncate(usize::try_from(left).unwrap_or(usize::MAX));
            }
            if steps.is_empty() {
                self.end = Some(End::MaxEvaluations);
                return;
            }
            let trials: Vec<Point> = steps.iter().map(|(_, trial, _)| trial.clone()).collect();
            let costs = objective.costs(&trials, settings.by_parameters, counts);
            let best = (0..steps.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap_or(0);
            let (reached, (damping, trial, predicted)) = (costs[best], steps.swap_remove(best));
            if reached < cost {
                let is_as_predicted = cost - reached >= PREDICTED_DECREASE_SHARE_MIN * predicted;
                self.damping =
                    if is_as_predicted { (damping / DAMPING_FACTOR).max(MIN_DAMPING) } else { damping };
                self.small = if cost - reached <= min_decrease { self.small + 1 } else { 0 };
                self.near = cost - reached <= NEAR_END_DECREASE_RATIO * min_decrease;
                self.point = trial;
                self.cost = Some(reached);
                if self.small >= SMALL_DECREASES_TO_STOP {
                    self.end = Some(End::TolLoss);
                }
                return;
            }
            self.damping = longest * raise;
            raise *= DAMPING_FACTOR;
        }
    }
}

/// How a step is chosen among trials.
struct TrialSettings<'a> {
    by_parameters: bool,
    /// As multiples of the descent's own damping, rising.
    dampings: &'a [f64],
    /// Smallest decrease of the cost for which a step is made.
    min_decrease: f64,
    max_evaluations: u64,
}

/// Normal equations in scaled unknowns: parameters first, then the nuisances run by run.
struct Normal {
    cost: f64,
    /// Smallest decrease of the cost for which a step is made.
    min_decrease: f64,
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Size of one unit of each unknown.
    size: Vec<f64>,
    /// Unknowns at a bound whose slope points outward.
    held: Vec<bool>,
    free: usize,
}

impl Normal {
    /// `data`: what the residuals cost.
    fn new(objective: &Objective<'_>, point: &Point, free: usize, linear: &[Linear], data: f64) -> Self {
        let problem = &objective.problem;
        let nuisances = || problem.terms.iter().flat_map(|term| &term.rehearsal.nuisances);
        let total = free + nuisances().count();
        let mut size: Vec<f64> = (0..free)
            .map(|i| point.values[i].abs().max(problem.parameters.free[i].scale.resolution()))
            .collect();
        size.extend(nuisances().map(|nuisance| nuisance.belief()));

        let mut hessian = DMatrix::zeros(total, total);
        let mut gradient = DVector::zeros(total);
        let mut cost = data;
        let rows: usize = linear.iter().map(|linear| linear.residuals.len()).sum();
        let lasting: f64 = linear
            .iter()
            .zip(&problem.terms)
            .map(|(linear, term)| {
                linear.residuals.len() as f64 * lasting(&term.observations, &linear.residuals)
            })
            .sum();
        let min_decrease = MIN_DECREASE_SHARE * data * lasting / (rows as f64).powi(2).max(1.0);
        let mut first = free;
        for (run, linear) in linear.iter().enumerate() {
            let nuisances = linear.jacobian.ncols() - free;
            let place = |column: usize| if column < free { column } else { first + column - free };
            let block = linear.gram();
            let slope = linear.jacobian.tr_mul(&linear.residuals);
            for i in 0..free + nuisances {
                gradient[place(i)] += slope[i] * size[place(i)];
                for j in 0..free + nuisances {
                    hessian[(place(i), place(j))] += block[(i, j)] * size[place(i)] * size[place(j)];
                }
            }
            for (k, offset) in point.offsets[run].iter().enumerate() {
                // In units of the belief, the belief is worth 1.
                let scaled = offset / size[first + k];
                cost += scaled * scaled;
                gradient[first + k] += scaled;
                hessian[(first + k, first + k)] += 1.0;
            }
            first += nuisances;
        }
        cost += objective.prior_cost(&point.values);
        for (i, parameter) in problem.parameters.free[..free].iter().enumerate() {
            if let Some(prior) = parameter.prior {
                let per = size[i] / prior.std.get();
                gradient[i] += per * (point.values[i] - prior.mean.get()) / prior.std.get();
                hessian[(i, i)] += per * per;
            }
        }
        if let Some(belief) = objective.belief.as_ref().filter(|_| free > 0) {
            let pull = belief.pull(&point.values);
            for (i, &a) in belief.places.iter().enumerate() {
                gradient[a] += size[a] * pull[i];
                for (j, &b) in belief.places.iter().enumerate() {
                    hessian[(a, b)] += size[a] * size[b] * belief.weight * belief.information[(i, j)];
                }
            }
        }
        let mut held: Vec<bool> = (0..free)
            .map(|i| {
                let (scale, value) = (&problem.parameters.free[i].scale, point.values[i]);
                value <= scale.lower() && gradient[i] >= 0.0 || value >= scale.upper() && gradient[i] <= 0.0
            })
            .collect();
        held.resize(total, false);
        Self { cost, min_decrease, hessian, gradient, size, held, free }
    }

    /// Holds the joints' dry friction where it is.
    fn hold_frictions(&mut self, parameters: &Parameters) {
        for (held, parameter) in self.held.iter_mut().zip(&parameters.free) {
            *held |= parameter.is_friction();
        }
    }

    /// The decrease that the linearisation predicts without bounds: no step brings more.
    fn largest_decrease(&self) -> f64 {
        self.predicted_decrease(&self.step(MIN_DAMPING, &self.fixed()))
    }

    /// Displacements of the unknowns that do not move: 0 for the held ones.
    fn fixed(&self) -> Vec<Option<f64>> {
        self.held.iter().map(|held| held.then_some(0.0)).collect()
    }

    /// The point a damped step leads to, and the decrease of the cost that the linearisation predicts there. A
    /// parameter that would leave its bounds, or go further than its slope can tell, stops there, and the others take a
    /// step that knows it.
    fn trial(&self, objective: &Objective<'_>, point: &Point, damping: f64) -> (Point, f64) {
        let problem = &objective.problem;
        let mut fixed = self.fixed();
        let step = loop {
            let step = self.step(damping, &fixed);
            let mut inside = true;
            for i in 0..self.free {
                let (value, scale) = (point.values[i], &problem.parameters.free[i].scale);
                let wanted = value + step[i] * self.size[i];
                let [lower, upper] = scale.reach(value);
                if fixed[i].is_none() && !(lower..=upper).contains(&wanted) {
                    fixed[i] = Some((wanted.clamp(lower, upper) - value) / self.size[i]);
                    inside = false;
                }
            }
            if inside {
                break step;
            }
        };
        let moved = |i: usize, from: f64| from + step[i] * self.size[i];
        let values = point.values.iter().enumerate().map(|(i, &value)| {
            if i < self.free { problem.parameters.free[i].scale.clamp(moved(i, value)) } else { value }
        });
        let mut next = self.free..self.size.len();
        let offsets = problem.terms.iter().zip(&point.offsets).map(|(term, offsets)| {
            let pairs = term.rehearsal.nuisances.iter().zip(offsets);
            pairs
                .filter_map(|(nuisance, &offset)| Some(nuisance.clamp(moved(next.next()?, offset))))
                .collect()
        });
        (Point { values: values.collect(), offsets: offsets.collect() }, self.predicted_decrease(&step))
    }

    fn predicted_decrease(&self, step: &DVector<f64>) -> f64 {
        -(2.0 * self.gradient.dot(step) + step.dot(&(&self.hessian * step)))
    }

    /// The damped step in scaled unknowns, those in `fixed` displaced as it says; 0 where there is none.
    fn step(&self, damping: f64, fixed: &[Option<f64>]) -> DVector<f64> {
        let displaced = DVector::from_iterator(fixed.len(), fixed.iter().map(|by| by.unwrap_or(0.0)));
        let mut pull = -(&self.gradient + &self.hessian * &displaced);
        let mut hessian = self.hessian.clone();
        let ridge = RIDGE_SHARE * hessian.diagonal().max() + f64::MIN_POSITIVE;
        for (i, fixed) in fixed.iter().enumerate() {
            hessian[(i, i)] += damping * hessian[(i, i)] + ridge;
            if fixed.is_some() {
                hessian.row_mut(i).fill(0.0);
                hessian.column_mut(i).fill(0.0);
                hessian[(i, i)] = 1.0;
                pull[i] = 0.0;
            }
        }
        match hessian.cholesky() {
            Some(factor) => factor.solve(&pull) + displaced,
            None => DVector::zeros(fixed.len()),
        }
    }
}
