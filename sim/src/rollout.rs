//! Moves a mechanism through a whole run and samples it.

use crate::causes::CommandPath;
use crate::command::Command;
use crate::dynamics::stages::Stages;
use crate::dynamics::{integrate, kinematics};
use crate::error::RolloutError;
use crate::film::Film;
use crate::film::Keypoint;
use crate::model::{Joint, Model, Parameter, State};
use crate::options::RolloutOptions;
use crate::scalar::{Mask, Scalar, tuned};
use crate::simulator::{self, Engine};
use crate::space::{Planar, Spatial};
use crate::steps::Grid;
use crate::trajectory::Trajectory;

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
    /// camera ([`crate::causes`]).
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
    check_parameters(model)?;
    let columns = columns(model, command)?;
    let altered = model.altered();
    let model = altered.as_ref().unwrap_or(model);
    let start_s = T::from_f64(options.start_s);
    let states = true;
    let run = Run { model, state, start_s, command, columns: &columns, sample_times_s, options, states };
    let mut run = match simulator::plane(model, options) {
        Some(plane) => run.through::<Planar<T>>(plane),
        None => run.through::<Spatial<T>>(()),
    }?;
    match run.failed.iter_mut().find_map(Option::take) {
        Some(error) => Err(error),
        None => Ok(Rollout {
            time_s: sample_times_s.to_vec(),
            qpos: run.qpos,
            qvel: run.qvel,
            keypoints: model.keypoints(),
            position_m: run.position_m,
        }),
    }
}

/// What is to be simulated, checked.
#[derive(Clone, Copy)]
pub(crate) struct Run<'a, T> {
    pub(crate) model: &'a Model<T>,
    pub(crate) state: &'a State<T>,
    /// When motion starts \[s\], lane by lane.
    pub(crate) start_s: T,
    pub(crate) command: &'a Command,
    /// For each of the model's actuators, the command's column.
    pub(crate) columns: &'a [Option<usize>],
    pub(crate) sample_times_s: &'a [f64],
    pub(crate) options: &'a RolloutOptions,
    /// Whether coordinates and velocities are asked for, or keypoints only.
    pub(crate) states: bool,
}

/// What came of it.
pub(crate) struct Samples<T> {
    /// Shapes as in [`Rollout`]; coordinates and velocities are empty where nobody asks for them.
    pub(crate) qpos: Vec<T>,
    pub(crate) qvel: Vec<T>,
    pub(crate) position_m: Vec<[T; 3]>,
    /// Lane by lane.
    pub(crate) failed: Vec<Option<RolloutError>>,
}

