//! Moves a mechanism through a whole run and samples it.

use crate::command::Command;
use crate::dynamics::{integrate, kinematics};
use crate::effects::CommandPath;
use crate::model::{Integrator, Model, State};
use crate::observation::Film;
use crate::observation::film::{Keypoint, watch};
use crate::scalar::{Mask, Scalar};
use crate::simulator::{self, Engine};
use crate::space::{Planar, Space, Spatial};
use crate::trajectory::Trajectory;

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
    /// [`Simulator`](crate::Simulator); a drive without a command
    /// leaves its joint free.
    pub prescribed: bool,
    /// When motion starts \[s\]; until then the initial state is held.
    pub start_s: f64,
}

/// Why a run could not be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RolloutError {
    /// A velocity is not a number or absurd.
    #[error(
        "simulation diverged at joint `{joint}` at {time_s} s; take a smaller time step or check the model's numbers"
    )]
    Diverged {
        /// The first joint at fault.
        joint: String,
        /// When \[s\].
        time_s: f64,
    },
    /// A time step that is none.
    #[error("time step {timestep_s} s must be finite and above 0")]
    Timestep {
        /// The step \[s\].
        timestep_s: f64,
    },
    /// A command for an actuator the model does not have.
    #[error("command for `{actuator}`, but the model's actuators are: {known}")]
    UnknownActuator {
        /// The command's column.
        actuator: String,
        /// The model's actuators, listed.
        known: String,
    },
    /// A state of another shape than the model.
    #[error("state has {qpos} coordinates and {qvel} velocities, the model {nq} and {nv}")]
    Shape {
        /// Coordinates given.
        qpos: usize,
        /// Velocities given.
        qvel: usize,
        /// Coordinates wanted.
        nq: usize,
        /// Velocities wanted.
        nv: usize,
    },
    /// An initial state that is no number.
    #[error("initial {what} {index} is not finite")]
    BadState {
        /// `qpos` or `qvel`.
        what: &'static str,
        /// Which entry.
        index: usize,
    },
    /// Sample times that are no numbers or fall.
    #[error("sample time {index} is {time_s} s: times must be finite and must not fall")]
    SampleTime {
        /// Which one.
        index: usize,
        /// The time \[s\].
        time_s: f64,
    },
    /// Something this version cannot do.
    #[error("{what} is not supported; {instead}")]
    Unsupported {
        /// What was asked for.
        what: String,
        /// What to do instead.
        instead: String,
    },
}

/// A run, sampled.
#[derive(Debug, Clone, PartialEq)]
pub struct Rollout<T> {
    /// Sample times \[s\], shape (N).
    pub time_s: Vec<f64>,
    /// Coordinates, row-major, shape (N, nq).
    pub qpos: Vec<T>,
    /// Velocities, row-major, shape (N, nv).
    pub qvel: Vec<T>,
    /// Names of the keypoints, shape (K).
    pub keypoints: Vec<String>,
    /// Keypoint positions \[m\], world frame, row-major, shape (N, K): as seen, where the model carries causes in the
    /// camera ([`crate::effects`]).
    pub position_m: Vec<[T; 3]>,
}

impl Rollout<f64> {
    /// The keypoints' trajectory.
    pub fn trajectory(&self) -> Trajectory {
        Trajectory {
            time_s: self.time_s.clone(),
            keypoints: self.keypoints.clone(),
            position_m: self.position_m.clone(),
            std_m: None,
        }
    }
}

/// Simulates from `state` and samples at `sample_times_s`.
///
/// The state is held until `options.start_s`; steps of equal length follow. A sample between two steps is the
/// cubic Hermite polynomial through both (coordinates) and the straight line (velocities), so sampling never
/// changes the motion. Commands go to actuators by name; an actuator without one is commanded 0.
/// Prescribed joints start where their command is, whatever `state` says.
///
/// # Errors
/// [`RolloutError`].
pub fn rollout<T: Scalar>(
    model: &Model<T>,
    state: &State<T>,
    command: &Command,
    sample_times_s: &[f64],
    options: &RolloutOptions,
) -> Result<Rollout<T>, RolloutError> {
    check(model, state, sample_times_s)?;
    check_actuators(model, command)?;
    let altered = model.altered();
    let model = altered.as_ref().unwrap_or(model);
    let run = Run { model, state, command, sample_times_s, options };
    match simulator::plane(model, options) {
        Some(plane) => run.through::<Planar<T>>(plane),
        None => run.through::<Spatial<T>>(()),
    }
}

/// What is to be simulated, checked.
struct Run<'a, T> {
    model: &'a Model<T>,
    state: &'a State<T>,
    command: &'a Command,
    sample_times_s: &'a [f64],
    options: &'a RolloutOptions,
}

