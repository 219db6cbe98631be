//! Derivatives of what a run shows, exact to rounding: forward mode, one direction a SIMD lane.

use crate::batch::{Candidate, numbers_per_lane, per_lane};
use crate::command::Command;
use crate::dual::Dual;
use crate::dynamics::stages::Stages;
use crate::error::RolloutError;
use crate::lanes::{InLanes, Isa, Packed, dispatch_dual};
use crate::model::{Model, Parameter, State};
use crate::options::RolloutOptions;
use crate::rollout::{self, Run};
use crate::scalar::Scalar;
use crate::simulator;
use crate::space::{Planar, Spatial};

/// One way to vary a candidate: the rates at which its numbers change together.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// Of the parameters' values, shape (P).
    pub values: Vec<f64>,
    /// Of the coordinates, shape (nq).
    pub qpos: Vec<f64>,
    /// Of the velocities, shape (nv).
    pub qvel: Vec<f64>,
    /// Rate of the start time \[s\].
    pub start_s: f64,
}

/// A candidate's keypoint positions with their derivatives.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sensitivities {
    /// Positions \[m\], row-major, shape (N, K).
    pub position_m: Vec<[f64; 3]>,
    /// Their derivatives along each direction, shape (directions, N, K).
    pub slopes: Vec<Vec<[f64; 3]>>,
    /// Coordinates, row-major, shape (N, nq); empty where nobody asks for them.
    pub qpos: Vec<f64>,
    /// Their derivatives along each direction, shape (directions, N, nq).
    pub qpos_slopes: Vec<Vec<f64>>,
    /// Velocities, row-major, shape (N, nv); empty where nobody asks for them.
    pub qvel: Vec<f64>,
    /// Their derivatives along each direction, shape (directions, N, nv).
    pub qvel_slopes: Vec<Vec<f64>>,
}

/// Keypoint positions of `candidate` and their derivatives along each of `directions`, exact to rounding (forward mode,
/// one direction a lane). Other arguments as for
/// [`batch::positions`](crate::batch::positions).
///
/// # Errors
/// [`RolloutError`].
#[expect(clippy::too_many_arguments, reason = "a run, a point and its directions")]
pub fn sensitivities(
    model: &Model,
    parameters: &[Parameter],
    candidate: &Candidate,
    directions: &[Direction],
    command: &Command,
    sample_times_s: &[f64],
    options: &RolloutOptions,
    isa: Isa,
) -> Result<Sensitivities, RolloutError> {
    let columns = &rollout::columns(model, command)?;
    let group = directions;
    let states = false;
    Fan { model, parameters, candidate, group, command, columns, sample_times_s, options, states }.all(isa)
}

/// The same with coordinates and velocities, and their derivatives.
///
/// # Errors
/// [`RolloutError`].
#[expect(clippy::too_many_arguments, reason = "a run, a point and its directions")]
pub fn of_states(
    model: &Model,
    parameters: &[Parameter],
    candidate: &Candidate,
    directions: &[Direction],
    command: &Command,
    sample_times_s: &[f64],
    options: &RolloutOptions,
    isa: Isa,
) -> Result<Sensitivities, RolloutError> {
    let columns = &rollout::columns(model, command)?;
    let group = directions;
    let states = true;
    Fan { model, parameters, candidate, group, command, columns, sample_times_s, options, states }.all(isa)
}

/// One candidate with as many directions as there are lanes, or fewer.
#[derive(Clone, Copy)]
struct Fan<'a> {
    model: &'a Model,
    parameters: &'a [Parameter],
    candidate: &'a Candidate,
    group: &'a [Direction],
    command: &'a Command,
    columns: &'a [Option<usize>],
    sample_times_s: &'a [f64],
    options: &'a RolloutOptions,
    /// Whether coordinates and velocities are asked for, or keypoints only.
    states: bool,
}

