//! One mechanism in its space, stepped.

use std::sync::Arc;

use super::halving::{HALVINGS_MAX, Halving};
use super::rosenbrock::Rosenbrock;
use super::unsupported;
use crate::base::{BaseMotion, BasePath};
use crate::causes::{Memory, Moment, Terms};
use crate::dynamics::friction_and_limits::{Solver, multiply};
use crate::dynamics::plant::Plant;
use crate::dynamics::stages::{ContactStage, SlopeStage, Stages};
use crate::dynamics::{Work, actuation, bias, fluid, inertia, kinematics, passive, tendon};
use crate::error::RolloutError;
use crate::math::Vec3;
use crate::model::{ActuatorKind, Coordinates, Integrator, Model, State};
use crate::options::RolloutOptions;
use crate::scalar::{Mask, Scalar, tuned};
use crate::space::Motion;
use crate::steps::Method;

/// Beyond this speed \[rad/s\] or \[m/s\], which no mechanism in a tank reaches, a run counts as diverged (chosen).
const DIVERGED_SPEED: f64 = 1e5;

/// How a step is taken: MuJoCo's ways and ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stepper {
    Euler,
    ImplicitFast,
    RungeKutta,
    Rosenbrock,
}

/// A force on a dof that goes along a straight line in time \[N m\] or \[N\].
#[derive(Debug, Clone, Copy)]
pub(crate) struct AppliedForce<T> {
    /// The force at `from_s`.
    pub(crate) level: T,
    /// By how much it rises a second.
    pub(crate) rate: T,
    /// \[s\].
    pub(crate) from_s: f64,
}

impl<T: Scalar> AppliedForce<T> {
    #[inline(always)]
    fn at(&self, time_s: f64) -> T {
        self.level + self.rate * T::from_f64(time_s - self.from_s)
    }
}

/// What [`super::Simulator`] is, in one space.
#[derive(Debug, Clone)]
pub(crate) struct Engine<S: Stages> {
    pub(crate) plant: Plant<S>,
    /// The causes that act in a step.
    pub(super) terms: Terms<S>,
    pub(crate) work: Work<S>,
    pub(super) solver: Option<Solver<S::T>>,
    pub(super) contacts: Option<Box<S::Contacts>>,
    pub(super) slope: Option<S::Slope>,
    pub(super) stepper: Stepper,
    pub(super) rosenbrock: Option<Rosenbrock<S::T>>,
    pub(crate) timestep_s: f64,
    /// Room for steps that are taken again in halves, one for each halving.
    pub(super) halvings: Vec<Halving<S::T>>,
    /// The step that restraints are made for \[s\].
    pub(super) restraint_step_s: f64,
    pub(super) hold_command: bool,
    joint_of_dof: Vec<String>,
    /// Per drive: whether its joint is prescribed.
    prescribed: Vec<bool>,
    /// Per drive: whether it exerts no force.
    pub(super) off: Vec<bool>,
    /// Per drive: whether it does not because nothing is commanded just now.
    idle: Vec<bool>,
    /// Per dof: whether its acceleration is prescribed 0.
    pub(super) held: Vec<bool>,
    /// What the causes remember from step to step.
    pub(super) memory: Memory<S>,
    /// When, within a step, the forces are asked for.
    pub(super) moment: Moment,
    /// Where the base goes.
    base: Option<Arc<BasePath>>,
    /// By how much each lane's clock is ahead of the one that steps are counted on \[s\].
    pub(crate) clock: S::T,
    /// Length of the last step \[s\]; infinite before the first.
    last_step_s: f64,
    /// Forces that somebody adds on the dofs, beside those of the model; empty for none.
    pub(crate) applied: Vec<AppliedForce<S::T>>,
    pub(super) command: Vec<S::T>,
    pub(super) force: Vec<S::T>,
    pub(super) matrix: Vec<S::T>,
    /// Velocity at the start of the last step, after the prescribed joints' jump.
    pub(crate) departure: Vec<S::T>,
    pub(super) stage: State<S::T>,
    pub(super) next_qpos: Vec<S::T>,
    pub(super) sum_v: Vec<S::T>,
    pub(super) sum_a: Vec<S::T>,
    pub(super) rate: Vec<S::T>,
    /// Rotation vectors since the step began, at the dofs of balls and free bodies.
    pub(super) turned: Vec<S::T>,
}

