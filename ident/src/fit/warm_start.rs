//! Where a fit may begin: what another one, of the first part of the same runs, came to while they were still filmed.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use sim::{Model, State};

use super::fitted::{Fitted, FittedRun};
use crate::initial::Start;
use crate::parameters::{FreeParameter, Parameters};
use crate::simulate::Rehearsal;

/// Values and starts that a descent of `hybrid` begins with in place of the model's own. They only say where it begins: all images
/// count for where it ends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WarmStart {
    /// SI values by parameter.
    parameters: BTreeMap<String, f64>,
    /// Where each run starts.
    runs: BTreeMap<String, RunStart>,
}

/// A run's state at the start of its motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RunStart {
    /// Coordinates \[rad\], \[m\], quaternions.
    qpos: Vec<f64>,
    /// Velocities \[rad/s\], \[m/s\].
    qvel: Vec<f64>,
    /// When the motion starts \[s\].
    start_s: f64,
}

impl WarmStart {
    /// What `fitted` came to.
    pub fn of(fitted: &Fitted) -> Self {
        let parameters = fitted.fit.parameters.iter().map(|p| (p.name.clone(), p.value)).collect();
        let run = |run: &FittedRun| {
            let State { qpos, qvel } = run.initial.clone();
            (run.id.clone(), RunStart { qpos, qvel, start_s: run.start_s })
        };
        Self { parameters, runs: fitted.runs.iter().map(run).collect() }
    }

    /// Its values of `parameters`; none where it lacks one or has it outside the bounds.
    pub(super) fn values(&self, parameters: &Parameters) -> Option<Vec<f64>> {
        let value = |parameter: &FreeParameter| {
            let value = *self.parameters.get(parameter.name())?;
            (parameter.scale.lower()..=parameter.scale.upper()).contains(&value).then_some(value)
        };
        parameters.free.iter().map(value).collect()
    }

    /// Where it has the run of `rehearsal` start; at that one's own estimate, if it does not know the run.
    pub(super) fn offsets(&self, model: &Model, rehearsal: &Rehearsal<'_>) -> Vec<f64> {
        let known = self.runs.get(&rehearsal.run.id);
        let shaped = |start: &&RunStart| start.qpos.len() == model.nq() && start.qvel.len() == model.nv();
        known.filter(shaped).map_or_else(
            || vec![0.0; rehearsal.nuisances.len()],
            |RunStart { qpos, qvel, start_s }| {
                let state = State { qpos: qpos.clone(), qvel: qvel.clone() };
                rehearsal.offsets_to(model, &Start { state, start_s: *start_s })
            },
        )
    }
}