impl Fan<'_> {
    /// Goes along all directions, as many at once as there are lanes.
    fn all(self, isa: Isa) -> Result<Sensitivities, RolloutError> {
        let Self { model, candidate, group: directions, options, .. } = self;
        rollout::check(model, &candidate.state, self.sample_times_s)?;
        let mut all = Sensitivities::default();
        // without any direction there still are positions
        let still = [Direction {
            values: vec![0.0; self.parameters.len()],
            qpos: vec![0.0; candidate.state.qpos.len()],
            qvel: vec![0.0; candidate.state.qvel.len()],
            start_s: 0.0,
        }];
        let isa = if simulator::one_by_one(model, options) { Isa::Baseline } else { isa };
        let groups = if directions.is_empty() { &still } else { directions };
        for group in groups.chunks(isa.directions()) {
            let part = dispatch_dual(isa, Fan { group, ..self })?;
            all.slopes.extend(part.slopes);
            all.qpos_slopes.extend(part.qpos_slopes);
            all.qvel_slopes.extend(part.qvel_slopes);
            (all.position_m, all.qpos, all.qvel) = (part.position_m, part.qpos, part.qvel);
        }
        for slopes in [&mut all.qpos_slopes, &mut all.qvel_slopes] {
            slopes.truncate(directions.len());
        }
        all.slopes.truncate(directions.len());
        Ok(all)
    }

    /// `value` with its rate along each lane's direction; lanes left over repeat the last one.
    fn varied<L: Packed>(&self, value: f64, rate: impl Fn(&Direction) -> f64) -> Dual<L, 1> {
        let rates = L::pack(|lane| rate(&self.group[lane.min(self.group.len() - 1)]));
        Dual { value: L::from_f64(value), partials: [rates] }
    }

    fn model<L: Packed>(&self) -> Model<Dual<L, 1>> {
        let mut model = self.model.map(Dual::<L, 1>::from_f64);
        for (index, &parameter) in self.parameters.iter().enumerate() {
            model.set(parameter, self.varied(self.candidate.values[index], |along| along.values[index]));
        }
        model
    }

    fn through<L: Packed, S: Stages<T = Dual<L, 1>>>(
        &self,
        model: &Model<Dual<L, 1>>,
        layout: S::Layout,
    ) -> Result<Sensitivities, RolloutError> {
        let Self { candidate, command, columns, sample_times_s, options, states, .. } = *self;
        let State { qpos, qvel } = &candidate.state;
        let qpos = qpos.iter().enumerate().map(|(i, &q)| self.varied(q, |along| along.qpos[i])).collect();
        let qvel = qvel.iter().enumerate().map(|(i, &v)| self.varied(v, |along| along.qvel[i])).collect();
        let state = &State { qpos, qvel };
        let start_s = self.varied(candidate.start_s, |along| along.start_s);
        let run = Run { model, state, start_s, command, columns, sample_times_s, options, states };
        let mut samples = run.through::<S>(layout)?;
        if let Some(error) = samples.failed.iter_mut().find_map(Option::take) {
            return Err(error);
        }
        let (places, lanes) = (&samples.position_m, self.group.len());
        let values = |numbers: &[Dual<L, 1>]| numbers.iter().map(|x| x.value.lane(0)).collect();
        let slopes = |numbers: &[Dual<L, 1>]| numbers_per_lane(numbers, lanes, |x| x.partials[0]);
        Ok(Sensitivities {
            position_m: places.iter().map(|at| at.map(|x| x.value.lane(0))).collect(),
            slopes: per_lane(places, lanes, |x| x.partials[0]),
            qpos: values(&samples.qpos),
            qpos_slopes: slopes(&samples.qpos),
            qvel: values(&samples.qvel),
            qvel_slopes: slopes(&samples.qvel),
        })
    }
}

impl InLanes for Fan<'_> {
    type Output = Result<Sensitivities, RolloutError>;

    fn wanted(&self) -> usize {
        self.group.len()
    }

    fn with<L: Packed>(self) -> Self::Output {
        let model = self.model::<L>();
        let model = model.altered().unwrap_or(model);
        match simulator::plane(&model, self.options) {
            Some(plane) => self.through::<L, Planar<Dual<L, 1>>>(&model, plane),
            None => self.through::<L, Spatial<Dual<L, 1>>>(&model, ()),
        }
    }
}
