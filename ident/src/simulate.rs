//! A run as the simulation repeats it: from a model and what is uncertain about the run's start to keypoints.
//!
//! Each run has nuisances of its own: the coordinates of its initial pose, those of its rates that are unknown, its
//! release if nobody stated it. They are offsets from the estimates of [`crate::initial`], 0 at first.

mod in_run;

use sim::batch::{self, Candidate};
use sim::model::Parameter;
use sim::sensitivities::{self, Direction};
use sim::transitions::{Transitions, transitions};
use sim::{
    Command, ContactWatch, Isa, Method, Model, Rollout, RolloutError, RolloutOptions, State, Steps, Touch,
    rollout,
};

use crate::experiment::{Run, in_the_mean, not_estimated, unknown_rates};
use crate::geometry::{motion, moved};
use crate::initial::{Estimate, Start, prescribed_dofs};

/// One uncertain number about the start of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Nuisance {
    /// Offset of the coordinate that belongs to this degree of freedom \[rad\] or \[m\].
    Coordinate(usize),
    /// Offset of this velocity \[rad/s\] or \[m/s\].
    Rate {
        /// Index of the degree of freedom.
        dof: usize,
        /// How fast it may be, one standard deviation \[rad/s\] or \[m/s\].
        belief: f64,
    },
    /// Offset of the release \[s\], within these bounds.
    Release {
        /// The release is not before the first image.
        lower: f64,
        /// The release is not after motion is beyond doubt.
        upper: f64,
    },
    /// Value of a parameter that differs from run to run, SI.
    Own {
        /// Its place in the model.
        place: Parameter,
        /// Least value that physics allows.
        lower: f64,
        /// Greatest value that physics allows.
        upper: f64,
    },
}

/// Standard deviation of the initial rates of a mechanism that is in motion when filming begins \[rad/s\] or \[m/s\] (chosen),
const INITIAL_RATE_STD: f64 = 50.0;
/// and of those of a body that drifts \[rad/s\] or \[m/s\] (chosen): also out of the picture's plane, which images hardly show.
const DRIFT_RATE_STD: f64 = 0.02;

impl Nuisance {
    /// Standard deviation of a belief so weak that it matters only where the images say nothing: half a radian, the rate's
    /// `belief`, the interval that contains the release, the width of a parameter's bounds.
    pub(crate) fn belief(self) -> f64 {
        match self {
            Self::Coordinate(_) => 0.5,
            Self::Rate { belief, .. } => belief,
            Self::Release { lower, upper } => (upper - lower).max(1e-3),
            Self::Own { lower, upper, .. } => upper - lower,
        }
    }

    /// `offset`, no further than physics allows.
    pub(crate) fn clamp(self, offset: f64) -> f64 {
        match self {
            Self::Release { lower, upper } | Self::Own { lower, upper, .. } => offset.clamp(lower, upper),
            Self::Coordinate(_) | Self::Rate { .. } => offset,
        }
    }
}

/// The numbers of a model that a fit turns, at one point.
#[derive(Debug, Clone, Copy)]
pub struct Numbers<'a> {
    /// Places in the model, shape (N).
    pub places: &'a [Parameter],
    /// Their values, shape (N), SI.
    pub values: &'a [f64],
    /// For each parameter by which derivatives are wanted, its places with the rate at which each changes: tied ones change together.
    pub varied: &'a [Vec<(usize, f64)>],
}

/// Largest errors of simulation that are negligible, as a share of the noise (chosen).
const SIMULATION_ERROR_NOISE_SHARE_MAX: f64 = 0.05;
/// Steps are planned for errors this many times smaller than allowed (chosen), for candidates that move faster than the nominal one.
const PLAN_ACCURACY_MARGIN: f64 = 2.0;
/// A candidate too stiff for the plan is simulated with each step divided into this many parts, the first number at which it does not
/// diverge (chosen).
const STEP_PARTS: [usize; 3] = [1, 4, 16];
/// The short steps of a plan are its shortest 1/10 (chosen).
const SHORT_STEPS_QUANTILE_DIVISOR: usize = 10;

/// Errors of simulation that are negligible beside noise of `noise_m` \[m\].
fn wanted_m(noise_m: f64) -> f64 {
    sim::ACCURACY_M.max(SIMULATION_ERROR_NOISE_SHARE_MAX * noise_m)
}

