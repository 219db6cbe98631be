//! The reference models and their runs, which the examples and benches share.
#![allow(dead_code, reason = "each uses its share")]

use sim::batch::Candidate;
use sim::{Command, Integrator, Method, Model, Plan, RolloutError, RolloutOptions, State, Steps};

/// Names, models and amplitudes of the stroke \[rad\].
pub(crate) const MODELS: [(&str, &str, f64); 5] = [
    ("chain_passive", include_str!("../../tests/data/chain_passive.xml"), 0.0),
    ("chain_friction", include_str!("../../tests/data/chain_friction.xml"), 0.0),
    ("chain_active", include_str!("../../tests/data/chain_active.xml"), 0.6),
    ("arm8", include_str!("../../tests/data/arm8.xml"), 0.6),
    ("octopus8", include_str!("../../tests/data/octopus8.xml"), 0.5),
];
/// Our ways of stepping and what they are called here.
pub(crate) const METHODS: [(Method, &str); 2] =
    [(Method::RungeKutta, "runge-kutta"), (Method::Rosenbrock, "rosenbrock")];

/// One model's run: a passive chain drops from horizontal, the others follow the 2:1 stroke.
pub(crate) struct Case {
    pub(crate) model: Model,
    pub(crate) state: State,
    pub(crate) command: Command,
    pub(crate) duration_s: f64,
}

impl Case {
    /// The run of the model called `name`.
    pub(crate) fn named(name: &str) -> Result<Option<Self>, Box<dyn std::error::Error>> {
        let case = MODELS.into_iter().find(|(known, ..)| *known == name);
        case.map(|(name, text, amplitude_rad)| Self::new(name, text, amplitude_rad)).transpose()
    }

    /// The run of `text`.
    pub(crate) fn new(
        name: &str,
        text: &str,
        amplitude_rad: f64,
    ) -> Result<Self, Box<dyn std::error::Error>> {
        let model = Model::from_mjcf(text)?;
        let mut state = model.rest_state();
        if model.actuators.is_empty() {
            state.qpos[0] = std::f64::consts::FRAC_PI_2;
        }
        // the stroke's corners are among these: up for 1 s, down for 0.5 s, at 0 first
        let time_s: Vec<f64> = (0..=20).map(|k| 0.5 * f64::from(k)).collect();
        let angle = |t: f64| match (t + 0.5) % 1.5 {
            p if p < 1.0 => amplitude_rad * (2.0 * p - 1.0),
            p => amplitude_rad * (5.0 - 4.0 * p),
        };
        let actuators: Vec<String> = model.actuators.iter().map(|actuator| actuator.name.clone()).collect();
        let angle_rad = time_s.iter().flat_map(|&t| std::iter::repeat_n(angle(t), actuators.len())).collect();
        let duration_s = if name == "octopus8" { 1.0 } else { 10.0 };
        Ok(Self { model, state, command: Command { actuators, time_s, angle_rad }, duration_s })
    }

    pub(crate) fn mujoco(integrator: Integrator, timestep_s: f64) -> RolloutOptions {
        RolloutOptions {
            integrator: Some(integrator),
            timestep_s: Some(timestep_s),
            ..RolloutOptions::default()
        }
    }

    pub(crate) fn ours(method: Method, longest_s: f64) -> RolloutOptions {
        RolloutOptions { steps: Some(Steps::even(method, longest_s)), ..RolloutOptions::default() }
    }

    /// Each 20 ms [s].
    pub(crate) fn samples(&self) -> Vec<f64> {
        (0..=(self.duration_s * 50.0) as u32).map(|k| f64::from(k) * 0.02).collect()
    }

    /// Steps as exact as `accuracy_m` \[m\].
    pub(crate) fn plan(&self, accuracy_m: f64) -> Result<Plan, RolloutError> {
        let options = RolloutOptions::default();
        sim::plan(&self.model, &self.state, &self.command, &self.samples(), &options, accuracy_m)
    }

    /// So many times the same candidate.
    pub(crate) fn candidates(&self, count: usize) -> Vec<Candidate> {
        vec![Candidate { values: Vec::new(), state: self.state.clone(), start_s: 0.0 }; count]
    }
}
