//! Why an analysis ended early.

use std::path::PathBuf;

use ident::fit::FitError;
use ident::table;

use camera::calibration::CalibrationError;
use config::ConfigError;
use record::RecordError;
use report::GatherError;
use vision::SequenceError;

/// Why an analysis ended early.
#[derive(Debug, thiserror::Error)]
pub enum AnalysisError {
    /// A file of the run.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The config as recorded, or the one given instead.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The calibration.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// The images.
    #[error(transparent)]
    Images(#[from] SequenceError),
    /// The profile as recorded does not fit the config.
    #[error(transparent)]
    Profile(#[from] servo::profile::ProfileError),
    /// A table of the run.
    #[error(transparent)]
    Table(#[from] table::TableError),
    /// The model.
    #[error("model {}", path.display())]
    Model {
        /// The model's file.
        path: PathBuf,
        /// What is wrong with it.
        source: sim::mjcf::MjcfError,
    },
    /// What the config says of the fit does not go with the model.
    #[error(transparent)]
    Experiment(#[from] ident::experiment::ExperimentError),
    /// The fit.
    #[error("fitting")]
    Fit(#[from] FitError),
    /// A driven run that was cut short while the water was still settling.
    #[error(
        "the recording ends before the servo was told to move: there are images to look at, and nothing to fit"
    )]
    NothingMoved,
}

impl From<GatherError> for AnalysisError {
    fn from(error: GatherError) -> Self {
        match error {
            GatherError::Record(error) => Self::Record(error),
            GatherError::Table(error) => Self::Table(error),
        }
    }
}
