//! How a run answers to small forces, piece by piece.
//!
//! A force on a joint at one instant moves everything after it. Instead of a derivative of the whole run for each such force, the run is cut
//! into short pieces: for each piece the derivatives of the state at its end, and of what is seen in it, by the state at its start and by
//! forces in it are computed, exact to rounding (forward mode, one direction a lane, unit slopes put in anew at the start of each piece).
//! What any force over time does then follows by products of these small matrices, see [`Transitions::response`]: the cost is that of a
//! dozen directions, however many forces are asked about.
//!
//! The camera's causes are left out, and what a cause remembers from step to step (Basset's force) is cut at the pieces' ends.

use crate::batch::{Candidate, per_lane};
use crate::command::Command;
use crate::dual::Dual;
use crate::dynamics::stages::Stages;
use crate::error::RolloutError;
use crate::lanes::{InLanes, Isa, Packed, dispatch_dual};
use crate::model::cause::Kind;
use crate::model::{Model, Parameter, State};
use crate::options::RolloutOptions;
use crate::rollout::{self, Run};
use crate::scalar::Scalar;
use crate::simulator::{self, AppliedForce};
use crate::space::{Planar, Spatial};

/// A run cut into pieces, each with its derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct Transitions {
    /// When pieces begin and the last one ends \[s\], shape (pieces + 1); all of them ends of steps.
    pub knots_s: Vec<f64>,
    /// The state at each of these.
    pub states: Vec<State>,
    /// For each sample, the piece that it lies in.
    pieces: Vec<usize>,
    /// For each piece, the derivative of the state at its end by each direction, shape (pieces, directions, nq + nv). Directions are the
    /// coordinates and velocities at its start, then the force on each degree of freedom, then its rate.
    carried: Vec<Vec<Vec<f64>>>,
    /// Derivatives of the marks' positions by each direction of the sample's piece, shape (directions, N, K).
    slopes: Vec<Vec<[f64; 3]>>,
    nv: usize,
}

/// Cuts the run of `candidate` into pieces of at least `piece_s` \[s\]. Other arguments as for [`batch::positions`](crate::batch::positions).
///
/// # Errors
/// [`RolloutError`].
#[expect(clippy::too_many_arguments, reason = "a run, a point and the pieces' length")]
pub fn transitions(
    model: &Model,
    parameters: &[Parameter],
    candidate: &Candidate,
    piece_s: f64,
    command: &Command,
    sample_times_s: &[f64],
    options: &RolloutOptions,
    isa: Isa,
) -> Result<Transitions, RolloutError> {
    rollout::check(model, &candidate.state, sample_times_s)?;
    let mut model = model.clone();
    for (&parameter, &value) in parameters.iter().zip(&candidate.values) {
        model.set(parameter, value);
    }
    let of_camera: Vec<_> = model.causes().iter().map(crate::CauseValues::cause).collect();
    for cause in of_camera.into_iter().filter(|cause| cause.info().kind == Kind::Camera) {
        model.remove_cause(cause);
    }
    let columns = rollout::columns(&model, command)?;
    let isa = if simulator::one_by_one(&model, options) { Isa::Baseline } else { isa };
    let directions: Vec<usize> = (0..model.nq() + 3 * model.nv()).collect();
    let mut all: Option<Transitions> = None;
    for group in directions.chunks(isa.directions()) {
        let (model, columns) = (&model, &columns[..]);
        let fan = Fan { model, candidate, group, piece_s, command, columns, sample_times_s, options };
        let part = dispatch_dual(isa, fan)?;
        match &mut all {
            None => all = Some(part),
            Some(all) => {
                for (whole, part) in all.carried.iter_mut().zip(part.carried) {
                    whole.extend(part);
                }
                all.slopes.extend(part.slopes);
            }
        }
    }
    // there is at least one coordinate, or nothing could have been checked
    all.ok_or(RolloutError::Shape { qpos: 0, qvel: 0, nq: model.nq(), nv: model.nv() })
}

impl Transitions {
    /// By how much the marks move, per unit of a force on the degree of freedom `dof` that has the values `force` at
    /// [`Transitions::knots_s`] and goes straight in between, shape (N, K).
    pub fn response(&self, dof: usize, force: &[f64]) -> Vec<[f64; 3]> {
        let width = self.states.first().map_or(0, |state| state.qpos.len() + state.qvel.len());
        let (level_of, rate_of) = (width + dof, width + self.nv + dof);
        let marks = self.slopes.first().map_or(0, Vec::len) / self.pieces.len().max(1);
        let mut moved = vec![[0.0; 3]; self.pieces.len() * marks];
        let mut state = vec![0.0; width];
        let mut row = 0;
        for (piece, carried) in self.carried.iter().enumerate() {
            let length_s = self.knots_s[piece + 1] - self.knots_s[piece];
            let (level, rate) = (force[piece], (force[piece + 1] - force[piece]) / length_s);
            let still = level == 0.0 && rate == 0.0 && state.iter().all(|x| *x == 0.0);
            let along = || state.iter().copied().enumerate().chain([(level_of, level), (rate_of, rate)]);
            while row < self.pieces.len() && self.pieces[row] <= piece {
                if !still {
                    for (direction, size) in along().filter(|(_, size)| *size != 0.0) {
                        let slopes = &self.slopes[direction][row * marks..(row + 1) * marks];
                        for (at, slope) in moved[row * marks..(row + 1) * marks].iter_mut().zip(slopes) {
                            at.iter_mut().zip(slope).for_each(|(x, slope)| *x += size * slope);
                        }
                    }
                }
                row += 1;
            }
            if !still {
                let mut next = vec![0.0; width];
                for (direction, size) in along().filter(|(_, size)| *size != 0.0) {
                    next.iter_mut().zip(&carried[direction]).for_each(|(x, slope)| *x += size * slope);
                }
                state = next;
            }
        }
        moved
    }
}

