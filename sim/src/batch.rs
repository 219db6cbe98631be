//! Many candidates for one run at once, side by side in SIMD lanes.

use crate::command::Command;
use crate::dual::Dual;
use crate::lanes::{InLanes, Isa, Packed, dispatch};
use crate::model::{Model, Parameter, State};
use crate::rollout::{self, RolloutError, RolloutOptions, Run};
use crate::scalar::Scalar;
use crate::simulator;
use crate::space::{Planar, Spatial};

/// One variation of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Value of each parameter in question, SI, shape (P).
    pub values: Vec<f64>,
    /// Initial state.
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
    for candidate in candidates {
        rollout::check(model, &candidate.state, sample_times_s)?;
    }
    let columns = rollout::columns(model, command)?;
    let isa = if simulator::one_by_one(model, options) { Isa::Baseline } else { isa };
    // how a mechanism is best computed depends on whether its joints rub: a pass has candidates of one kind only
    let rubs = |index: &usize| {
        let mut values = parameters.iter().zip(&candidates[*index].values);
        values.any(|(place, &value)| matches!(place, Parameter::FrictionLoss(_)) && value != 0.0)
    };
    let (rubbing, free): (Vec<usize>, Vec<usize>) = (0..candidates.len()).partition(rubs);
    let mut results: Vec<Positions> = vec![Ok(Vec::new()); candidates.len()];
    for places in [rubbing, free].iter().flat_map(|kind| kind.chunks(isa.candidates())) {
        let group: Vec<&Candidate> = places.iter().map(|&place| &candidates[place]).collect();
        let group =
            Group { model, parameters, group: &group, command, columns: &columns, sample_times_s, options };
        for (&place, positions) in places.iter().zip(dispatch(isa, group)?) {
            results[place] = positions;
        }
    }
    for (candidate, result) in candidates.iter().zip(&mut results) {
        let mut values = parameters.iter().zip(&candidate.values);
        let unfit = values.find_map(|(&place, &value)| Some((place, rollout::unfit(place, value)?)));
        if let Some((place, wanted)) = unfit {
            let name = model.parameters().find(|(_, known)| *known == place);
            let name = name.map_or_else(String::new, |(name, _)| name);
            *result = Err(RolloutError::BadParameter { name, wanted });
        }
    }
    Ok(results)
}

/// One way to vary a candidate: the rates at which its numbers change together.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// Of the parameters' values, shape (P).
    pub values: Vec<f64>,
    /// Of the coordinates, shape (nq).
    pub qpos: Vec<f64>,
    /// Of the velocities, shape (nv).
    pub qvel: Vec<f64>,
    /// Of the start.
    pub start_s: f64,
}

/// A candidate's keypoint positions with their derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensitivities {
    /// Positions \[m\], row-major, shape (N, K).
    pub position_m: Vec<[f64; 3]>,
    /// Their derivatives along each direction, shape (directions, N, K).
    pub slopes: Vec<Vec<[f64; 3]>>,
}

/// Keypoint positions of `candidate` and their derivatives along each of `directions`, exact to rounding (forward mode,
/// one direction a lane). Other arguments as for [`positions`].
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
    rollout::check(model, &candidate.state, sample_times_s)?;
    let columns = rollout::columns(model, command)?;
    let mut all = Sensitivities { position_m: Vec::new(), slopes: Vec::with_capacity(directions.len()) };
    // without any direction there still are positions
    let still = [Direction {
        values: vec![0.0; parameters.len()],
        qpos: vec![0.0; candidate.state.qpos.len()],
        qvel: vec![0.0; candidate.state.qvel.len()],
        start_s: 0.0,
    }];
    let isa = if simulator::one_by_one(model, options) { Isa::Baseline } else { isa };
    let groups = if directions.is_empty() { &still } else { directions };
    for group in groups.chunks(isa.directions()) {
        let group =
            Fan { model, parameters, candidate, group, command, columns: &columns, sample_times_s, options };
        let Sensitivities { position_m, slopes } = dispatch(isa, group)?;
        all.position_m = position_m;
        all.slopes.extend(slopes);
    }
    all.slopes.truncate(directions.len());
    Ok(all)
}