impl<T: Scalar> Run<'_, T> {
    /// Simulates in the space that `layout` describes. Every lane takes the same steps from its own start; a lane that
    /// diverges is put back to its initial state, so that its neighbours never meet its numbers.
    pub(crate) fn through<S: Stages<T = T>>(&self, layout: S::Layout) -> Result<Samples<T>, RolloutError> {
        let Self { model, state, start_s, command, columns, sample_times_s, options, states } = *self;
        let path = CommandPath::new(model, command);
        let command = |drive: usize, time_s: f64| path.at(drive, time_s);

        let mut engine = Engine::<S>::new(model, layout, options)?;
        engine.clock = start_s - T::from_f64(options.start_s);
        engine.switch_off(&columns.iter().map(Option::is_none).collect::<Vec<_>>());
        let grid = match &options.steps {
            Some(steps) => {
                let lengths_s = [engine.timestep_s, engine.longest_step_s()];
                Grid::planned(steps, lengths_s, self.command, options.start_s)
            }
            None => Grid::equal(engine.timestep_s),
        };
        let mut after = state.clone();
        engine.align(&mut after, options.start_s, &command);
        let initial = after.clone();
        let mut before = after.clone();
        let mut sample = after.clone();

        let sites: Vec<Keypoint<S>> = model
            .keypoint_sites()
            .into_iter()
            .map(|site| (model.sites[site].body, model.sites[site].pos))
            .map(|(body, at)| (body, at, S::vector(&engine.plant.layout, body, at)))
            .collect();
        let (instants, nq, nv) = (sample_times_s.len(), after.qpos.len(), after.qvel.len());
        let kept = if states { instants } else { 0 };
        let mut out = Samples {
            qpos: vec![T::ZERO; kept * nq],
            qvel: vec![T::ZERO; kept * nv],
            position_m: vec![[T::ZERO; 3]; instants * sites.len()],
            failed: vec![None; T::LANES],
        };
        let mut film = Film::new(model, start_s, options.start_s);
        if let Some(film) = &mut film {
            film.open(&mut engine, &after, &sites);
        }
        // the first sample that some lane still waits for; `after` stands at grid.instant(steps)
        let (mut first, mut steps) = (0, 0_usize);
        while first < instants {
            if steps > 0 {
                let (passed, h) = (grid.instant(steps - 1), grid.step(steps));
                let time_s = options.start_s + passed;
                before.qpos.copy_from_slice(&after.qpos);
                if !engine.step_with(&mut after, time_s, h, &command) {
                    self.set_back(&engine, &initial, &mut after, time_s + h, &mut out.failed);
                    if out.failed.iter().all(Option::is_some) {
                        break;
                    }
                }
                before.qvel.copy_from_slice(&engine.departure);
                if let Some(film) = &mut film {
                    film.record(&mut engine, [&before, &after], &sites, passed + h);
                }
            }
            // a sample within a billionth of a step of an instant belongs to it
            let (instant, h) = (grid.instant(steps), grid.step(steps.max(1)));
            let mut row = first;
            while row < instants {
                let (elapsed, reached, any, all) = tuned!(S::T, {
                    let elapsed = T::from_f64(sample_times_s[row]) - start_s;
                    let reached = !T::from_f64(instant + 1e-9 * h).less(elapsed);
                    (elapsed, reached, reached.any(), reached.all())
                });
                if !any {
                    break;
                }
                if row == first && all {
                    first += 1;
                }
                let mut here = reached;
                tuned!(S::T, {
                    if steps == 0 {
                        sample.qpos.copy_from_slice(&after.qpos);
                        sample.qvel.copy_from_slice(&after.qvel);
                    } else {
                        let passed = grid.instant(steps - 1);
                        here = here & T::from_f64(passed + 1e-9 * h).less(elapsed);
                        let share = (elapsed - T::from_f64(passed)) * T::from_f64(1.0 / h);
                        let (start, end) =
                            ((&before.qpos[..], &before.qvel[..]), (&after.qpos[..], &after.qvel[..]));
                        integrate::between(&engine.plant, start, end, h, share, &mut sample.qpos);
                        for ((v, &v0), &v1) in sample.qvel.iter_mut().zip(&before.qvel).zip(&after.qvel) {
                            *v = v0 + share * (v1 - v0);
                        }
                    }
                    if here.any() {
                        kinematics::kinematics(&engine.plant, &sample.qpos, &mut engine.work);
                        let (work, layout) = (&engine.work, &engine.plant.layout);
                        let places = &mut out.position_m[row * sites.len()..(row + 1) * sites.len()];
                        for (place, &(body, own, at)) in places.iter_mut().zip(&sites) {
                            let [x, y, z] =
                                S::lift(layout, body, own, work.pos[body] + S::apply(&work.rot[body], at));
                            let [a, b, c] = *place;
                            *place = [T::select(here, x, a), T::select(here, y, b), T::select(here, z, c)];
                        }
                        if states {
                            let kept = &mut out.qpos[row * nq..(row + 1) * nq];
                            for (kept, &q) in kept.iter_mut().zip(&sample.qpos) {
                                *kept = T::select(here, q, *kept);
                            }
                            let kept = &mut out.qvel[row * nv..(row + 1) * nv];
                            for (kept, &v) in kept.iter_mut().zip(&sample.qvel) {
                                *kept = T::select(here, v, *kept);
                            }
                        }
                    }
                });
                row += 1;
            }
            steps += 1;
        }
        if let Some(film) = &mut film {
            // what is seen late is seen after the last sample
            while !film.reaches(sample_times_s) && out.failed.iter().any(Option::is_none) {
                let (passed, h) = (grid.instant(steps - 1), grid.step(steps));
                let time_s = options.start_s + passed;
                before.qpos.copy_from_slice(&after.qpos);
                if !engine.step_with(&mut after, time_s, h, &command) {
                    self.set_back(&engine, &initial, &mut after, time_s + h, &mut out.failed);
                }
                before.qvel.copy_from_slice(&engine.departure);
                film.record(&mut engine, [&before, &after], &sites, passed + h);
                steps += 1;
            }
            film.develop(sample_times_s, &mut out.position_m);
        }
        Ok(out)
    }

    /// Notes which lanes have diverged and puts them back.
    fn set_back<S: Stages<T = T>>(
        &self,
        engine: &Engine<S>,
        initial: &State<T>,
        state: &mut State<T>,
        time_s: f64,
        failed: &mut [Option<RolloutError>],
    ) {
        let sound = engine.sound_lanes(state);
        for (lane, failed) in failed.iter_mut().enumerate().filter(|(_, failed)| failed.is_none()) {
            *failed = engine.diverged(state, lane, time_s);
        }
        for (q, &from) in state.qpos.iter_mut().zip(&initial.qpos) {
            *q = T::select(sound, *q, from);
        }
        for (v, &from) in state.qvel.iter_mut().zip(&initial.qvel) {
            *v = T::select(sound, *v, from);
        }
    }
}

