//! Many rollouts at once, from arrays to arrays.

use std::sync::Arc;

use anyhow::anyhow;
use app::Failure;
use numpy::ndarray::ArrayView2;
use numpy::{Element, PyArray, PyArray1, PyArray3, PyArray4, PyArrayMethods};
use pyo3::prelude::*;
use rayon::prelude::*;
use sim::batch::{self, Candidate};
use sim::model::{Model, Parameter, State};
use sim::sensitivities::{self, Direction, Sensitivities};
use sim::{BasePath, Command, Integrator, Isa, Rollout, RolloutError, RolloutOptions};

use crate::errors::exception;

/// How the model is stepped.
pub(crate) struct Stepping {
    pub(crate) integrator: Option<Integrator>,
    pub(crate) timestep_s: Option<f64>,
    pub(crate) hold_command: bool,
    pub(crate) prescribed: bool,
    pub(crate) base: Option<BasePath>,
    pub(crate) start_s: f64,
    /// Steps of our own, as long as keypoints stay so near to the motion itself \[m\].
    pub(crate) accuracy_m: Option<f64>,
}

/// What is to be simulated.
pub(crate) struct Wanted<'a> {
    model: &'a Model,
    parameters: Vec<Parameter>,
    candidates: Vec<Candidate>,
    time_s: Vec<f64>,
}

/// A batch's motion: of each candidate, or why there is none.
pub(crate) struct Simulated {
    shape: Shape,
    runs: Vec<Result<Sensitivities, RolloutError>>,
    /// Number of directions, where derivatives were asked for.
    directions: Option<usize>,
}

/// Instants, coordinates, velocities, keypoints.
#[derive(Clone, Copy)]
struct Shape {
    instants: usize,
    nq: usize,
    nv: usize,
    points: usize,
}

/// Coordinates (B, N, nq), velocities (B, N, nv), keypoints (B, N, K, 3) \[m\], which candidates failed and why, and the derivatives of
/// the three along D directions, (B, N, nq, D) and so on.
pub(crate) type Arrays<'py> = (
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray4<f64>>,
    Vec<(usize, Py<PyAny>)>,
    Option<[Bound<'py, PyAny>; 3]>,
);