impl<S: Stages> Engine<S> {
    /// Prepares `model`, laid out in its space.
    pub(crate) fn new(
        model: &Model<S::T>,
        layout: S::Layout,
        options: &RolloutOptions,
    ) -> Result<Self, RolloutError> {
        let own = model.settings.timestep_s;
        let timestep_s =
            options.steps.as_ref().map_or(options.timestep_s.unwrap_or(own), |steps| steps.longest_s);
        if !(timestep_s.is_finite() && timestep_s > 0.0) {
            return Err(RolloutError::Timestep { timestep_s });
        }
        let stepper = match (
            options.steps.as_ref().map(|steps| steps.method),
            options.integrator.unwrap_or(model.settings.integrator),
        ) {
            (Some(Method::Rosenbrock), _) => Stepper::Rosenbrock,
            (Some(Method::RungeKutta), _) | (None, Integrator::Rk4) => Stepper::RungeKutta,
            (None, Integrator::Euler) => Stepper::Euler,
            (None, Integrator::ImplicitFast | Integrator::Implicit) => Stepper::ImplicitFast,
        };
        let plant = Plant::new(model, layout);
        let terms = Terms::new(model, &plant);
        unsupported::check(model, &plant, stepper, options)?;
        let slope = if stepper == Stepper::ImplicitFast { S::Slope::new(&plant) } else { None };
        let work = Work::new(&plant);
        let drives = model.actuators.len();
        let joint_of_dof = model
            .joints
            .iter()
            .flat_map(|joint| std::iter::repeat_n(joint.name.clone(), joint.kind.nv()))
            .collect();
        let follows = |kind| options.prescribed && kind == ActuatorKind::Position;
        let zeros = || vec![S::T::ZERO; plant.nv];
        let rest = model.rest_state();
        let mut simulator = Self {
            solver: None,
            contacts: None,
            slope,
            rosenbrock: (stepper == Stepper::Rosenbrock).then(|| Rosenbrock::new(&plant)),
            stepper,
            timestep_s,
            halvings: Vec::new(),
            restraint_step_s: if options.steps.is_some() { own } else { timestep_s },
            hold_command: options.hold_command && options.steps.is_none(),
            joint_of_dof,
            prescribed: model.actuators.iter().map(|actuator| follows(actuator.kind)).collect(),
            off: vec![false; drives],
            idle: vec![false; drives],
            held: vec![false; plant.nv],
            memory: terms.memory(),
            moment: Moment::default(),
            base: options.base.clone(),
            clock: S::T::ZERO,
            last_step_s: f64::INFINITY,
            applied: Vec::new(),
            command: vec![S::T::ZERO; drives],
            force: zeros(),
            matrix: vec![S::T::ZERO; plant.chain.len()],
            departure: zeros(),
            next_qpos: rest.qpos.clone(),
            sum_v: zeros(),
            sum_a: zeros(),
            rate: zeros(),
            turned: zeros(),
            stage: rest,
            plant,
            terms,
            work,
        };
        simulator.mark_held();
        if !simulator.plant.restraints.is_empty() {
            let weights = simulator.inverse_weights(model);
            simulator.solver = Some(Solver::new(&simulator.plant, weights));
        }
        simulator.add_contacts(model);
        if simulator.solver.is_some() || simulator.contacts.is_some() {
            if options.steps.is_some() {
                simulator.timestep_s = timestep_s.min(simulator.longest_step_s());
            }
            // what remembers would take the halves for steps of all lanes
            if options.steps.is_some() && !simulator.terms.remember() {
                simulator.halvings = vec![Halving::new(&simulator.stage); HALVINGS_MAX];
            }
        }
        Ok(simulator)
    }

