//! Verbs of `rig` whose failure ends an example, with what the program printed.

use std::error::Error;
use std::ffi::OsStr;
use std::path::Path;

use ident::diagnose::Diagnosis;
use ident::fit::Fit;

use crate::{printed, run_rig};

/// What goes wrong ends the whole.
pub type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Runs `rig` with `arguments` to its end.
///
/// # Errors
/// What it printed, where it fails.
pub fn verb<I: IntoIterator<Item = S>, S: AsRef<OsStr>>(arguments: I) -> Result<()> {
    let output = run_rig(arguments);
    if output.status.success() { Ok(()) } else { Err(printed(&output).into()) }
}

/// `rig fit` of `experiment` into the folder of its name.
///
/// # Errors
/// Where it fails.
pub fn fit(experiment: &Path) -> Result<Fit> {
    let out = experiment.with_extension("");
    verb(["fit".as_ref(), experiment.as_os_str(), "--out".as_ref(), out.as_os_str()])?;
    Ok(serde_json::from_str(&std::fs::read_to_string(out.join("fit.json"))?)?)
}

/// `rig diagnose` of `experiment` into `out`.
///
/// # Errors
/// Where it fails.
pub fn diagnose(experiment: &Path, out: &Path) -> Result<Diagnosis> {
    verb(["diagnose".as_ref(), experiment.as_os_str(), "--out".as_ref(), out.as_os_str()])?;
    Ok(serde_json::from_str(&std::fs::read_to_string(out.join("diagnosis.json"))?)?)
}
