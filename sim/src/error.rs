//! Why a run could not be simulated.

/// Why a run could not be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RolloutError {
    /// A velocity is not finite, or beyond any that a mechanism reaches.
    #[error(
        "simulation diverged at joint `{joint}` at {time_s} s; take a smaller time step or check the model's numbers"
    )]
    Diverged {
        /// Name of the first joint whose velocity is.
        joint: String,
        /// Time of the run at which it is noticed \[s\].
        time_s: f64,
    },
    /// A time step that is not finite or not above 0.
    #[error("time step {timestep_s} s must be finite and above 0")]
    Timestep {
        /// The time step \[s\].
        timestep_s: f64,
    },
    /// A command for an actuator the model does not have.
    #[error("command for `{actuator}`, but the model's actuators are: {known}")]
    UnknownActuator {
        /// Name of the command's column.
        actuator: String,
        /// The model's actuators, listed.
        known: String,
    },
    /// A state of another shape than the model.
    #[error("state has {qpos} coordinates and {qvel} velocities, the model {nq} and {nv}")]
    Shape {
        /// Number of coordinates in the state.
        qpos: usize,
        /// Number of velocities in the state.
        qvel: usize,
        /// Number of coordinates of the model.
        nq: usize,
        /// Number of velocities of the model.
        nv: usize,
    },
    /// An initial state with a number that is not finite.
    #[error("initial {what} {index}, of joint `{joint}`, is not finite")]
    BadState {
        /// `qpos` or `qvel`.
        what: &'static str,
        /// Index of the entry that is not finite.
        index: usize,
        /// Name of the joint it belongs to.
        joint: String,
    },
    /// A parameter of the model with an impossible value.
    #[error("parameter `{name}` must be {wanted}")]
    BadParameter {
        /// Name of the parameter.
        name: String,
        /// What it must be.
        wanted: &'static str,
    },
    /// Sample times that are not finite, or that fall.
    #[error("sample time {index} is {time_s} s: times must be finite and must not fall")]
    SampleTime {
        /// Index of the sample.
        index: usize,
        /// Its time \[s\].
        time_s: f64,
    },
    /// No time step reaches the wanted accuracy.
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