/// The simulated motion of a whole run.
#[derive(Debug, Clone)]
pub struct Watched {
    /// Positions of the measured keypoints \[m\], laid out as [`Rehearsal::simulate`] does, shape (N, K).
    pub position_m: Vec<[f64; 3]>,
    /// The coordinates behind it, row-major, shape (N, nq).
    pub qpos: Vec<f64>,
    /// The first contact between shapes whose contact is not simulated, if any.
    pub touch: Option<Touch>,
}

/// A run prepared for repeated simulation.
#[derive(Debug, Clone)]
pub struct Rehearsal<'a> {
    /// The run that is simulated.
    pub run: &'a Run,
    /// Estimated start from which the offsets count.
    pub start: Start,
    /// What is uncertain about the start.
    pub nuisances: Vec<Nuisance>,
    command: Command,
    /// The cheapest steps that are exact enough; `None`: no step is.
    plan: Option<Steps>,
    /// How it is stepped, the same for every candidate; `None`: as the model says.
    steps: Option<Steps>,
    /// Into how many parts steps are divided, one after the other, for a candidate too stiff for them.
    parts: &'static [usize],
    /// For each measured keypoint, the model's.
    columns: Vec<usize>,
}

impl<'a> Rehearsal<'a> {
    /// Makes `run` ready with its `estimate`, in the cheapest steps whose errors are lost in noise of `noise_m` \[m\]; keypoints
    /// that the model does not have must have been refused before ([`crate::experiment::Experiment::check`]).
    pub fn new(model: &Model, run: &'a Run, estimate: Estimate, noise_m: f64) -> Self {
        Self::rougher(model, run, estimate, noise_m, 1.0)
    }

    /// As [`Rehearsal::new`], with errors of simulation that may be `rougher` times as large.
    pub(crate) fn rougher(
        model: &Model,
        run: &'a Run,
        estimate: Estimate,
        noise_m: f64,
        rougher: f64,
    ) -> Self {
        let mut rehearsal = Self::as_modelled(model, run, estimate);
        // Where no step is exact enough at the nominal values, the model's own has to do.
        rehearsal.plan = rehearsal.planned(model, &rehearsal.start, rougher * wanted_m(noise_m));
        rehearsal.steps = rehearsal.plan.clone();
        rehearsal
    }

    /// As [`Rehearsal::new`], in the model's own steps: for a run that is looked at once or twice.
    pub(crate) fn as_modelled(model: &Model, run: &'a Run, estimate: Estimate) -> Self {
        let mut nuisances = Vec::new();
        if run.initial.is_none() {
            let frozen = prescribed_dofs(model, run);
            let not_estimated = not_estimated(model, run);
            let free = (0..model.nv()).filter(|&dof| !frozen[dof] && !not_estimated[dof]);
            nuisances.extend(free.map(Nuisance::Coordinate));
            let unknown = unknown_rates(model, run, &frozen);
            let belief = if run.adrift { DRIFT_RATE_STD } else { INITIAL_RATE_STD };
            let rates = (0..model.nv()).filter(|&dof| unknown[dof]);
            nuisances.extend(rates.map(|dof| Nuisance::Rate { dof, belief }));
        }
        if let Some(release) = estimate.release {
            let from = estimate.start.start_s;
            nuisances
                .push(Nuisance::Release { lower: release.earliest_s - from, upper: release.latest_s - from });
        }
        let known = model.marks();
        let columns = run.trajectory.keypoints.iter().filter_map(|name| known.iter().position(|k| k == name));
        // Prescribed joints are free in drops, which is what no command at all means to the simulation.
        let ignores_command = run.prescribed && !run.follows();
        let command = run.command.as_ref().filter(|_| !ignores_command).map(in_the_mean).unwrap_or_default();
        Self {
            run,
            start: estimate.start,
            nuisances,
            command,
            plan: None,
            steps: None,
            parts: &STEP_PARTS,
            columns: columns.collect(),
        }
    }

    /// Steps for `model` from `start` whose errors are at most `accuracy_m` \[m\]; none where no step is so exact.
    fn planned(&self, model: &Model, start: &Start, accuracy_m: f64) -> Option<Steps> {
        let options = RolloutOptions { steps: self.plan.clone(), ..self.options(start.start_s, 1) };
        let times = &self.run.trajectory.time_s;
        let model = &*self.as_in_run(model);
        let plan =
            sim::plan(model, &start.state, &self.command, times, &options, accuracy_m / PLAN_ACCURACY_MARGIN);
        plan.ok().map(|plan| plan.steps)
    }

