//! Why a tank cannot be simulated.

use std::path::PathBuf;

/// Why a tank cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum TankError {
    /// The tank's file was refused.
    #[error("reading the tank")]
    Config(#[from] ground::strict::StrictError),
    /// The model's file cannot be read or was refused.
    #[error("the tank's model {}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Box<sim::MjcfError>,
    },
    /// The initial pose has another number of coordinates than the model.
    #[error("tank: initial_qpos has {got} numbers, the model {wanted} coordinates")]
    InitialPose {
        /// Numbers given.
        got: usize,
        /// Coordinates of the model.
        wanted: usize,
    },
    /// A servo turns an actuator that is not there.
    #[error("tank: a servo turns the actuator `{actuator}`, the model has: {known}")]
    UnknownActuator {
        /// The name given.
        actuator: String,
        /// The model's.
        known: String,
    },
    /// A cause that the tank cannot hide.
    #[error("tank: cause `{cause}`: {reason}")]
    Cause {
        /// Its name.
        cause: String,
        /// Why not.
        reason: String,
    },
    /// A servo that does not turn.
    #[error("tank: us_per_rad of the servo on `{actuator}` is 0; it must be above or below")]
    NoTravel {
        /// The servo's actuator.
        actuator: String,
    },
    /// The simulation refused or diverged.
    #[error("tank: simulating")]
    Simulation(#[from] sim::RolloutError),
}