impl<T: Scalar> Run<'_, T> {
    #[inline(always)]
    fn through<S: Space<T = T>>(&self, layout: S::Layout) -> Result<Rollout<T>, RolloutError> {
        let Self { model, state, command, sample_times_s, options } = self;
        let path = CommandPath::new(model, command);
        let command = |drive: usize, time_s: f64| path.at(drive, time_s);

        let mut engine = Engine::<S>::new(model, layout, options)?;
        engine.switch_off(&(0..model.actuators.len()).map(|drive| !path.commands(drive)).collect::<Vec<_>>());
        let h = engine.timestep_s;
        let mut after = State::clone(state);
        engine.align(&mut after, options.start_s, &command);
        let mut before = after.clone();
        let mut sample = after.clone();

        let sites: Vec<Keypoint<S>> = model
            .keypoint_sites()
            .into_iter()
            .map(|site| (model.sites[site].body, model.sites[site].pos))
            .map(|(body, at)| (body, at, S::vector(&engine.plant.layout, body, at)))
            .collect();
        let mut out = Rollout {
            time_s: sample_times_s.to_vec(),
            qpos: Vec::with_capacity(sample_times_s.len() * state.qpos.len()),
            qvel: Vec::with_capacity(sample_times_s.len() * state.qvel.len()),
            keypoints: model.keypoints(),
            position_m: Vec::with_capacity(sample_times_s.len() * sites.len()),
        };
        let mut film = Film::new(model, options.start_s, h);
        if let Some(film) = &mut film {
            let still: Vec<_> = sites.iter().map(|site| watch(&mut engine, &after, site).0).collect();
            film.open(still);
        }
        // steps taken; `after` stands at start_s + steps * h
        let mut steps = 0_u64;
        for &time_s in *sample_times_s {
            let elapsed = time_s - options.start_s;
            // a sample within a billionth of a step of an instant belongs to it
            while elapsed > (steps as f64 + 1e-9) * h {
                before.qpos.copy_from_slice(&after.qpos);
                engine.step_with(&mut after, options.start_s + steps as f64 * h, h, &command)?;
                before.qvel.copy_from_slice(&engine.departure);
                if let Some(film) = &mut film {
                    film.record(&mut engine, [&before, &after], &sites);
                }
                steps += 1;
            }
            let share = if steps == 0 { 1.0 } else { elapsed / h - (steps - 1) as f64 };
            if share > 1.0 - 1e-9 {
                sample.qpos.copy_from_slice(&after.qpos);
                sample.qvel.copy_from_slice(&after.qvel);
            } else {
                let (start, end) = ((&before.qpos[..], &before.qvel[..]), (&after.qpos[..], &after.qvel[..]));
                integrate::between(&engine.plant, start, end, h, share, &mut sample.qpos);
                let share = T::from_f64(share);
                for ((v, &v0), &v1) in sample.qvel.iter_mut().zip(&before.qvel).zip(&after.qvel) {
                    *v = v0 + share * (v1 - v0);
                }
            }
            kinematics::kinematics(&engine.plant, &sample.qpos, &mut engine.work);
            let (work, layout) = (&engine.work, &engine.plant.layout);
            for &(body, own, at) in &sites {
                let world = work.pos[body] + S::apply(&work.rot[body], at);
                out.position_m.push(S::lift(layout, body, own, world));
            }
            out.qpos.extend_from_slice(&sample.qpos);
            out.qvel.extend_from_slice(&sample.qvel);
        }
        if let Some(film) = &mut film {
            // what is seen late is seen after the last sample
            while !film.reaches(sample_times_s) {
                before.qpos.copy_from_slice(&after.qpos);
                engine.step_with(&mut after, options.start_s + steps as f64 * h, h, &command)?;
                before.qvel.copy_from_slice(&engine.departure);
                film.record(&mut engine, [&before, &after], &sites);
                steps += 1;
            }
            film.develop(sample_times_s, &mut out.position_m);
        }
        Ok(out)
    }
}

fn check<T: Scalar>(model: &Model<T>, state: &State<T>, sample_times_s: &[f64]) -> Result<(), RolloutError> {
    let (nq, nv) = (model.nq(), model.nv());
    if (state.qpos.len(), state.qvel.len()) != (nq, nv) {
        return Err(RolloutError::Shape { qpos: state.qpos.len(), qvel: state.qvel.len(), nq, nv });
    }
    let finite = |x: &T| x.abs().less(T::from_f64(f64::INFINITY)).all();
    for (what, values) in [("qpos", &state.qpos), ("qvel", &state.qvel)] {
        if let Some(index) = values.iter().position(|x| !finite(x)) {
            return Err(RolloutError::BadState { what, index });
        }
    }
    let mut latest = f64::NEG_INFINITY;
    for (index, &time_s) in sample_times_s.iter().enumerate() {
        if !time_s.is_finite() || time_s < latest {
            return Err(RolloutError::SampleTime { index, time_s });
        }
        latest = time_s;
    }
    Ok(())
}

/// A command for an actuator that the model does not have is a mistake.
fn check_actuators<T: Scalar>(model: &Model<T>, command: &Command) -> Result<(), RolloutError> {
    let known = |name: &String| model.actuators.iter().any(|actuator| actuator.name == *name);
    let Some(actuator) = command.actuators.iter().find(|name| !known(name)) else { return Ok(()) };
    let known: Vec<_> = model.actuators.iter().map(|actuator| actuator.name.as_str()).collect();
    Err(RolloutError::UnknownActuator { actuator: actuator.clone(), known: known.join(", ") })
}
