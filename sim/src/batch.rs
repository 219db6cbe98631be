//! Many candidates for one run at once, side by side in SIMD lanes.

use rayon::prelude::*;

use crate::causes::is_soft;
use crate::command::Command;
use crate::dynamics::stages::Stages;
use crate::error::RolloutError;
use crate::lanes::{InLanes, Isa, Packed, dispatch};
use crate::model::{Model, Parameter, State};
use crate::options::RolloutOptions;
use crate::rollout::{self, Rollout, Run};
use crate::scalar::Scalar;
use crate::simulator;
use crate::space::{Planar, Spatial};

/// One variation of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Value of each parameter in question, SI, shape (P).
    pub values: Vec<f64>,
    /// State at the start of the motion.
    pub state: State,
    /// When motion starts \[s\]; takes the place of [`RolloutOptions::start_s`], which stays the time at which commands begin.
    pub start_s: f64,
}

/// A candidate's keypoint positions \[m\], row-major, shape (N, K).
pub type Positions = Result<Vec<[f64; 3]>, RolloutError>;

/// Keypoint positions \[m\] of each candidate, row-major, shape (N, K), as [`rollout`](crate::rollout()) computes them alone, to
/// the bit. `parameters`, shape (P), are set in `model` to the candidate's values. A candidate that diverges has its
/// own error and disturbs nobody.
///
/// # Errors
/// [`RolloutError`], for input that suits no candidate.
pub fn positions(
    model: &Model,
    parameters: &[Parameter],
    candidates: &[Candidate],
    command: &Command,
    sample_times_s: &[f64],
    options: &RolloutOptions,
    isa: Isa,
) -> Result<Vec<Positions>, RolloutError> {
    let batch = Batch { model, parameters, candidates, command, sample_times_s, options, states: false };
    let passes: Result<Vec<_>, _> = batch.passes(isa)?.iter().map(|places| batch.pass(places, isa)).collect();
    let mut results: Vec<Positions> = vec![Ok(Vec::new()); candidates.len()];
    for (place, outcome) in passes?.into_iter().flatten() {
        results[place] = outcome.map(|samples| samples.position_m);
    }
    Ok(results)
}

/// The run of each candidate, coordinates and velocities too, as [`rollout`](crate::rollout()) computes it alone, to the bit; for
/// arguments and candidates that diverge see [`positions`]. The threads of the caller's pool share the candidates.
///
/// # Errors
/// [`RolloutError`], for input that suits no candidate.
pub fn rollouts(
    model: &Model,
    parameters: &[Parameter],
    candidates: &[Candidate],
    command: &Command,
    sample_times_s: &[f64],
    options: &RolloutOptions,
    isa: Isa,
) -> Result<Vec<Result<Rollout<f64>, RolloutError>>, RolloutError> {
    let batch = Batch { model, parameters, candidates, command, sample_times_s, options, states: true };
    let passes = batch.passes(isa)?;
    let passes: Result<Vec<_>, _> = passes.par_iter().map(|places| batch.pass(places, isa)).collect();
    let mut all: Vec<_> = passes?.into_iter().flatten().collect();
    all.sort_by_key(|(place, _)| *place);
    let keypoints = model.marks();
    let whole = |Lane { qpos, qvel, position_m }: Lane| Rollout {
        time_s: sample_times_s.to_vec(),
        qpos,
        qvel,
        keypoints: keypoints.clone(),
        position_m,
    };
    Ok(all.into_iter().map(|(_, outcome)| outcome.map(whole)).collect())
}

/// One candidate's samples; coordinates and velocities are empty where nobody asks for them.
struct Lane {
    qpos: Vec<f64>,
    qvel: Vec<f64>,
    position_m: Vec<[f64; 3]>,
}

/// What became of the candidate at a place.
type Outcome = (usize, Result<Lane, RolloutError>);

/// All candidates of a run, to be simulated in passes of as many as there are lanes.
struct Batch<'a> {
    model: &'a Model,
    parameters: &'a [Parameter],
    candidates: &'a [Candidate],
    command: &'a Command,
    sample_times_s: &'a [f64],
    options: &'a RolloutOptions,
    /// Whether coordinates and velocities are asked for, or keypoints only.
    states: bool,
}

impl Batch<'_> {
    /// Which candidates share a pass.
    fn passes(&self, isa: Isa) -> Result<Vec<Vec<usize>>, RolloutError> {
        for candidate in self.candidates {
            rollout::check(self.model, &candidate.state, self.sample_times_s)?;
        }
        let lanes = self.isa(isa).candidates();
        // how a mechanism is best computed depends on whether its joints rub: a pass has candidates of one kind only
        let (rubbing, free): (Vec<usize>, Vec<usize>) =
            (0..self.candidates.len()).partition(|&index| self.rubs(index));
        Ok([rubbing, free].iter().flat_map(|kind| kind.chunks(lanes).map(<[usize]>::to_vec)).collect())
    }

    fn isa(&self, isa: Isa) -> Isa {
        if simulator::one_by_one(self.model, self.options) { Isa::Baseline } else { isa }
    }

    fn rubs(&self, index: usize) -> bool {
        let mut values = self.parameters.iter().zip(&self.candidates[index].values);
        let is_friction = |place: &Parameter| match *place {
            Parameter::FrictionLoss(_) => true,
            Parameter::Cause(cause, _) => is_soft(&self.model.causes()[cause]),
            _ => false,
        };
        values.any(|(place, &value)| is_friction(place) && value != 0.0)
    }

    /// Simulates the candidates at `places`.
    fn pass(&self, places: &[usize], isa: Isa) -> Result<Vec<Outcome>, RolloutError> {
        let &Self { model, parameters, candidates, command, sample_times_s, options, states } = self;
        let group: Vec<&Candidate> = places.iter().map(|&place| &candidates[place]).collect();
        let columns = &rollout::columns(model, command)?;
        let group =
            Group { model, parameters, group: &group, command, columns, sample_times_s, options, states };
        let lanes = dispatch(self.isa(isa), group)?;
        let fit = |(&place, lane)| match self.unfit(&candidates[place]) {
            Some(error) => (place, Err(error)),
            None => (place, lane),
        };
        Ok(places.iter().zip(lanes).map(fit).collect())
    }

    /// Why a value of `candidate` cannot be.
    fn unfit(&self, candidate: &Candidate) -> Option<RolloutError> {
        let mut values = self.parameters.iter().zip(&candidate.values);
        let (place, wanted) =
            values.find_map(|(&place, &value)| Some((place, rollout::unfit(place, value)?)))?;
        let name = self.model.parameters().find(|(_, known)| *known == place);
        Some(RolloutError::BadParameter { name: name.map_or_else(String::new, |(name, _)| name), wanted })
    }
}

