//! Moves a mechanism through a whole run and samples it.

use crate::causes::CommandPath;
use crate::command::Command;
use crate::dynamics::stages::Stages;
use crate::dynamics::{integrate, kinematics};
use crate::error::RolloutError;
use crate::film::{Film, Keypoint, choose};
use crate::model::{Joint, Model, Parameter, State};
use crate::options::RolloutOptions;
use crate::scalar::{Mask, Scalar, tuned};
use crate::simulator::{self, Engine};
use crate::space::{Planar, Spatial};
use crate::steps::Grid;
use crate::trajectory::Trajectory;

/// A simulated run at its sample times.
#[derive(Debug, Clone, PartialEq)]
pub struct Rollout<T> {
    /// Sample times \[s\], shape (N).
    pub time_s: Vec<f64>,
    /// Coordinates, row-major, shape (N, nq).
    pub qpos: Vec<T>,
    /// Velocities, row-major, shape (N, nv).
    pub qvel: Vec<T>,
    /// Names of the keypoints and encoders, shape (K): [`Model::marks`].
    pub keypoints: Vec<String>,
    /// Keypoint positions \[m\], world frame, row-major, shape (N, K): as seen, where the model carries causes in the
    /// camera ([`crate::causes`]).
    pub position_m: Vec<[T; 3]>,
}

impl Rollout<f64> {
    /// The trajectory of the keypoints, as `trajectory.csv` holds it.
    pub fn trajectory(&self) -> Trajectory {
        Trajectory {
            time_s: self.time_s.clone(),
            keypoints: self.keypoints.clone(),
            position_m: self.position_m.clone(),
            std_m: None,
            pose_std_m: None,
        }
    }
}

/// Simulates from `state` and samples at `sample_times_s`.
///
/// The state is held until `options.start_s`; steps of equal length follow. A sample between two steps is the
/// cubic Hermite polynomial through both (coordinates) and the straight line (velocities), so sampling never
/// changes the motion. Commands go to actuators by name; an actuator without one is commanded 0.
/// Prescribed joints start where their command is, whatever `state` says, at the rates that it says.
///
/// # Errors
/// [`RolloutError`].
pub fn rollout(
    model: &Model,
    state: &State,
    command: &Command,
    sample_times_s: &[f64],
    options: &RolloutOptions,
) -> Result<Rollout<f64>, RolloutError> {
    rollout_of(model, state, command, sample_times_s, options)
}

/// As [`rollout`], in numbers of any kind, such as those with derivatives: the simulation is compiled for them where this is called.
///
/// # Errors
/// [`RolloutError`].
pub fn rollout_of<T: Scalar>(
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
            keypoints: model.marks(),
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
        self.through_with::<S>(layout, |_, _, _| ())
    }

    /// The same; `between_steps` is told before the first step and after each one, its samples taken, the time since the motion's start
    /// \[s\], and may change the state.
    pub(crate) fn through_with<S: Stages<T = T>>(
        &self,
        layout: S::Layout,
        mut between_steps: impl FnMut(&mut Engine<S>, &mut State<T>, f64),
    ) -> Result<Samples<T>, RolloutError> {
        let Self { model, state, start_s, command, columns, sample_times_s, options, .. } = *self;
        let path = CommandPath::new(model, command);
        let command = |drive: usize, time_s: f64| path.at(drive, time_s);

        let mut engine = Engine::<S>::new(model, layout, options)?;
        engine.clock = start_s - T::from_f64(options.start_s);
        engine.switch_off(&columns.iter().map(Option::is_none).collect::<Vec<_>>());
        let grid = match &options.steps {
            Some(steps) => {
                let most_s = engine.longest_step_s().min(path.longest_step_s());
                let lengths_s = [engine.timestep_s.min(most_s), most_s];
                Grid::planned(steps, lengths_s, self.command, options.start_s)
            }
            None => Grid::equal(engine.timestep_s),
        };
        let mut after = state.clone();
        engine.align(&mut after, options.start_s, &command);
        let initial = after.clone();
        let mut before = after.clone();

        let sites: Vec<Keypoint<S>> = model
            .keypoint_sites()
            .into_iter()
            .map(|site| (model.sites[site].body, model.sites[site].pos))
            .map(|(body, at)| (body, at, S::vector(&engine.plant.layout, body, at)))
            .collect();
        let instants = sample_times_s.len();
        let mut sampler = Sampler::new(self, sites, &after);
        let mut film = Film::new(model, start_s, options.start_s);
        if let Some(film) = &mut film {
            film.open(&mut engine, &after, &sampler.sites);
        }
        between_steps(&mut engine, &mut after, 0.0);
        // `after` stands at grid.instant(steps)
        let mut steps = 0_usize;
        while sampler.first < instants {
            let h = grid.step(steps.max(1));
            let mut begin_s = None;
            if steps > 0 {
                let passed = grid.instant(steps - 1);
                begin_s = Some(passed);
                let time_s = options.start_s + passed;
                before.qpos.copy_from_slice(&after.qpos);
                if !engine.step_with(&mut after, time_s, h, &command) {
                    self.set_back(&engine, &initial, &mut after, time_s + h, &mut sampler.out.failed);
                    if sampler.out.failed.iter().all(Option::is_some) {
                        break;
                    }
                }
                before.qvel.copy_from_slice(&engine.departure);
                if let Some(film) = &mut film {
                    film.record(&mut engine, [&before, &after], &sampler.sites, passed + h);
                }
            }
            let stride = Stride { before: &before, after: &after, begin_s, end_s: grid.instant(steps), h };
            sampler.take(&mut engine, &stride);
            if steps > 0 {
                between_steps(&mut engine, &mut after, grid.instant(steps));
            }
            steps += 1;
        }
        let Sampler { sites, mut out, .. } = sampler;
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

/// A step that was taken; the start itself before the first.
struct Stride<'a, T> {
    before: &'a State<T>,
    after: &'a State<T>,
    /// When it begins \[s\], from the motion's start; none for the start itself.
    begin_s: Option<f64>,
    /// When it ends \[s\], from the motion's start.
    end_s: f64,
    h: f64,
}

