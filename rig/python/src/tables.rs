//! What a run folder holds: trajectories, commands, pictures.

use std::collections::BTreeSet;
use std::path::PathBuf;

use app::Failure;
use images::recording::RecordedImages;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyString;
use record::folder::RunFolder;

use crate::errors::unlocked;

/// Times \[s\], shape (N); names of the keypoints, shape (K); positions \[m\], shape (N, K, 3); their sigmas \[m\], shape (N, K).
type Trajectory<'py> =
    (Bound<'py, PyArray1<f64>>, Vec<String>, Bound<'py, PyArray3<f64>>, Option<Bound<'py, PyArray2<f64>>>);

/// Reads a `trajectory.csv`.
///
/// # Errors
/// Wrong input, naming file, line and column.
#[pyfunction]
pub(crate) fn read_trajectory(py: Python<'_>, path: PathBuf) -> PyResult<Trajectory<'_>> {
    let read = unlocked(py, || ident::table::read_trajectory(&path).map_err(Failure::input))?;
    let (instants, points) = (read.time_s.len(), read.keypoints.len());
    let positions =
        PyArray1::from_vec(py, read.position_m.into_flattened()).reshape([instants, points, 3])?;
    let std_m =
        read.std_m.map(|std_m| PyArray1::from_vec(py, std_m).reshape([instants, points])).transpose()?;
    Ok((PyArray1::from_vec(py, read.time_s), read.keypoints, positions, std_m))
}

/// Names of the actuators, shape (A); times \[s\], shape (N); commands \[rad\], shape (N, A).
type Command<'py> = (Vec<String>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// Reads the commands of a `servo.csv`.
///
/// # Errors
/// Wrong input, naming file, line and column.
#[pyfunction]
pub(crate) fn read_command(py: Python<'_>, path: PathBuf) -> PyResult<Command<'_>> {
    let read = unlocked(py, || ident::table::read_command(&path).map_err(Failure::input))?;
    let shape = [read.time_s.len(), read.actuators.len()];
    let angles = PyArray1::from_vec(py, read.angle_rad).reshape(shape)?;
    Ok((read.actuators, PyArray1::from_vec(py, read.time_s), angles))
}

/// The pictures of the run folder at `path` that the camera counted `sequences`, by that count: brightness, shape (height, width), or why
/// there is none.
///
/// # Errors
/// Wrong input where the folder is none, lacking data where its recording cannot be read.
#[pyfunction]
pub(crate) fn read_pictures(
    py: Python<'_>,
    path: PathBuf,
    sequences: BTreeSet<u32>,
) -> PyResult<Vec<(String, Bound<'_, PyAny>)>> {
    let found = unlocked(py, || {
        let run = RunFolder::open(&path).map_err(Failure::input)?;
        RecordedImages::of_run(&run).counted(&sequences).map_err(Failure::data)
    })?;
    found
        .into_iter()
        .map(|image| {
            let picture = match image.grey {
                Ok(grey) => {
                    let shape = [grey.height(), grey.width()].map(|side| side as usize);
                    PyArray1::from_vec(py, grey.into_raw()).reshape(shape)?.into_any()
                }
                Err(why) => PyString::new(py, &why).into_any(),
            };
            Ok((image.name, picture))
        })
        .collect()
}
