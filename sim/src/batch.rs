//! Many candidates for one run at once, side by side in SIMD lanes.

use crate::command::Command;
use crate::lanes::{InLanes, Isa, Packed, dispatch};
use crate::model::{Model, Parameter, State};
use crate::rollout::{self, RolloutError, RolloutOptions, Run};
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
    let mut results = Vec::with_capacity(candidates.len());
    for group in candidates.chunks(isa.lanes()) {
        let group = Group { model, parameters, group, command, columns: &columns, sample_times_s, options };
        results.extend(dispatch(isa, group)?);
    }
    Ok(results)
}

/// As many candidates as there are lanes, or fewer.
struct Group<'a> {
    model: &'a Model,
    parameters: &'a [Parameter],
    group: &'a [Candidate],
    command: &'a Command,
    columns: &'a [Option<usize>],
    sample_times_s: &'a [f64],
    options: &'a RolloutOptions,
}

impl Group<'_> {
    /// One number of each candidate; lanes left over repeat the last one.
    fn packed<L: Packed>(&self, number: impl Fn(&Candidate) -> f64) -> L {
        L::pack(|lane| number(&self.group[lane.min(self.group.len() - 1)]))
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

    fn with<L: Packed>(self) -> Self::Output {
        let (model, state) = (self.model::<L>(), self.state::<L>());
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
