//! A model with some causes, fitted: what all tests start from.

use rayon::prelude::*;
use sim::model::Parameter;
use sim::{Model, Trajectory};

use super::candidates::Term as CauseTerm;
use crate::fit::FittedRun;
use crate::fit::counts::Counts;
use crate::fit::least_squares::Descent;
use crate::fit::objective::Objective;
use crate::fit::problem::{Linear, Point, Problem, Term};
use crate::fit::repeat::repeat;
use crate::noise::Whitening;
use crate::noise::floor::Floor;
use crate::noise::pose::PoseErrors;
use crate::noise::stamps::velocities;
use crate::parameters::Parameters;
use crate::simulate::Nuisance;

/// A model with some causes at its optimum.
#[derive(Debug, Clone)]
pub(crate) struct State<'a> {
    /// The causes added to the baseline, in the order in which they were found.
    pub(crate) causes: Vec<CauseTerm>,
    /// The model with neutral causes.
    pub(crate) model: Model,
    /// The baseline's parameters first, then those of the causes.
    pub(crate) parameters: Parameters,
    pub(crate) terms: Vec<Term<'a>>,
    pub(crate) point: Point,
    /// Squares of whitened residuals, priors included.
    pub(crate) cost: f64,
    /// Residuals and derivatives at the point, by run.
    pub(crate) linear: Vec<Linear>,
    /// Numbers that the causes have added.
    pub(crate) added: usize,
}

