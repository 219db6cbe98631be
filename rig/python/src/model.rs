//! A model: what it is made of, and how it moves.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use app::Failure;
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use sim::model::Model;
use sim::{Command, Integrator};

use crate::errors::unlocked;
use crate::rollout::{Arrays, Stepping, Wanted};

/// A model, read once.
#[pyclass(frozen, name = "Model", module = "tankrig._native")]
pub(crate) struct NativeModel {
    model: Model,
}

/// The integrators as MJCF calls them, in small letters.
const INTEGRATORS: [(&str, Integrator); 3] =
    [("euler", Integrator::Euler), ("implicitfast", Integrator::ImplicitFast), ("rk4", Integrator::Rk4)];

#[pymethods]
impl NativeModel {
    /// Reads the MJCF file at `path`.
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        Ok(Self { model: unlocked(py, || app::read_model(&path))? })
    }

    /// Reads MJCF from its text.
    #[staticmethod]
    fn from_mjcf(py: Python<'_>, text: &str) -> PyResult<Self> {
        let model = unlocked(py, || Model::from_mjcf(text).map_err(Failure::input))?;
        Ok(Self { model })
    }

    /// The model as MJCF text, with `comment` at its head.
    fn to_mjcf(&self, py: Python<'_>, comment: &str) -> String {
        py.detach(|| self.model.to_mjcf(comment))
    }

    #[getter]
    fn name(&self) -> &str {
        &self.model.name
    }

    #[getter]
    fn nq(&self) -> usize {
        self.model.nq()
    }

    #[getter]
    fn nv(&self) -> usize {
        self.model.nv()
    }

    #[getter]
    fn joints(&self) -> Vec<&str> {
        self.model.joints.iter().map(|joint| joint.name.as_str()).collect()
    }

    #[getter]
    fn actuators(&self) -> Vec<&str> {
        self.model.actuators.iter().map(|actuator| actuator.name.as_str()).collect()
    }

    #[getter]
    fn keypoints(&self) -> Vec<String> {
        self.model.marks()
    }

    /// Every parameter's name, value and unit.
    #[getter]
    fn parameters(&self, py: Python<'_>) -> PyResult<Vec<(String, f64, &'static str)>> {
        let one = |name: String| {
            let place = self.model.find_parameter(&name).map_err(Failure::input)?;
            Ok((name, self.model.get(place), self.model.unit(place)))
        };
        unlocked(py, || self.model.parameter_names().into_iter().map(one).collect())
    }

    /// The same model with these parameters at these values.
    fn with_parameters(&self, py: Python<'_>, values: Vec<(String, f64)>) -> PyResult<Self> {
        let mut model = self.model.clone();
        unlocked(py, || {
            for (name, value) in &values {
                model.set_parameter(name, *value).map_err(Failure::input)?;
            }
            Ok(Self { model })
        })
    }

    /// Coordinates and velocities at rest, every joint at its reference.
    fn rest<'py>(&self, py: Python<'py>) -> [Bound<'py, PyArray1<f64>>; 2] {
        let rest = self.model.rest_state();
        [rest.qpos, rest.qvel].map(|numbers| PyArray1::from_vec(py, numbers))
    }

    /// Moves the model from each of the states, see the package's `Model.rollout`. One of `servo_file` and `servo_table` says what the
    /// drives are told, or neither.
    #[pyo3(signature = (qpos, qvel, names, values, time_s, *, servo_file, servo_table, base_file, start_s, integrator, timestep_s, accuracy_m, hold_command, prescribed, directions, threads))]
    #[expect(clippy::too_many_arguments, reason = "all that a rollout may be told, by name")]
    fn rollout<'py>(
        &self,
        py: Python<'py>,
        qpos: PyReadonlyArray2<'py, f64>,
        qvel: PyReadonlyArray2<'py, f64>,
        names: Vec<String>,
        values: PyReadonlyArray2<'py, f64>,
        time_s: PyReadonlyArray1<'py, f64>,
        servo_file: Option<PathBuf>,
        servo_table: Option<String>,
        base_file: Option<PathBuf>,
        start_s: f64,
        integrator: Option<&str>,
        timestep_s: Option<f64>,
        accuracy_m: Option<f64>,
        hold_command: bool,
        prescribed: bool,
        directions: Option<Vec<String>>,
        threads: Option<NonZeroUsize>,
    ) -> PyResult<Arrays<'py>> {
        let [states, rates, numbers] = [qpos.as_array(), qvel.as_array(), values.as_array()];
        let time_s = time_s.as_array();
        let simulated = unlocked(py, || {
            let stepping = Stepping {
                integrator: integrator.map(by_name).transpose()?,
                timestep_s,
                hold_command,
                prescribed,
                base: base_file
                    .map(|path| ident::table::read_base(&path))
                    .transpose()
                    .map_err(Failure::input)?,
                start_s,
                accuracy_m,
            };
            let command = match (servo_file, servo_table) {
                (Some(path), _) => ident::table::read_command(&path).map_err(Failure::input)?,
                (None, Some(text)) => {
                    ident::table::parse_servo(&text, "servo".as_ref()).map_err(Failure::input)?.command
                }
                (None, None) => Command::default(),
            };
            let wanted = Wanted::new(
                &self.model,
                (states, rates),
                (names, numbers),
                time_s.iter().copied().collect(),
            )?;
            app::on_threads(app::threads(threads), || {
                wanted.simulate(&command, stepping, directions.as_deref())
            })
        })?;
        simulated.arrays(py)
    }
}

fn by_name(name: &str) -> Result<Integrator, Failure> {
    let found = INTEGRATORS.iter().find(|(known, _)| name.eq_ignore_ascii_case(known));
    found.map(|(_, integrator)| *integrator).ok_or_else(|| {
        let known: Vec<&str> = INTEGRATORS.iter().map(|(known, _)| *known).collect();
        Failure::Input(anyhow::anyhow!("integrator `{name}` is none of {}", known.join(", ")))
    })
}
