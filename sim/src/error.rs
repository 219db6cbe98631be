//! Why a run could not be simulated.

/// Why a run could not be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RolloutError {
    /// A velocity is not a number or absurd.
    #[error(
        "simulation diverged at joint `{joint}` at {time_s} s; take a smaller time step or check the model's numbers"
    )]
    Diverged {
        /// The first joint at fault.
        joint: String,
        /// When \[s\].
        time_s: f64,
    },
    /// A time step that is none.
    #[error("time step {timestep_s} s must be finite and above 0")]
    Timestep {
        /// The step \[s\].
        timestep_s: f64,
    },
    /// A command for an actuator the model does not have.
    #[error("command for `{actuator}`, but the model's actuators are: {known}")]
    UnknownActuator {
        /// The command's column.
        actuator: String,
        /// The model's actuators, listed.
        known: String,
    },
    /// A state of another shape than the model.
    #[error("state has {qpos} coordinates and {qvel} velocities, the model {nq} and {nv}")]
    Shape {
        /// Coordinates given.
        qpos: usize,
        /// Velocities given.
        qvel: usize,
        /// Coordinates wanted.
        nq: usize,
        /// Velocities wanted.
        nv: usize,
    },
    /// An initial state that is no number.
    #[error("initial {what} {index}, of joint `{joint}`, is not finite")]
    BadState {
        /// `qpos` or `qvel`.
        what: &'static str,
        /// Which entry.
        index: usize,
        /// The joint it belongs to.
        joint: String,
    },
    /// A number of the model that cannot be.
    #[error("parameter `{name}` must be {wanted}")]
    BadParameter {
        /// The parameter.
        name: String,
        /// What it must be.
        wanted: &'static str,
    },
    /// Sample times that are no numbers or fall.
    #[error("sample time {index} is {time_s} s: times must be finite and must not fall")]
    SampleTime {
        /// Which one.
        index: usize,
        /// The time \[s\].
        time_s: f64,
    },
    /// No step is as exact as wanted.
    #[error(
        "no step down to {shortest_s} s keeps the keypoints within {accuracy_m} m; ask for less accuracy"
    )]
    Inexact {
        /// The wanted accuracy \[m\].
        accuracy_m: f64,
        /// The shortest step tried \[s\].
        shortest_s: f64,
    },
    /// Something this version cannot do.
    #[error("{what} is not supported; {instead}")]
    Unsupported {
        /// What was asked for.
        what: String,
        /// What to do instead.
        instead: String,
    },
}