/// Takes the samples step by step.
struct Sampler<'a, S: Stages> {
    run: &'a Run<'a, S::T>,
    sites: Vec<Keypoint<S>>,
    /// The first sample that some lane still waits for.
    first: usize,
    sample: State<S::T>,
    out: Samples<S::T>,
}

impl<'a, S: Stages> Sampler<'a, S> {
    fn new(run: &'a Run<'a, S::T>, sites: Vec<Keypoint<S>>, state: &State<S::T>) -> Self {
        let instants = run.sample_times_s.len();
        let stored = if run.states { instants } else { 0 };
        let out = Samples {
            qpos: vec![S::T::ZERO; stored * state.qpos.len()],
            qvel: vec![S::T::ZERO; stored * state.qvel.len()],
            position_m: vec![[S::T::ZERO; 3]; instants * (sites.len() + run.model.encoders.len())],
            failed: vec![None; S::T::LANES],
        };
        Self { run, sites, first: 0, sample: state.clone(), out }
    }

    /// Takes what samples lie in `stride`, each lane its own. One within a billionth of a step of an instant belongs to it.
    fn take(&mut self, engine: &mut Engine<S>, stride: &Stride<'_, S::T>) {
        let h = stride.h;
        for row in self.first..self.run.sample_times_s.len() {
            let (elapsed, reached, any, all) = tuned!(S::T, {
                let elapsed = S::T::from_f64(self.run.sample_times_s[row]) - self.run.start_s;
                let reached = !S::T::from_f64(stride.end_s + 1e-9 * h).less(elapsed);
                (elapsed, reached, reached.any(), reached.all())
            });
            if !any {
                break;
            }
            if row == self.first && all {
                self.first += 1;
            }
            tuned!(S::T, {
                let mut here = reached;
                match stride.begin_s {
                    None => {
                        self.sample.qpos.copy_from_slice(&stride.after.qpos);
                        self.sample.qvel.copy_from_slice(&stride.after.qvel);
                    }
                    Some(begin_s) => {
                        here = here & S::T::from_f64(begin_s + 1e-9 * h).less(elapsed);
                        self.between(
                            engine,
                            stride,
                            (elapsed - S::T::from_f64(begin_s)) * S::T::from_f64(1.0 / h),
                        );
                    }
                }
                if here.any() {
                    self.keep(engine, row, here);
                }
            });
        }
    }

    /// Puts the sample at this `share` of the step.
    #[inline(always)]
    fn between(&mut self, engine: &Engine<S>, stride: &Stride<'_, S::T>, share: S::T) {
        let (before, after) = (stride.before, stride.after);
        let (start, end) = ((&before.qpos[..], &before.qvel[..]), (&after.qpos[..], &after.qvel[..]));
        integrate::between(&engine.plant, start, end, stride.h, share, &mut self.sample.qpos);
        for ((v, &v0), &v1) in self.sample.qvel.iter_mut().zip(&before.qvel).zip(&after.qvel) {
            *v = v0 + share * (v1 - v0);
        }
    }

    /// Keeps the sample as `row` in the lanes that are `here`.
    #[inline(always)]
    fn keep(&mut self, engine: &mut Engine<S>, row: usize, here: <S::T as Scalar>::Mask) {
        let time_s = self.run.sample_times_s[row];
        engine.stand(time_s, S::T::from_f64(time_s));
        kinematics::kinematics(&engine.plant, &self.sample.qpos, &mut engine.work);
        let (work, layout) = (&engine.work, &engine.plant.layout);
        let model = self.run.model;
        let width = self.sites.len() + model.encoders.len();
        let (points, pointers) =
            self.out.position_m[row * width..(row + 1) * width].split_at_mut(self.sites.len());
        for (place, &(body, own, at)) in points.iter_mut().zip(&self.sites) {
            let place_now = S::lift(layout, body, own, work.pos[body] + S::apply(&work.rot[body], at));
            *place = choose(here, place_now, *place);
        }
        for (place, encoder) in pointers.iter_mut().zip(&model.encoders) {
            let angle = self.sample.qpos[model.joints[encoder.joint].qpos_address];
            *place = choose(here, encoder.pointer(angle), *place);
        }
        if self.run.states {
            let (nq, nv) = (self.sample.qpos.len(), self.sample.qvel.len());
            for (stored, &q) in self.out.qpos[row * nq..(row + 1) * nq].iter_mut().zip(&self.sample.qpos) {
                *stored = S::T::select(here, q, *stored);
            }
            for (stored, &v) in self.out.qvel[row * nv..(row + 1) * nv].iter_mut().zip(&self.sample.qvel) {
                *stored = S::T::select(here, v, *stored);
            }
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