pub(crate) fn check<T: Scalar>(
    model: &Model<T>,
    state: &State<T>,
    sample_times_s: &[f64],
) -> Result<(), RolloutError> {
    let (nq, nv) = (model.nq(), model.nv());
    if (state.qpos.len(), state.qvel.len()) != (nq, nv) {
        return Err(RolloutError::Shape { qpos: state.qpos.len(), qvel: state.qvel.len(), nq, nv });
    }
    let finite = |x: &T| x.abs().less(T::from_f64(f64::INFINITY)).all();
    for (what, values) in [("qpos", &state.qpos), ("qvel", &state.qvel)] {
        if let Some(index) = values.iter().position(|x| !finite(x)) {
            let first = |joint: &Joint<T>| match what {
                "qpos" => joint.qpos_address,
                _ => joint.dof_address,
            };
            let joint = model.joints.iter().rfind(|joint| first(joint) <= index);
            let joint = joint.map_or_else(String::new, |joint| joint.name.clone());
            return Err(RolloutError::BadState { what, index, joint });
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

/// What is wrong with `value` as that of `parameter`, if anything.
pub(crate) fn unfit<T: Scalar>(parameter: Parameter, value: T) -> Option<&'static str> {
    match parameter {
        _ if !value.abs().less(T::from_f64(f64::INFINITY)).all() => Some("finite"),
        Parameter::Mass(_) if !T::ZERO.less(value).all() => Some("above 0"),
        _ => None,
    }
}

fn check_parameters<T: Scalar>(model: &Model<T>) -> Result<(), RolloutError> {
    model.parameters().try_for_each(|(name, parameter)| match unfit(parameter, model.get(parameter)) {
        Some(wanted) => Err(RolloutError::BadParameter { name, wanted }),
        None => Ok(()),
    })
}

/// For each of the model's actuators, the command's column.
pub(crate) fn columns<T: Scalar>(
    model: &Model<T>,
    command: &Command,
) -> Result<Vec<Option<usize>>, RolloutError> {
    let known = |name: &String| model.actuators.iter().any(|actuator| actuator.name == *name);
    if let Some(actuator) = command.actuators.iter().find(|name| !known(name)) {
        let known: Vec<_> = model.actuators.iter().map(|actuator| actuator.name.as_str()).collect();
        return Err(RolloutError::UnknownActuator { actuator: actuator.clone(), known: known.join(", ") });
    }
    let column = |name: &str| command.actuators.iter().position(|other| other == name);
    Ok(model.actuators.iter().map(|actuator| column(&actuator.name)).collect())
}
