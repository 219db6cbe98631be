//! What the Python package `tankrig` takes from the program: models and their motion, fits, diagnoses, what lies in run folders.
//!
//! Numbers go in and out as numpy arrays, results as the files that the program writes; the Python half beside this makes objects of
//! them. Nothing is computed here: that is `sim`'s, `ident`'s and the application's, with their errors.
//!
//! * `errors`: failures as exceptions; `watched`: work in the background, with its progress and Ctrl-C;
//! * `model`: a model and its rollouts; `jobs`: fits, diagnoses and imports; `tables`: what a run folder holds.

mod errors;
mod jobs;
mod model;
mod rollout;
mod tables;
mod watched;

use pyo3::prelude::*;

/// The compiled half of `tankrig`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::jobs::{diagnose, fit, import_keypoints};
    #[pymodule_export]
    use super::model::NativeModel;
    #[pymodule_export]
    use super::tables::{read_command, read_pictures, read_trajectory};

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