/// Deviations that a trajectory states for its cells, over what is usual for their keypoint; 1 where none is stated. Shape
/// (N, K). How large noise is the residuals say; what is stated says only where there is more of it.
pub(crate) fn relative_std(trajectory: &Trajectory) -> Vec<f64> {
    let width = trajectory.keypoints.len();
    let cells = trajectory.time_s.len() * width;
    let stated = |cell: usize| {
        let std = trajectory.std_m.as_ref().map(|std| std[cell]);
        std.filter(|std| std.is_finite() && *std > 0.0)
    };
    let usual: Vec<f64> = (0..width)
        .map(|keypoint| {
            let squares: Vec<f64> =
                (keypoint..cells).step_by(width).filter_map(stated).map(|std| std * std).collect();
            (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
        })
        .collect();
    (0..cells).map(|cell| stated(cell).map_or(1.0, |std| std / usual[cell % width])).collect()
}

/// A share of the cost that is not worth a step: a twentieth of what could matter to anyone.
const NOT_WORTH_A_STEP_SHARE: f64 = 1e-5;
/// Most steps of one descent: a fit that needs more is told apart by the next one.
const MOST_STEPS: usize = 25;

impl<'a> State<'a> {
    /// The baseline before any fit.
    pub(crate) fn baseline(model: &Model, parameters: Parameters, terms: Vec<Term<'a>>) -> Self {
        let offsets = terms.iter().map(|term| vec![0.0; term.rehearsal.nuisances.len()]).collect();
        let point = Point { values: parameters.start(), offsets };
        Self {
            causes: Vec::new(),
            model: model.clone(),
            parameters,
            terms,
            point,
            cost: f64::INFINITY,
            linear: Vec::new(),
            added: 0,
        }
    }

    pub(crate) fn problem(&self) -> Problem<'_> {
        Problem { model: &self.model, parameters: &self.parameters, terms: self.terms.clone() }
    }

    /// Weighs residuals with the noise of `floor`, whitened.
    pub(crate) fn weigh(&mut self, floor: &Floor) {
        for (term, run) in self.terms.iter_mut().zip(&floor.runs) {
            let trajectory = &term.rehearsal.run.trajectory;
            let width = trajectory.keypoints.len();
            let relative = relative_std(trajectory);
            for observation in &mut term.observations {
                let relative = relative[observation.instant * width + observation.keypoint];
                observation.per_m = 1.0 / (run.std_m[observation.keypoint] * relative);
            }
            let speeds = velocities(trajectory, &term.observations);
            let speeds = speeds.iter().zip(&term.observations).map(|(v, o)| floor.stamp_std_s * v * o.per_m);
            let speeds: Vec<f64> = speeds.collect();
            term.whitening = Some(Whitening::new(
                &term.observations,
                &trajectory.time_s,
                floor.correlation,
                run.interval_s,
                PoseErrors::of(trajectory).as_ref(),
                if floor.stamp_std_s > 0.0 { &speeds } else { &[] },
            ));
        }
        self.linear.clear();
    }

    /// Goes to the nearest optimum; whether there is one. Leaves the linearisation there.
    pub(crate) fn descend(&mut self, counts: &mut Counts) -> bool {
        self.steps(MOST_STEPS, counts) && self.linearised(counts)
    }

    /// Takes up to `most` steps towards the nearest optimum; whether any can be simulated. The linearisation is left
    /// where it is that of the point.
    pub(crate) fn steps(&mut self, most: usize, counts: &mut Counts) -> bool {
        let mut linear = std::mem::take(&mut self.linear);
        let (point, cost, linear) = {
            let objective = Objective::squares(self.problem());
            let mut descent = Descent::new(self.point.clone(), None);
            for _ in 0..most {
                if linear.is_empty() {
                    let Some(found) = objective.problem.linearise(&descent.point, true, counts) else {
                        return false;
                    };
                    linear = found;
                }
                let before = descent.point.clone();
                descent.step_with(&objective, &linear, NOT_WORTH_A_STEP_SHARE, counts);
                if descent.point != before {
                    linear.clear();
                }
                if descent.end.is_some() {
                    break;
                }
            }
            let Some(cost) = descent.cost else { return false };
            (descent.point, cost, linear)
        };
        (self.point, self.cost, self.linear) = (point, cost, linear);
        true
    }

    /// Stays where it is; whether that can be simulated.
    pub(crate) fn stay(&mut self, counts: &mut Counts) -> bool {
        self.cost = self.problem().costs(std::slice::from_ref(&self.point), counts)[0];
        self.linearised(counts)
    }

    /// Sees to the linearisation at the point; whether there is one.
    pub(crate) fn linearised(&mut self, counts: &mut Counts) -> bool {
        if self.linear.is_empty() {
            let Some(linear) = self.problem().linearise(&self.point, true, counts) else { return false };
            self.linear = linear;
        }
        true
    }

    /// Plans the steps of all runs for what the model does now, and for noise of `noise_m` \[m\]: with a cause it may be stiffer
    /// than the one they were planned for.
    pub(crate) fn replan(&mut self, noise_m: f64, counts: &Counts) {
        if counts.is_stopped() {
            return;
        }
        let model = self.calibrated();
        self.terms.par_iter_mut().zip(&self.point.offsets).for_each(|(term, offsets)| {
            term.rehearsal = term.rehearsal.clone().replanned(&model, offsets, noise_m);
        });
        self.linear.clear();
    }

    /// The same in steps that are nowhere long, for forces that the model lacks.
    fn nowhere_long(&self) -> Self {
        let mut short = Self { linear: Vec::new(), ..self.clone() };
        short.terms.iter_mut().for_each(|term| term.rehearsal = term.rehearsal.clone().nowhere_long());
        short
    }

    /// This state with `cause` added, neutral, before any fit; in steps that are nowhere long.
    pub(crate) fn with(&self, cause: &CauseTerm) -> Self {
        let mut next = self.nowhere_long();
        next.model = cause.added_to(&self.model);
        cause.switched_on(&mut next.model);
        let added = cause.free(&next.model);
        next.added += added.free.len() + added.own.len() * self.terms.len();
        next.point.values.extend(added.free.iter().map(|parameter| parameter.start));
        next.parameters.free.extend(added.free);
        next.add_own(&added.own);
        next.causes.push(cause.clone());
        next
    }

    /// Adds numbers that each run has its own of, at 0.
    pub(crate) fn add_own(&mut self, own: &[(String, Nuisance)]) {
        for (term, offsets) in self.terms.iter_mut().zip(&mut self.point.offsets) {
            term.rehearsal.nuisances.extend(own.iter().map(|(_, nuisance)| *nuisance));
            offsets.resize(term.rehearsal.nuisances.len(), 0.0);
        }
    }

    /// The model with all its numbers, but those that each run has its own of.
    pub(crate) fn calibrated(&self) -> Model {
        self.parameters.applied(&self.point.values, &self.model)
    }

    /// The model as it may be expected to be in a further run: as [`State::calibrated`], with the mean of the sizes that differ from run
    /// to run.
    pub(crate) fn expected(&self) -> Model {
        let mut model = self.calibrated();
        let own = self.causes.iter().filter(|term| term.by_run).flat_map(|term| term.free(&self.model).own);
        for (name, _) in own {
            if let (Some(value), Ok(place)) = (self.value(&name), model.find_parameter(&name)) {
                model.set(place, value);
            }
        }
        model
    }

    /// The number called `name`: the common one, or the mean over the runs. `None` where it is not free.
    pub(crate) fn value(&self, name: &str) -> Option<f64> {
        let common = self.parameters.free.iter().position(|parameter| parameter.name() == name);
        common.map(|place| self.point.values[place]).or_else(|| {
            let each = (0..self.terms.len()).map(|run| self.own_value(name, run));
            let each: Vec<f64> = each.collect::<Option<_>>()?;
            (!each.is_empty()).then(|| each.iter().sum::<f64>() / each.len() as f64)
        })
    }

    /// The number called `name` that `run` has its own of.
    pub(crate) fn own_value(&self, name: &str, run: usize) -> Option<f64> {
        let mut nuisances = self.terms[run].rehearsal.nuisances.iter().zip(&self.point.offsets[run]);
        nuisances.find(|(nuisance, _)| self.own_name(**nuisance) == Some(name)).map(|(_, value)| *value)
    }

    /// The numbers of its causes that each run has its own of, and their names.
    pub(crate) fn own(&self) -> Vec<(String, Nuisance)> {
        self.causes.iter().flat_map(|term| term.free(&self.model).own).collect()
    }

    /// The name of a parameter that each run has its own of.
    pub(crate) fn own_name(&self, nuisance: Nuisance) -> Option<&str> {
        let Nuisance::Own { place: Parameter::Cause(effect, value), .. } = nuisance else { return None };
        Some(&self.model.causes()[effect].names()[value])
    }

    /// Observations in all.
    pub(crate) fn count(&self) -> usize {
        self.terms.iter().map(|term| term.observations.len()).sum()
    }

    /// Residuals of a run before whitening \[m\], over how much less certain than usual the cell says it is.
    pub(crate) fn raw_residuals(&self, run: usize) -> Option<Vec<f64>> {
        let term = &self.terms[run];
        let model = self.calibrated();
        let simulated = term.rehearsal.simulate(&model, &self.point.offsets[run], term.instants).ok()?;
        let trajectory = &term.rehearsal.run.trajectory;
        let width = trajectory.keypoints.len();
        let relative = relative_std(trajectory);
        let raw = term.observations.iter().map(|o| {
            let cell = o.instant * width + o.keypoint;
            (o.measured_m - simulated[cell][o.axis]) / relative[cell]
        });
        Some(raw.collect())
    }

    /// Fitted runs beside their simulation.
    pub(crate) fn repeated(&self) -> Vec<FittedRun> {
        let model = self.calibrated();
        let one = |(term, offsets): (&Term<'a>, &Vec<f64>)| {
            let start_s = term.rehearsal.start_with(&model, offsets).start_s;
            repeat(&model, &term.rehearsal, offsets, start_s).ok()
        };
        self.terms.iter().zip(&self.point.offsets).filter_map(one).collect()
    }

    /// When the motion of a run starts \[s\].
    pub(crate) fn start_s(&self, run: usize) -> f64 {
        let rehearsal = &self.terms[run].rehearsal;
        rehearsal.start_with(&self.model, &self.point.offsets[run]).start_s
    }
}
