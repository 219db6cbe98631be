//! Why there is no fit.

use super::checkpoint::CheckpointError;
use crate::experiment::ExperimentError;
use crate::initial::StartError;
use crate::parameters::ParameterError;

/// Why there is no fit.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// The experiment contradicts itself.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// The `[fit]` table does not go with the model.
    #[error(transparent)]
    Parameters(#[from] ParameterError),
    /// The start of a run cannot be found.
    #[error(transparent)]
    Start(#[from] StartError),
    /// A state file cannot be used.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// Every run is held out.
    #[error(
        "every run is held out; mark at least one `use = \"fit\"`, or fit nothing with `parameters = []`"
    )]
    NothingToFit,
    /// An earlier fit that says nothing about any parameter of this one.
    #[error(
        "the earlier fit says nothing about any fitted parameter; it must be the fit.json of the same mechanism, written by this version"
    )]
    NothingInherited,
    /// Parameters that move no keypoint in any run.
    #[error(
        "no fitted run sees {}: no keypoint moves however {} turned; add a run that does, a `[fit.prior]`, or leave {} out of `parameters`",
        list(.names),
        if .names.len() == 1 { "it is" } else { "they are" },
        if .names.len() == 1 { "it" } else { "them" }
    )]
    Unseen {
        /// Names of the parameters.
        names: Vec<String>,
    },
    /// A run cannot be simulated.
    #[error("simulating run `{run}`")]
    Simulation {
        /// Id of the run.
        run: String,
        /// Where and when it failed.
        source: sim::RolloutError,
    },
    /// No candidate could be simulated.
    #[error(
        "no candidate within the bounds could be simulated; narrow the bounds or shorten the model's time step"
    )]
    NoOptimum,
    /// The observer had enough before there was anything to say.
    #[error("interrupted before the fit had an answer")]
    Interrupted,
}

impl FitError {
    /// Whether the input is well formed, but holds no answer (as against wrong input).
    pub fn is_lack_of_data(&self) -> bool {
        match self {
            Self::Experiment(error) => error.is_lack_of_data(),
            Self::Start(_) | Self::Unseen { .. } | Self::Simulation { .. } | Self::NoOptimum => true,
            Self::Parameters(_)
            | Self::Checkpoint(_)
            | Self::NothingToFit
            | Self::NothingInherited
            | Self::Interrupted => false,
        }
    }
}

/// Names in backticks.
fn list(names: &[String]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}