    /// The same in steps planned for `model` with `offsets`, which may be quicker or stiffer than the one before, and for noise of
    /// `noise_m` \[m\].
    pub fn replanned(mut self, model: &Model, offsets: &[f64], noise_m: f64) -> Self {
        let mut run_model = model.clone();
        for (place, value) in self.run_parameters(offsets) {
            run_model.set(place, value);
        }
        let planned = self.planned(&run_model, &self.start_with(model, offsets), wanted_m(noise_m));
        self.plan = planned.or(self.plan);
        self.steps = self.plan.clone();
        self
    }

    /// The same in steps that are nowhere much longer than the short ones of the plan: for candidates with forces that the nominal
    /// model lacks, which may be quick where that is slow.
    pub fn nowhere_long(mut self) -> Self {
        let Some(plan) = &self.plan else { return self };
        let begins = std::iter::once(0.0).chain(plan.ends_s.iter().copied());
        let mut lengths_s: Vec<f64> = begins.zip(plan.ends_s.iter()).map(|(from, &to)| to - from).collect();
        lengths_s.sort_by(f64::total_cmp);
        let Some(&short_s) = lengths_s.get(lengths_s.len() / SHORT_STEPS_QUANTILE_DIVISOR) else {
            return self;
        };
        self.steps = Some(plan.shortened(match plan.method {
            // what is stiffer than the nominal model would make longer ones unstable
            Method::RungeKutta => short_s,
            Method::Rosenbrock => 2.0 * short_s,
        }));
        self
    }

    /// The same with each step in so many `parts`.
    pub(crate) fn in_parts(mut self, parts: usize) -> Self {
        self.steps = self.steps.map(|steps| steps.divided(parts));
        self
    }

    /// The same without a second try for candidates too stiff for its steps: where there are many more of them.
    pub fn in_one_try(mut self) -> Self {
        self.parts = &STEP_PARTS[..1];
        self
    }

    fn options(&self, start_s: f64, parts: usize) -> RolloutOptions {
        let (prescribed, steps) =
            (self.run.prescribed, self.steps.as_ref().map(|steps| steps.divided(parts)));
        let base = self.run.base.clone();
        RolloutOptions { prescribed, start_s, steps, base, ..RolloutOptions::default() }
    }

    /// The result of `run` with the plan's steps divided into `parts`, the first number that does not diverge: a search must not end at
    /// the first candidate that is stiffer than the nominal one.
    fn with_divided_steps<R>(
        &self,
        parts: &[usize],
        run: impl Fn(usize) -> Result<R, RolloutError>,
    ) -> Result<R, RolloutError> {
        let parts = if self.steps.is_some() { parts } else { &parts[..1] };
        let mut result = run(parts[0]);
        for &parts in &parts[1..] {
            if !matches!(result, Err(RolloutError::Diverged { .. })) {
                break;
            }
            result = run(parts);
        }
        result
    }

    /// Start of the motion with `offsets`, one per nuisance.
    pub fn start_with(&self, model: &Model, offsets: &[f64]) -> Start {
        let mut delta = vec![0.0; model.nv()];
        let mut qvel = self.start.state.qvel.clone();
        let mut start_s = self.start.start_s;
        for (nuisance, &offset) in self.nuisances.iter().zip(offsets) {
            match *nuisance {
                Nuisance::Coordinate(dof) => delta[dof] = offset,
                Nuisance::Rate { dof, .. } => qvel[dof] += offset,
                Nuisance::Release { .. } => start_s += offset,
                Nuisance::Own { .. } => {}
            }
        }
        Start { state: State { qpos: moved(model, &self.start.state.qpos, &delta), qvel }, start_s }
    }

    /// The offsets, one per nuisance, at which the motion starts as it does from `start`, as far as nuisances say so.
    pub(crate) fn offsets_to(&self, model: &Model, start: &Start) -> Vec<f64> {
        let delta = motion(model, &self.start.state.qpos, &start.state.qpos);
        let offset = |nuisance: &Nuisance| match *nuisance {
            Nuisance::Coordinate(dof) => delta[dof],
            Nuisance::Rate { dof, .. } => start.state.qvel[dof] - self.start.state.qvel[dof],
            Nuisance::Release { .. } => nuisance.clamp(start.start_s - self.start.start_s),
            Nuisance::Own { .. } => nuisance.clamp(0.0),
        };
        self.nuisances.iter().map(offset).collect()
    }