    /// Longest step of our own that the model's restraints bear \[s\].
    pub(crate) fn longest_step_s(&self) -> f64 {
        let restrained = self.solver.as_ref().map_or(f64::INFINITY, |_| Solver::longest_step_s(&self.plant));
        self.contacts.as_ref().map_or(restrained, |contacts| contacts.longest_step_s().min(restrained))
    }

    /// Contacts, where geoms can meet: with numbers of one lane, which is all that such models are computed with.
    fn add_contacts(&mut self, model: &Model<S::T>) {
        if S::T::LANES > 1 {
            return;
        }
        let Some(mut contacts) = S::Contacts::new(model, &self.plant) else { return };
        self.position_stage(&model.rest_state().qpos);
        self.matrix.copy_from_slice(&self.work.mass);
        inertia::factor(&self.plant, &mut self.matrix);
        contacts.weigh(model, &self.plant, &self.work, &self.matrix);
        self.contacts = Some(Box::new(contacts));
    }

    /// Switches off the drives at these places: they exert no force, and where they would prescribe their
    /// joint, it is free.
    pub(crate) fn switch_off(&mut self, silent: &[bool]) {
        for (drive, &silent) in silent.iter().enumerate() {
            if silent && self.prescribed[drive] {
                self.prescribed[drive] = false;
                self.off[drive] = true;
            }
        }
        self.mark_held();
    }

    fn mark_held(&mut self) {
        self.held.fill(false);
        for (drive, plan) in self.plant.drives.iter().enumerate() {
            if self.prescribed[drive] {
                self.held[plan.dof] = true;
                self.off[drive] = true;
            }
        }
    }

    /// The diagonal of the inverse mass matrix at the reference, averaged over the like axes of ball and free
    /// joints: what MuJoCo scales its restraints by.
    fn inverse_weights(&mut self, model: &Model<S::T>) -> Vec<S::T> {
        self.position_stage(&model.rest_state().qpos);
        self.matrix.copy_from_slice(&self.work.mass);
        inertia::factor(&self.plant, &mut self.matrix);
        let mut weights: Vec<S::T> = (0..self.plant.nv)
            .map(|dof| {
                self.force.fill(S::T::ZERO);
                self.force[dof] = S::T::ONE;
                inertia::solve(&self.plant, &self.matrix, &mut self.force);
                self.force[dof]
            })
            .collect();
        for joint in &model.joints {
            for (coordinates, _, dof) in joint.coordinates() {
                let axes = &mut weights[dof..dof + coordinates.nv()];
                if coordinates == Coordinates::Axis {
                    continue;
                }
                let mean = (axes[0] + axes[1] + axes[2]) * S::T::from_f64(1.0 / 3.0);
                axes.fill(mean);
            }
        }
        weights
    }

    /// Puts the prescribed joints of `state` where their commands are at `time_s`; their rates stay as they are.
    pub(crate) fn align(
        &mut self,
        state: &mut State<S::T>,
        time_s: f64,
        command: &dyn Fn(usize, f64) -> S::T,
    ) {
        for (index, drive) in
            self.plant.drives.iter().enumerate().filter(|(index, _)| self.prescribed[*index])
        {
            state.qpos[drive.q] = drive.command(command(index, time_s)) / drive.gear;
        }
    }

    /// Takes one step of `h` \[s\] from `time_s`; `command(drive, time)` is asked where the integrator needs it.
    /// Yields whether all lanes are sound.
    pub(crate) fn step_with(
        &mut self,
        state: &mut State<S::T>,
        time_s: f64,
        h: f64,
        command: &dyn Fn(usize, f64) -> S::T,
    ) -> bool {
        self.moment = Moment { time_s, elapsed_s: 0.0, arrived_s: Some(self.last_step_s) };
        self.last_step_s = h;
        self.sample(time_s, command);
        self.position_stage(&state.qpos);
        if self.prescribed.contains(&true) && self.terms.remember() {
            // what remembers arrives with the velocity before the jump, and jumps with it
            self.force_stage(&state.qpos, &state.qvel);
            self.moment.arrived_s = Some(0.0);
        }
        self.prescribe(state, time_s + h, h, command);
        self.departure.copy_from_slice(&state.qvel);
        self.halving(state, time_s, h, command, 0);
        self.sound_lanes(state).all()
    }