/// As many candidates as there are lanes, or fewer.
struct Group<'a> {
    model: &'a Model,
    parameters: &'a [Parameter],
    group: &'a [&'a Candidate],
    command: &'a Command,
    columns: &'a [Option<usize>],
    sample_times_s: &'a [f64],
    options: &'a RolloutOptions,
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
}

impl InLanes for Group<'_> {
    type Output = Result<Vec<Positions>, RolloutError>;
    const MANIFOLD: bool = false;

    fn with<L: Packed>(self) -> Self::Output {
        let (model, state) = (self.model::<L>(), self.state::<L>());
        let model = model.altered().unwrap_or(model);
        let Self { command, columns, sample_times_s, options, .. } = self;
        let start_s = self.packed(|candidate| candidate.start_s);
        let run = Run { model: &model, state: &state, start_s, command, columns, sample_times_s, options };
        let samples = match simulator::plane(&model, options) {
            Some(plane) => run.through::<Planar<L>>(plane),
            None => run.through::<Spatial<L>>(()),
        }?;
        let mut failed = samples.failed;
        Ok((0..self.group.len())
            .map(|lane| match failed[lane].take() {
                // steps are counted on the clock of the commands
                Some(RolloutError::Diverged { joint, time_s }) => {
                    let time_s = time_s + self.group[lane].start_s - options.start_s;
                    Err(RolloutError::Diverged { joint, time_s })
                }
                Some(error) => Err(error),
                None => Ok(samples.position_m.iter().map(|place| place.map(|x| x.lane(lane))).collect()),
            })
            .collect())
    }
}

/// One candidate with as many directions as there are lanes, or fewer.
struct Fan<'a> {
    model: &'a Model,
    parameters: &'a [Parameter],
    candidate: &'a Candidate,
    group: &'a [Direction],
    command: &'a Command,
    columns: &'a [Option<usize>],
    sample_times_s: &'a [f64],
    options: &'a RolloutOptions,
}

impl Fan<'_> {
    /// `value` with its rate along each lane's direction; lanes left over repeat the last one.
    fn varied<L: Packed>(&self, value: f64, rate: impl Fn(&Direction) -> f64) -> Dual<L, 1> {
        let rates = L::pack(|lane| rate(&self.group[lane.min(self.group.len() - 1)]));
        Dual { value: L::from_f64(value), partials: [rates] }
    }
}

impl InLanes for Fan<'_> {
    type Output = Result<Sensitivities, RolloutError>;
    const MANIFOLD: bool = true;

    fn with<L: Packed>(self) -> Self::Output {
        let Self { candidate, command, columns, sample_times_s, options, .. } = self;
        let mut model = self.model.map(Dual::<L, 1>::from_f64);
        for (index, &parameter) in self.parameters.iter().enumerate() {
            model.set(parameter, self.varied(candidate.values[index], |along| along.values[index]));
        }
        let model = model.altered().unwrap_or(model);
        let State { qpos, qvel } = &candidate.state;
        let qpos = qpos.iter().enumerate().map(|(i, &q)| self.varied(q, |along| along.qpos[i])).collect();
        let qvel = qvel.iter().enumerate().map(|(i, &v)| self.varied(v, |along| along.qvel[i])).collect();
        let state = State { qpos, qvel };
        let start_s = self.varied(candidate.start_s, |along| along.start_s);
        let run = Run { model: &model, state: &state, start_s, command, columns, sample_times_s, options };
        let mut samples = match simulator::plane(&model, options) {
            Some(plane) => run.through::<Planar<Dual<L, 1>>>(plane),
            None => run.through::<Spatial<Dual<L, 1>>>(()),
        }?;
        if let Some(error) = samples.failed.iter_mut().find_map(Option::take) {
            return Err(error);
        }
        let places = &samples.position_m;
        let slope = |lane: usize| places.iter().map(|at| at.map(|x| x.partials[0].lane(lane))).collect();
        Ok(Sensitivities {
            position_m: places.iter().map(|at| at.map(|x| x.value.lane(0))).collect(),
            slopes: (0..self.group.len()).map(slope).collect(),
        })
    }
}