    /// Simulated positions \[m\] of the measured keypoints at the first `instants` of the run's images, shape
    /// (instants, K), laid out as the trajectory is.
    ///
    /// # Errors
    /// [`RolloutError`], for instance where these parameters make the simulation diverge.
    pub fn simulate(
        &self,
        model: &Model,
        offsets: &[f64],
        instants: usize,
    ) -> Result<Vec<[f64; 3]>, RolloutError> {
        let rollout = self.rolled(model, offsets, instants)?;
        Ok(self.measured(rollout.position_m, rollout.keypoints.len()))
    }

    /// The motion behind [`Rehearsal::simulate`] over the whole run.
    ///
    /// # Errors
    /// As there.
    pub fn simulate_watched(&self, model: &Model, offsets: &[f64]) -> Result<Watched, RolloutError> {
        let rollout = self.rolled(model, offsets, self.run.trajectory.time_s.len())?;
        let touch = ContactWatch::unsimulated(model).and_then(|mut watch| watch.first_touch(&rollout));
        let position_m = self.measured(rollout.position_m, rollout.keypoints.len());
        Ok(Watched { position_m, qpos: rollout.qpos, touch })
    }

    /// The motion behind [`Rehearsal::simulate`].
    ///
    /// # Errors
    /// As there.
    pub(crate) fn rolled(
        &self,
        model: &Model,
        offsets: &[f64],
        instants: usize,
    ) -> Result<Rollout<f64>, RolloutError> {
        let Start { state, start_s } = self.start_with(model, offsets);
        let times = &self.run.trajectory.time_s[..instants];
        let mut run_model = self.as_in_run(model);
        for (place, value) in self.run_parameters(offsets) {
            run_model.to_mut().set(place, value);
        }
        self.with_divided_steps(self.parts, |parts| {
            rollout(&run_model, &state, &self.command, times, &self.options(start_s, parts))
        })
    }

    /// What [`Rehearsal::simulate`] yields for each of many candidates, side by side: values of `parameters` in `model`, and
    /// offsets.
    ///
    /// # Errors
    /// [`RolloutError`], for all or, where one diverges, its own.
    pub fn simulate_all(
        &self,
        model: &Model,
        parameters: &[Parameter],
        candidates: &[(Vec<f64>, &[f64])],
        instants: usize,
    ) -> Result<Vec<batch::Positions>, RolloutError> {
        let at = |(v, o): &(Vec<f64>, &[f64])| self.candidate(model, parameters, v, o);
        let candidates: Vec<_> = candidates.iter().map(at).collect();
        let times = &self.run.trajectory.time_s[..instants];
        let places = self.places(parameters);
        let scaled = self.as_in_run(model);
        let simulated = |candidates: &[Candidate], parts: usize| {
            let options = self.options(self.start.start_s, parts);
            batch::positions(&scaled, &places, candidates, &self.command, times, &options, Isa::best())
        };
        let mut all = simulated(&candidates, self.parts[0])?;
        let again = if self.steps.is_some() { &self.parts[1..] } else { &[] };
        for (one, candidate) in all.iter_mut().zip(&candidates) {
            if !again.is_empty() && matches!(one, Err(RolloutError::Diverged { .. })) {
                let alone = |parts| simulated(std::slice::from_ref(candidate), parts)?.remove(0);
                *one = self.with_divided_steps(again, alone);
            }
        }
        let width = model.marks().len();
        Ok(all.into_iter().map(|one| one.map(|position_m| self.measured(position_m, width))).collect())
    }