    #[inline(always)]
    pub(super) fn sample(&mut self, time_s: f64, command: &dyn Fn(usize, f64) -> S::T) {
        // only what somebody wrote down may ask for the command of a drive that exerts no force
        let all = self.terms.own.is_some();
        let drives = self.command.iter_mut().zip(&mut self.off).zip(&mut self.idle);
        for (drive, ((value, off), idle)) in drives.enumerate() {
            if all || !*off || *idle {
                let told = command(drive, time_s);
                let is_idle = !told.abs().less(S::T::from_f64(f64::INFINITY)).any();
                if is_idle != *idle && *off == *idle {
                    (*off, *idle) = (is_idle, is_idle);
                }
                *value = if is_idle { S::T::ZERO } else { told };
            }
        }
    }

    /// Puts the base where it is at `time` \[s\], which in every lane is near `about_s`.
    #[inline(always)]
    pub(crate) fn stand(&mut self, about_s: f64, time: S::T) {
        let Some(path) = &self.base else { return };
        let (layout, work) = (&self.plant.layout, &mut self.work);
        tuned!(S::T, {
            let BaseMotion { pose, velocity, acceleration } = path.along(about_s, time);
            let [place, speed, gain] = [pose, velocity, acceleration]
                .map(|[x, z, _]| S::vector(layout, 0, Vec3([x, S::T::ZERO, z])));
            // counter-clockwise as the camera sees it is about -y
            let unit = S::spin(layout, 0, Vec3([S::T::ZERO, -S::T::ONE, S::T::ZERO]));
            work.pos[0] = place;
            work.rot[0] = S::about(unit, pose[2].sin_cos());
            let (turn, quicker) = (unit * velocity[2], unit * acceleration[2]);
            let velocity = Motion { ang: turn, lin: speed };
            // spatial: what the point that passes the origin feels, less what its passing makes of it
            work.base = Some([velocity, Motion { ang: quicker, lin: gain - S::cross(turn, speed) }]);
        });
    }

    /// What depends on the coordinates and, with a base that moves, on the time alone.
    pub(crate) fn position_stage(&mut self, qpos: &[S::T]) {
        self.stand(self.moment.time_s, S::T::from_f64(self.moment.time_s) + self.clock);
        tuned!(S::T, {
            kinematics::kinematics(&self.plant, qpos, &mut self.work);
            inertia::body_inertias(&self.plant, &mut self.work);
            inertia::mass_matrix(&self.plant, &mut self.work);
            self.terms.inertia(&self.plant, &mut self.work);
        });
    }

    /// The forces on the dofs at this state, after [`Self::position_stage`].
    pub(super) fn force_stage(&mut self, qpos: &[S::T], qvel: &[S::T]) {
        let h = self.restraint_step_s;
        tuned!(S::T, {
            let (plant, terms, work, force) = (&self.plant, &self.terms, &mut self.work, &mut self.force);
            force.fill(S::T::ZERO);
            bias::velocities(plant, qvel, work);
            work.water = terms.water(self.moment, self.clock, plant);
            bias::bias(plant, work);
            passive::gravity_compensation(plant, work);
            fluid::fluid(plant, work);
            terms.wrenches(self.moment, plant, work, &mut self.memory);
            if let Some(own) = &terms.own {
                own.wrenches(self.moment, self.clock, plant, work);
            }
            bias::project(plant, work, force);
            passive::springs(plant, qpos, force);
            passive::dampers(plant, qvel, force);
            tendon::tendons(plant, qpos, qvel, force);
            terms.forces(qpos, qvel, force);
            if let Some(own) = &terms.own {
                own.forces((self.moment, self.clock), (qpos, qvel), &self.command, force);
            }
            actuation::actuation(plant, qpos, qvel, &self.command, &self.off, force);
            for (force, applied) in force.iter_mut().zip(&self.applied) {
                *force += applied.at(self.moment.time_s);
            }
        });
        self.still_held();
        let (watched, first) = (!self.halvings.is_empty(), self.moment.elapsed_s == 0.0);
        let (plant, work, force) = (&self.plant, &self.work, &mut self.force);
        let mut touching = false;
        // a constant: lanes are spared the program
        if S::T::LANES == 1
            && let Some(contacts) = &mut self.contacts
        {
            touching = contacts.find(work);
            if touching {
                let solver = self.solver.as_mut();
                contacts.resolve((plant, work), (&self.held, h), (qpos, qvel), solver, force);
            }
            if watched {
                contacts.watch(first);
            }
        }
        if let Some(solver) = &mut self.solver {
            tuned!(S::T, {
                if !touching {
                    solver.resolve(plant, work, &self.held, h, qpos, qvel, force);
                }
                if watched {
                    solver.watch(first);
                }
            });
        }
    }

