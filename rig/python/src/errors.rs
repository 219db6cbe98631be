//! Failures as the package's exceptions, by the words that `--json` has for them.

use app::Failure;
use pyo3::prelude::*;

/// Carries out `work` without Python's lock.
///
/// # Errors
/// Its failure as an exception.
pub(crate) fn unlocked<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, Failure> + Send,
) -> PyResult<T> {
    py.detach(work).map_err(|failure| exception(py, &failure))
}

/// The exception for `failure`, with the text that the command line prints.
pub(crate) fn exception(py: Python<'_>, failure: &Failure) -> PyErr {
    let text = format!("{:#}", failure.error());
    let made = py
        .import("tankrig.errors")
        .and_then(|module| module.getattr("of_status"))
        .and_then(|of_status| of_status.call1((failure.status(), text)));
    match made {
        Ok(exception) => PyErr::from_value(exception),
        Err(error) => error,
    }
}
