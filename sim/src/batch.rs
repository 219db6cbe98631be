//! Many candidates for one run at once, side by side in SIMD lanes.

use crate::causes::is_soft;
use crate::command::Command;
use crate::dynamics::stages::Stages;
use crate::error::RolloutError;
use crate::lanes::{InLanes, Isa, Packed, dispatch};
use crate::model::{Model, Parameter, State};
use crate::options::RolloutOptions;
use crate::rollout::{self, Run};
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
    for candidate in candidates {
        rollout::check(model, &candidate.state, sample_times_s)?;
    }
    let columns = rollout::columns(model, command)?;
    let isa = if simulator::one_by_one(model, options) { Isa::Baseline } else { isa };
    // how a mechanism is best computed depends on whether its joints rub: a pass has candidates of one kind only
    let rubs = |index: &usize| {
        let mut values = parameters.iter().zip(&candidates[*index].values);
        let is_friction = |place: &Parameter| match *place {
            Parameter::FrictionLoss(_) => true,
            Parameter::Cause(cause, _) => is_soft(&model.causes()[cause]),
            _ => false,
        };
        values.any(|(place, &value)| is_friction(place) && value != 0.0)
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

/// The `part` in question of each of the first `lanes` of `places`, shape (lanes, places). Goes through the places once: they are
/// many and wide.
pub(crate) fn per_lane<T: Scalar, L: Packed>(
    places: &[[T; 3]],
    lanes: usize,
    part: impl Fn(T) -> L,
) -> Vec<Vec<[f64; 3]>> {
    let mut apart: Vec<Vec<[f64; 3]>> = (0..lanes).map(|_| Vec::with_capacity(places.len())).collect();
    let mut numbers = [[0.0; Isa::CANDIDATES_MAX]; 3];
    for place in places {
        for (numbers, &x) in numbers.iter_mut().zip(place) {
            part(x).unpack(numbers);
        }
        let [x, y, z] = &numbers;
        for (lane, own) in apart.iter_mut().enumerate() {
            own.push([x[lane], y[lane], z[lane]]);
        }
    }
    apart
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
    ) -> Result<Vec<Positions>, RolloutError> {
        let Self { group, command, columns, sample_times_s, options, .. } = *self;
        let state = &self.state::<L>();
        let start_s = self.packed(|candidate| candidate.start_s);
        let run = Run { model, state, start_s, command, columns, sample_times_s, options, states: false };
        let samples = run.through::<S>(layout)?;
        let position_m = per_lane(&samples.position_m, group.len(), |x| x);
        let one = |((candidate, position_m), failed): ((&&Candidate, _), _)| match failed {
            // steps are counted on the clock of the commands
            Some(RolloutError::Diverged { joint, time_s }) => {
                Err(RolloutError::Diverged { joint, time_s: time_s + candidate.start_s - options.start_s })
            }
            Some(error) => Err(error),
            None => Ok(position_m),
        };
        Ok(group.iter().zip(position_m).zip(samples.failed).map(one).collect())
    }
}

impl InLanes for Group<'_> {
    type Output = Result<Vec<Positions>, RolloutError>;

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