    /// What [`Rehearsal::simulate`] yields, and its derivatives: by the parameters `at` which it is, then by the nuisances; of all these only the
    /// `columns`. Exact to rounding.
    ///
    /// # Errors
    /// [`RolloutError`].
    pub fn sensitivities(
        &self,
        model: &Model,
        at: &Numbers<'_>,
        offsets: &[f64],
        columns: std::ops::Range<usize>,
        instants: usize,
    ) -> Result<sensitivities::Sensitivities, RolloutError> {
        let candidate = self.candidate(model, at.places, at.values, offsets);
        let places = self.places(at.places);
        let factors = self.factors(model, at.places);
        let none = || Direction {
            values: vec![0.0; places.len()],
            qpos: vec![0.0; candidate.state.qpos.len()],
            qvel: vec![0.0; candidate.state.qvel.len()],
            start_s: 0.0,
        };
        let mut directions: Vec<Direction> = Vec::new();
        for rates in at.varied {
            let mut along = none();
            for &(place, rate) in rates {
                along.values[place] = rate * factors[place];
            }
            directions.push(along);
        }
        let mut next = at.places.len();
        for nuisance in &self.nuisances {
            let mut along = none();
            match *nuisance {
                Nuisance::Coordinate(dof) => along.qpos = self.coordinate_slope(model, dof, offsets),
                Nuisance::Rate { dof, .. } => along.qvel[dof] = 1.0,
                Nuisance::Release { .. } => along.start_s = 1.0,
                Nuisance::Own { .. } => {
                    along.values[next] = 1.0;
                    next += 1;
                }
            }
            directions.push(along);
        }
        let columns = columns.start.min(directions.len())..columns.end.min(directions.len());
        let directions = &directions[columns];
        let (times, command) = (&self.run.trajectory.time_s[..instants], &self.command);
        let scaled = self.as_in_run(model);
        let found = self.with_divided_steps(self.parts, |parts| {
            let options = self.options(candidate.start_s, parts);
            sensitivities::sensitivities(
                &scaled,
                &places,
                &candidate,
                directions,
                command,
                times,
                &options,
                Isa::best(),
            )
        })?;
        let width = model.marks().len();
        Ok(sensitivities::Sensitivities {
            position_m: self.measured(found.position_m, width),
            slopes: found.slopes.into_iter().map(|slope| self.measured(slope, width)).collect(),
            ..found
        })
    }

    /// How the run at these `values` of `parameters` answers to forces, in pieces of `piece_s` \[s\]; its marks are those of the model,
    /// see [`Rehearsal::measured`].
    ///
    /// # Errors
    /// [`RolloutError`].
    pub(crate) fn transitions(
        &self,
        model: &Model,
        parameters: &[Parameter],
        (values, offsets): (&[f64], &[f64]),
        piece_s: f64,
        instants: usize,
    ) -> Result<Transitions, RolloutError> {
        let candidate = self.candidate(model, parameters, values, offsets);
        let places = self.places(parameters);
        let times = &self.run.trajectory.time_s[..instants];
        let scaled = self.as_in_run(model);
        self.with_divided_steps(self.parts, |parts| {
            let options = self.options(candidate.start_s, parts);
            transitions(&scaled, &places, &candidate, piece_s, &self.command, times, &options, Isa::best())
        })
    }

    /// How the coordinates follow the offset of `dof`. A hinge's coordinate is the offset's own; quaternions bend.
    fn coordinate_slope(&self, model: &Model, dof: usize, offsets: &[f64]) -> Vec<f64> {
        /// Half the step of a central difference, at which a rotation's third-order term is 1e-12.
        const DIFFERENCE_STEP: f64 = 1e-6;
        let at = |shift: f64| {
            let shifted = self.nuisances.iter().zip(offsets).map(|(nuisance, &offset)| {
                if *nuisance == Nuisance::Coordinate(dof) { offset + shift } else { offset }
            });
            self.start_with(model, &shifted.collect::<Vec<_>>()).state.qpos
        };
        let mut slope: Vec<f64> = at(DIFFERENCE_STEP)
            .iter()
            .zip(at(-DIFFERENCE_STEP))
            .map(|(a, b)| (a - b) / (2.0 * DIFFERENCE_STEP))
            .collect();
        for joint in model.joints.iter().filter(|joint| joint.kind.nq() == 1) {
            slope[joint.qpos_address] = f64::from(u8::from(joint.dof_address == dof));
        }
        slope
    }

    /// Of the model's keypoints, shape (N, `width`), those that were measured, in the trajectory's order.
    pub(crate) fn measured(&self, positions: Vec<[f64; 3]>, width: usize) -> Vec<[f64; 3]> {
        if self.columns.iter().copied().eq(0..width) {
            return positions;
        }
        positions.chunks(width.max(1)).flat_map(|row| self.columns.iter().map(|&k| row[k])).collect()
    }
}
