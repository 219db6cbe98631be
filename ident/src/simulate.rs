//! A run as the simulation repeats it: from a model and what is uncertain about the run's start to keypoints.
//!
//! Each run has nuisances of its own: the coordinates of its initial pose, its rates if it is `free`, its
//! release if nobody stated it. They are offsets from the estimates of [`crate::initial`], 0 at first.

use sim::{Command, Model, RolloutError, RolloutOptions, State, rollout};

use crate::experiment::{Run, RunKind};
use crate::geometry::moved;
use crate::initial::{Estimate, Start, prescribed_dofs};

/// One uncertain number about the start of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Nuisance {
    /// Offset of the coordinate that belongs to this degree of freedom \[rad\] or \[m\].
    Coordinate(usize),
    /// Offset of this velocity \[rad/s\] or \[m/s\].
    Rate(usize),
    /// Offset of the release \[s\], within these bounds.
    Release {
        /// The release is not before the first image.
        lower: f64,
        /// The release is not after motion is beyond doubt.
        upper: f64,
    },
}

impl Nuisance {
    /// Step of a finite difference: far above rounding, far below what an image resolves.
    pub(crate) fn step(self) -> f64 {
        match self {
            Self::Coordinate(_) => 1e-6,
            Self::Rate(_) | Self::Release { .. } => 1e-5,
        }
    }

    /// Standard deviation of a belief so weak that it speaks only where the images are silent: half a radian, 50
    /// rad/s, the interval in which the release was seen.
    pub(crate) fn belief(self) -> f64 {
        match self {
            Self::Coordinate(_) => 0.5,
            Self::Rate(_) => 50.0,
            Self::Release { lower, upper } => (upper - lower).max(1e-3),
        }
    }

    /// `offset`, no further than physics allows.
    pub(crate) fn clamp(self, offset: f64) -> f64 {
        match self {
            Self::Release { lower, upper } => offset.clamp(lower, upper),
            Self::Coordinate(_) | Self::Rate(_) => offset,
        }
    }
}

/// A run made ready to be simulated again and again.
#[derive(Debug, Clone)]
pub struct Rehearsal<'a> {
    /// The run.
    pub run: &'a Run,
    /// Where the offsets count from.
    pub start: Start,
    /// What is uncertain about the start.
    pub nuisances: Vec<Nuisance>,
    command: Command,
    /// For each measured keypoint, the model's.
    columns: Vec<usize>,
}

impl<'a> Rehearsal<'a> {
    /// Makes `run` ready with its `estimate`; keypoints that the model does not have must have been refused
    /// before ([`crate::experiment::Experiment::check`]).
    pub fn new(model: &Model, run: &'a Run, estimate: Estimate) -> Self {
        let mut nuisances = Vec::new();
        if run.initial.is_none() {
            let frozen = prescribed_dofs(model, run);
            let free = (0..model.nv()).filter(|&dof| !frozen[dof]);
            nuisances.extend(free.map(Nuisance::Coordinate));
            if run.kind == RunKind::Free {
                nuisances.extend((0..model.nv()).map(Nuisance::Rate));
            }
        }
        if let Some(release) = estimate.release {
            let from = estimate.start.start_s;
            nuisances
                .push(Nuisance::Release { lower: release.earliest_s - from, upper: release.latest_s - from });
        }
        let known = model.keypoints();
        let columns = run.trajectory.keypoints.iter().filter_map(|name| known.iter().position(|k| k == name));
        // Prescribed joints are free in drops, which is what no command at all means to the simulation.
        let silent = run.prescribed && run.kind != RunKind::Driven;
        let command = run.command.clone().filter(|_| !silent).unwrap_or_default();
        Self { run, start: estimate.start, nuisances, command, columns: columns.collect() }
    }

    /// Start of the motion with `offsets`, one per nuisance.
    pub fn start_with(&self, model: &Model, offsets: &[f64]) -> Start {
        let mut delta = vec![0.0; model.nv()];
        let mut qvel = self.start.state.qvel.clone();
        let mut start_s = self.start.start_s;
        for (nuisance, &offset) in self.nuisances.iter().zip(offsets) {
            match *nuisance {
                Nuisance::Coordinate(dof) => delta[dof] = offset,
                Nuisance::Rate(dof) => qvel[dof] += offset,
                Nuisance::Release { .. } => start_s += offset,
            }
        }
        Start { state: State { qpos: moved(model, &self.start.state.qpos, &delta), qvel }, start_s }
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
        let Start { state, start_s } = self.start_with(model, offsets);
        let options =
            RolloutOptions { prescribed: self.run.prescribed, start_s, ..RolloutOptions::default() };
        let rollout =
            rollout(model, &state, &self.command, &self.run.trajectory.time_s[..instants], &options)?;
        let width = rollout.keypoints.len();
        let rows = 0..instants;
        Ok(rows
            .flat_map(|row| self.columns.iter().map(move |k| (row, k)))
            .map(|(row, k)| rollout.position_m[row * width + k])
            .collect())
    }
}