/// The `part` in question of each of the first `lanes` of `places`, shape (lanes, places). Goes through the places once: they are
/// many and wide.
pub(crate) fn per_lane<T: Scalar, L: Packed, const N: usize>(
    places: &[[T; N]],
    lanes: usize,
    part: impl Fn(T) -> L,
) -> Vec<Vec<[f64; N]>> {
    let mut apart: Vec<Vec<[f64; N]>> = (0..lanes).map(|_| Vec::with_capacity(places.len())).collect();
    let mut numbers = [[0.0; Isa::CANDIDATES_MAX]; N];
    for place in places {
        for (numbers, &x) in numbers.iter_mut().zip(place) {
            part(x).unpack(numbers);
        }
        for (lane, own) in apart.iter_mut().enumerate() {
            own.push(std::array::from_fn(|axis| numbers[axis][lane]));
        }
    }
    apart
}

/// The same of single numbers, shape (lanes, numbers).
pub(crate) fn numbers_per_lane<T: Scalar, L: Packed>(
    numbers: &[T],
    lanes: usize,
    part: impl Fn(T) -> L,
) -> Vec<Vec<f64>> {
    let apart = per_lane(numbers.as_chunks::<1>().0, lanes, part);
    apart.into_iter().map(Vec::into_flattened).collect()
}

/// As many candidates as there are lanes, or fewer.
#[derive(Clone, Copy)]
struct Group<'a> {
    model: &'a Model,
    parameters: &'a [Parameter],
    group: &'a [&'a Candidate],
    command: &'a Command,
    columns: &'a [Option<usize>],
    sample_times_s: &'a [f64],
    options: &'a RolloutOptions,
    states: bool,
}

impl Group<'_> {
    /// One number of each candidate; lanes left over repeat the last one.
    fn packed<L: Packed>(&self, number: impl Fn(&Candidate) -> f64) -> L {
        L::pack(|lane| number(self.group[lane.min(self.group.len() - 1)]))
    }

    fn model<L: Packed>(&self) -> Model<L> {
        let mut model = self.model.map(L::from_f64);
        for (index, &parameter) in self.parameters.iter().enumerate() {
            model.set(parameter, self.packed(|candidate| candidate.values[index]));
        }
        model
    }

    fn state<L: Packed>(&self) -> State<L> {
        let State { qpos, qvel } = &self.group[0].state;
        State {
            qpos: (0..qpos.len()).map(|i| self.packed(|candidate| candidate.state.qpos[i])).collect(),
            qvel: (0..qvel.len()).map(|i| self.packed(|candidate| candidate.state.qvel[i])).collect(),
        }
    }

    fn through<L: Packed, S: Stages<T = L>>(
        &self,
        model: &Model<L>,
        layout: S::Layout,
    ) -> Result<Vec<Result<Lane, RolloutError>>, RolloutError> {
        let Self { group, command, columns, sample_times_s, options, states, .. } = *self;
        let state = &self.state::<L>();
        let start_s = self.packed(|candidate| candidate.start_s);
        let run = Run { model, state, start_s, command, columns, sample_times_s, options, states };
        let samples = run.through::<S>(layout)?;
        let position_m = per_lane(&samples.position_m, group.len(), |x| x);
        let qpos = numbers_per_lane(&samples.qpos, group.len(), |x| x);
        let qvel = numbers_per_lane(&samples.qvel, group.len(), |x| x);
        let lanes = qpos.into_iter().zip(qvel).zip(position_m).map(|((qpos, qvel), position_m)| Lane {
            qpos,
            qvel,
            position_m,
        });
        let one = |((candidate, lane), failed): ((&&Candidate, _), _)| match failed {
            // steps are counted on the clock of the commands
            Some(RolloutError::Diverged { joint, time_s }) => {
                Err(RolloutError::Diverged { joint, time_s: time_s + candidate.start_s - options.start_s })
            }
            Some(error) => Err(error),
            None => Ok(lane),
        };
        Ok(group.iter().zip(lanes).zip(samples.failed).map(one).collect())
    }
}

impl InLanes for Group<'_> {
    type Output = Result<Vec<Result<Lane, RolloutError>>, RolloutError>;

    fn wanted(&self) -> usize {
        self.group.len()
    }

    fn with<L: Packed>(self) -> Self::Output {
        let model = self.model::<L>();
        let model = model.altered().unwrap_or(model);
        match simulator::plane(&model, self.options) {
            Some(plane) => self.through::<L, Planar<L>>(&model, plane),
            None => self.through::<L, Spatial<L>>(&model, ()),
        }
    }
}