impl<'a> Wanted<'a> {
    /// A candidate for each row: of states, shape (B, nq) and (B, nv), and of the values of the parameters `names`, shape (B, P).
    pub(crate) fn new(
        model: &'a Model,
        (qpos, qvel): (ArrayView2<'_, f64>, ArrayView2<'_, f64>),
        (names, values): (Vec<String>, ArrayView2<'_, f64>),
        time_s: Vec<f64>,
    ) -> Result<Self, Failure> {
        let found: Result<_, _> = names.iter().map(|name| model.find_parameter(name)).collect();
        let parameters: Vec<Parameter> = found.map_err(Failure::input)?;
        let rows = qpos.rows().into_iter().zip(qvel.rows()).zip(values.rows());
        let candidates = rows.map(|((qpos, qvel), values)| Candidate {
            values: values.to_vec(),
            state: State { qpos: qpos.to_vec(), qvel: qvel.to_vec() },
            start_s: 0.0,
        });
        Ok(Self { model, parameters, candidates: candidates.collect(), time_s })
    }

    /// Simulates, with derivatives along `directions` where they are asked for: parameters by name, coordinates and velocities at the
    /// start as `qpos[0]`, `qvel[0]` and so on.
    pub(crate) fn simulate(
        mut self,
        command: &Command,
        stepping: Stepping,
        directions: Option<&[String]>,
    ) -> Result<Simulated, Failure> {
        let Stepping { integrator, timestep_s, hold_command, prescribed, base, start_s, accuracy_m } =
            stepping;
        let base = base.map(Arc::new);
        let mut options =
            RolloutOptions { integrator, timestep_s, hold_command, prescribed, base, start_s, steps: None };
        for candidate in &mut self.candidates {
            candidate.start_s = start_s;
        }
        if let (Some(accuracy_m), Some(first)) = (accuracy_m, self.candidates.first()) {
            let mut nominal = self.model.clone();
            for (&place, &value) in self.parameters.iter().zip(&first.values) {
                nominal.set(place, value);
            }
            let plan = sim::plan(&nominal, &first.state, command, &self.time_s, &options, accuracy_m)?;
            options.steps = Some(plan.steps);
        }
        let shape = Shape {
            instants: self.time_s.len(),
            nq: self.model.nq(),
            nv: self.model.nv(),
            points: self.model.marks().len(),
        };
        let Some(names) = directions else {
            let (model, times) = (self.model, &self.time_s);
            let (parameters, candidates) = (&self.parameters, &self.candidates);
            let runs = batch::rollouts(model, parameters, candidates, command, times, &options, Isa::best())?;
            let plain = |Rollout { position_m, qpos, qvel, .. }: Rollout<f64>| Sensitivities {
                position_m,
                qpos,
                qvel,
                ..Sensitivities::default()
            };
            let runs = runs.into_iter().map(|run| run.map(plain)).collect();
            return Ok(Simulated { shape, runs, directions: None });
        };
        let along = self.directions(names)?;
        let run = |candidate: &Candidate| {
            let (model, parameters, times) = (self.model, &self.parameters, &self.time_s);
            sensitivities::of_states(
                model,
                parameters,
                candidate,
                &along,
                command,
                times,
                &options,
                Isa::best(),
            )
        };
        let runs = self.candidates.par_iter().map(run).collect();
        Ok(Simulated { shape, runs, directions: Some(along.len()) })
    }

    /// What the names of directions say; parameters that are at the model's own values so far become candidates' too.
    fn directions(&mut self, names: &[String]) -> Result<Vec<Direction>, Failure> {
        for name in names.iter().filter(|name| !name.contains('[')) {
            let place = self.model.find_parameter(name).map_err(Failure::input)?;
            if !self.parameters.contains(&place) {
                let value = self.model.get(place);
                self.parameters.push(place);
                self.candidates.iter_mut().for_each(|candidate| candidate.values.push(value));
            }
        }
        names.iter().map(|name| self.direction(name)).collect()
    }

    fn direction(&self, name: &str) -> Result<Direction, Failure> {
        let mut along = Direction {
            values: vec![0.0; self.parameters.len()],
            qpos: vec![0.0; self.model.nq()],
            qvel: vec![0.0; self.model.nv()],
            start_s: 0.0,
        };
        let rate = match name.strip_suffix(']').and_then(|name| name.split_once('[')) {
            Some(("qpos", index)) => index.parse().ok().and_then(|index: usize| along.qpos.get_mut(index)),
            Some(("qvel", index)) => index.parse().ok().and_then(|index: usize| along.qvel.get_mut(index)),
            Some(_) => None,
            None => {
                let place = self.model.find_parameter(name).map_err(Failure::input)?;
                let known = self.parameters.iter().position(|known| *known == place);
                known.and_then(|known| along.values.get_mut(known))
            }
        };
        match rate {
            Some(rate) => *rate = 1.0,
            None => {
                let (nq, nv) = (self.model.nq(), self.model.nv());
                return Err(Failure::Input(anyhow!(
                    "derivatives by `{name}`: wanted are parameters, qpos[0] to qpos[{nq}] and qvel[0] to qvel[{nv}], the last ones excluded"
                )));
            }
        }
        Ok(along)
    }
}

impl Simulated {
    /// As arrays; those of candidates that failed are NaN.
    pub(crate) fn arrays(self, py: Python<'_>) -> PyResult<Arrays<'_>> {
        let Self { shape: Shape { instants, nq, nv, points }, runs, directions } = self;
        let batch = runs.len();
        let whole = |part: fn(&Sensitivities) -> &[f64], width: usize| {
            let mut all = Vec::with_capacity(batch * instants * width);
            for run in &runs {
                match run {
                    Ok(run) => all.extend_from_slice(part(run)),
                    Err(_) => all.resize(all.len() + instants * width, f64::NAN),
                }
            }
            all
        };
        let qpos = shaped(py, whole(|run| &run.qpos, nq), [batch, instants, nq])?;
        let qvel = shaped(py, whole(|run| &run.qvel, nv), [batch, instants, nv])?;
        let places = whole(|run| run.position_m.as_flattened(), 3 * points);
        let places = shaped(py, places, [batch, instants, points, 3])?;
        let slopes = directions
            .map(|count| -> PyResult<_> {
                let slopes = |part: fn(&Sensitivities, usize) -> &[f64], width: usize| {
                    turned(&runs, count, instants * width, part)
                };
                let of_qpos = slopes(|run, along| &run.qpos_slopes[along], nq);
                let of_qvel = slopes(|run, along| &run.qvel_slopes[along], nv);
                let of_places = slopes(|run, along| run.slopes[along].as_flattened(), 3 * points);
                Ok([
                    shaped(py, of_qpos, [batch, instants, nq, count])?.into_any(),
                    shaped(py, of_qvel, [batch, instants, nv, count])?.into_any(),
                    shaped(py, of_places, [batch, instants, points, 3, count])?.into_any(),
                ])
            })
            .transpose()?;
        let failed = runs.into_iter().enumerate().filter_map(|(place, run)| Some((place, run.err()?)));
        let failed = failed
            .map(|(place, error)| (place, exception(py, &Failure::from(error)).into_value(py).into_any()));
        Ok((qpos, qvel, places, failed.collect(), slopes))
    }
}

/// Derivatives with the directions last, which have them first in each of `runs`.
fn turned(
    runs: &[Result<Sensitivities, RolloutError>],
    directions: usize,
    width: usize,
    part: impl Fn(&Sensitivities, usize) -> &[f64],
) -> Vec<f64> {
    let mut all = vec![f64::NAN; runs.len() * width * directions];
    for (run, place) in runs.iter().zip(all.chunks_mut((width * directions).max(1))) {
        let Ok(run) = run else { continue };
        for along in 0..directions {
            let rates = part(run, along);
            for (cell, &rate) in place.iter_mut().skip(along).step_by(directions).zip(rates) {
                *cell = rate;
            }
        }
    }
    all
}

fn shaped<T: Element, const N: usize>(
    py: Python<'_>,
    numbers: Vec<T>,
    shape: [usize; N],
) -> PyResult<Bound<'_, PyArray<T, numpy::ndarray::Dim<[usize; N]>>>>
where
    numpy::ndarray::Dim<[usize; N]>: numpy::ndarray::Dimension,
    [usize; N]: numpy::ndarray::IntoDimension<Dim = numpy::ndarray::Dim<[usize; N]>>,
{
    PyArray1::from_vec(py, numbers).reshape(shape)
}