/// One run with as many directions as there are lanes, or fewer.
#[derive(Clone, Copy)]
struct Fan<'a> {
    model: &'a Model,
    candidate: &'a Candidate,
    group: &'a [usize],
    piece_s: f64,
    command: &'a Command,
    columns: &'a [Option<usize>],
    sample_times_s: &'a [f64],
    options: &'a RolloutOptions,
}

impl Fan<'_> {
    /// `value` with slope 1 in the lane of `direction`; lanes left over repeat the last one.
    fn unit<L: Packed>(&self, value: L, direction: usize) -> Dual<L, 1> {
        let slope =
            L::pack(|lane| f64::from(u8::from(self.group[lane.min(self.group.len() - 1)] == direction)));
        Dual { value, partials: [slope] }
    }

    fn through<L: Packed, S: Stages<T = Dual<L, 1>>>(
        &self,
        model: &Model<Dual<L, 1>>,
        layout: S::Layout,
    ) -> Result<Transitions, RolloutError> {
        let Self { candidate, command, columns, sample_times_s, options, .. } = *self;
        let constant = |numbers: &[f64]| numbers.iter().map(|&x| Dual::<L, 1>::from_f64(x)).collect();
        let state = &State { qpos: constant(&candidate.state.qpos), qvel: constant(&candidate.state.qvel) };
        let start_s = Dual::from_f64(candidate.start_s);
        let run = Run { model, state, start_s, command, columns, sample_times_s, options, states: false };
        let (nq, nv, lanes) = (state.qpos.len(), state.qvel.len(), self.group.len());
        let mut ends_s: Vec<f64> = Vec::new();
        let mut states: Vec<State> = Vec::new();
        let mut carried: Vec<Vec<Vec<f64>>> = Vec::new();
        let mut latest_s = 0.0;
        let mut samples = run.through_with::<S>(layout, |engine, state, passed_s| {
            latest_s = passed_s;
            if ends_s.last().is_some_and(|begin_s| passed_s - begin_s < self.piece_s) {
                return;
            }
            if !ends_s.is_empty() {
                let all = || state.qpos.iter().chain(&state.qvel);
                let of = |lane: usize| all().map(|x| x.partials[0].lane(lane)).collect();
                carried.push((0..lanes).map(of).collect());
            }
            ends_s.push(passed_s);
            let plain = |numbers: &[Dual<L, 1>]| numbers.iter().map(|x| x.value.lane(0)).collect();
            states.push(State { qpos: plain(&state.qpos), qvel: plain(&state.qvel) });
            for (direction, x) in state.qpos.iter_mut().chain(&mut state.qvel).enumerate() {
                *x = self.unit(x.value, direction);
            }
            let force = |dof: usize| AppliedForce {
                level: self.unit(L::ZERO, nq + nv + dof),
                rate: self.unit(L::ZERO, nq + 2 * nv + dof),
                from_s: options.start_s + passed_s,
            };
            engine.applied = (0..nv).map(force).collect();
        })?;
        if let Some(error) = samples.failed.iter_mut().find_map(Option::take) {
            return Err(error);
        }
        // the last piece is a short one, of which nobody asks where it leads
        carried.push(vec![vec![0.0; nq + nv]; lanes]);
        ends_s.push(latest_s.max(ends_s.last().map_or(0.0, |last_s| last_s + self.piece_s)));
        states.extend(states.last().cloned());
        let piece = |time_s: f64| {
            let passed_s = time_s - candidate.start_s;
            // what lies within rounding of a step's end was seen in that step
            let begun = ends_s.partition_point(|end_s| end_s + SAME_INSTANT_S < passed_s);
            begun.clamp(1, carried.len()) - 1
        };
        Ok(Transitions {
            pieces: sample_times_s.iter().map(|&time_s| piece(time_s)).collect(),
            slopes: per_lane(&samples.position_m, lanes, |x| x.partials[0]),
            knots_s: ends_s.iter().map(|end_s| candidate.start_s + end_s).collect(),
            states,
            carried,
            nv,
        })
    }
}

/// Instants this near to each other are one \[s\] (chosen): far below any step, far above rounding.
const SAME_INSTANT_S: f64 = 1e-12;

impl InLanes for Fan<'_> {
    type Output = Result<Transitions, RolloutError>;

    fn wanted(&self) -> usize {
        self.group.len()
    }

    fn with<L: Packed>(self) -> Self::Output {
        let model = self.model.map(Dual::<L, 1>::from_f64);
        let model = model.altered().unwrap_or(model);
        match simulator::plane(&model, self.options) {
            Some(plane) => self.through::<L, Planar<Dual<L, 1>>>(&model, plane),
            None => self.through::<L, Spatial<Dual<L, 1>>>(&model, ()),
        }
    }
}