    #[inline(always)]
    fn still_held(&mut self) {
        for (force, &held) in self.force.iter_mut().zip(&self.held) {
            if held {
                *force = S::T::ZERO;
            }
        }
    }

    /// Makes the mass matrix the one to be factored. The next [`Self::position_stage`] computes it again.
    pub(super) fn take_mass(&mut self) {
        std::mem::swap(&mut self.matrix, &mut self.work.mass);
    }

    /// Turns `force`, from [`Self::force_stage`], into accelerations.
    pub(super) fn accelerate(&mut self) {
        self.take_mass();
        self.solve_matrix();
    }

    /// Turns `force` into accelerations by the mass matrix in `matrix`.
    pub(super) fn solve_matrix(&mut self) {
        tuned!(S::T, {
            inertia::hold(&self.plant, &self.held, &mut self.matrix);
            inertia::factor(&self.plant, &mut self.matrix);
            inertia::solve(&self.plant, &self.matrix, &mut self.force);
        });
    }

    fn prescribe(
        &mut self,
        state: &mut State<S::T>,
        end_s: f64,
        h: f64,
        command: &dyn Fn(usize, f64) -> S::T,
    ) {
        if !self.prescribed.contains(&true) {
            return;
        }
        tuned!(S::T, {
            self.sum_v.fill(S::T::ZERO);
            let prescribed = self.prescribed.iter();
            for ((index, drive), _) in
                self.plant.drives.iter().enumerate().zip(prescribed).filter(|(_, prescribed)| **prescribed)
            {
                let target = drive.command(command(index, end_s)) / drive.gear;
                let secant = (target - state.qpos[drive.q]) / S::T::from_f64(h);
                self.sum_v[drive.dof] = secant - state.qvel[drive.dof];
                state.qvel[drive.dof] = secant;
            }
            multiply(&self.plant, &self.work.mass, &self.sum_v, &mut self.force);
            for force in &mut self.force {
                *force = -*force;
            }
        });
        self.still_held();
        self.matrix.copy_from_slice(&self.work.mass);
        self.solve_matrix();
        tuned!(S::T, {
            for (v, &dv) in state.qvel.iter_mut().zip(&self.force) {
                *v += dv;
            }
        });
    }

    /// The lanes whose velocities are numbers, and not absurd.
    pub(crate) fn sound_lanes(&self, state: &State<S::T>) -> <S::T as Scalar>::Mask {
        tuned!(S::T, {
            let limit = S::T::from_f64(DIVERGED_SPEED);
            let mut sound = S::T::ZERO.less(S::T::ONE);
            for v in &state.qvel {
                sound = sound & v.abs().less(limit);
            }
            sound
        })
    }

    /// The joint that has diverged in `lane` at `time_s`, if one has.
    pub(crate) fn diverged(&self, state: &State<S::T>, lane: usize, time_s: f64) -> Option<RolloutError> {
        let limit = S::T::from_f64(DIVERGED_SPEED);
        let dof = state.qvel.iter().position(|v| !v.abs().less(limit).test(lane))?;
        Some(RolloutError::Diverged { joint: self.joint_of_dof[dof].clone(), time_s })
    }
}
