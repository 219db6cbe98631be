//! Why there is no diagnosis.

use crate::fit::FitError;

/// Why there is no diagnosis.
#[derive(Debug, thiserror::Error)]
pub enum DiagnoseError {
    /// The model cannot be fitted to the runs as it stands.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A run is wanted for a parameter that is not fitted.
    #[error("`{name}` is not fitted, so no run can pin it down{hint}; add it to `[fit] parameters`")]
    NotFitted {
        /// The name.
        name: String,
        /// The nearest name.
        hint: String,
    },
    /// The observer had enough.
    #[error("stopped before there was a verdict")]
    Interrupted,
}

impl DiagnoseError {
    /// Whether the input is well formed, but holds no answer (as against wrong input).
    pub fn is_lack_of_data(&self) -> bool {
        match self {
            Self::Fit(error) => error.is_lack_of_data(),
            Self::NotFitted { .. } | Self::Interrupted => false,
        }
    }
}

macro_rules! through_fit {
    ($($error:ty),+) => {
        $(impl From<$error> for DiagnoseError {
            fn from(error: $error) -> Self {
                Self::Fit(error.into())
            }
        })+
    };
}

through_fit!(
    crate::experiment::ExperimentError,
    crate::parameters::ParameterError,
    crate::initial::StartError
);
