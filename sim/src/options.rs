//! How a run is stepped.

use std::sync::Arc;

use crate::base::BasePath;
use crate::model::Integrator;
use crate::steps::Steps;

/// How a run is stepped.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RolloutOptions {
    /// Integrator; `None`: the model's own.
    pub integrator: Option<Integrator>,
    /// Time step \[s\]; `None`: the model's own.
    pub timestep_s: Option<f64>,
    /// Hold the command over each step, as MuJoCo does, instead of sampling it at Runge-Kutta's stages.
    pub hold_command: bool,
    /// The joints of position drives follow their commands exactly, see
    /// [`Simulator`](crate::Simulator); a drive without a command leaves its joint free.
    pub prescribed: bool,
    /// Where the base goes; `None`: it stands. Coordinates count from the base, keypoints are where they are in the world. Before the motion
    /// starts the base goes already, the joints are held.
    pub base: Option<Arc<BasePath>>,
    /// When motion starts \[s\]; until then the initial state is held.
    pub start_s: f64,
    /// Our own steps instead of MuJoCo's: integrator, time step and `hold_command` then play no part.
    pub steps: Option<Steps>,
}
