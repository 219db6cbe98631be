//! Moves one mechanism step by step.

mod forces;
mod integrators;

pub use forces::Forces;

use crate::dynamics::implicit::FluidSlope;
use crate::dynamics::plant::Plant;
use crate::dynamics::restraint::{Solver, multiply};
use crate::dynamics::{Work, actuation, bias, fluid, inertia, kinematics, passive};
use crate::model::{ActuatorKind, Integrator, JointKind, Model, State};
use crate::rollout::{RolloutError, RolloutOptions};
use crate::scalar::{Mask, Scalar};

/// A speed \[rad/s\] or \[m/s\] no mechanism in a tank reaches: beyond it the run counts as diverged.
const ABSURD_SPEED: f64 = 1e5;

/// Moves one mechanism step by step, allocating nothing after it is made.
///
/// With [`RolloutOptions::prescribed`] the joints of `position` drives follow their commands exactly: at the start
/// of each step their velocity becomes the secant over the step; the jump acts on the other joints as an
/// impulse through the mass matrix, v_f -= M_ff^-1 M_fp dv; inside the step they do not accelerate, whichever
/// the integrator. Their drives exert no force. A drive without any command then leaves its joint free.
#[derive(Debug, Clone)]
pub struct Simulator<T> {
    pub(crate) plant: Plant<T>,
    pub(crate) work: Work<T>,
    solver: Option<Solver<T>>,
    slope: Option<FluidSlope<T>>,
    integrator: Integrator,
    timestep_s: f64,
    hold_command: bool,
    joint_of_dof: Vec<String>,
    /// Per drive: whether its joint is prescribed.
    prescribed: Vec<bool>,
    /// Per drive: whether it exerts no force.
    off: Vec<bool>,
    /// Per dof: whether its acceleration is prescribed 0.
    held: Vec<bool>,
    command: Vec<T>,
    force: Vec<T>,
    matrix: Vec<T>,
    /// Velocity at the start of the last step, after the prescribed joints' jump.
    pub(crate) departure: Vec<T>,
    stage: State<T>,
    next_qpos: Vec<T>,
    sum_v: Vec<T>,
    sum_a: Vec<T>,
    rate: Vec<T>,
    /// Rotation vectors since the step began, at the dofs of balls and free bodies.
    turned: Vec<T>,
}

impl<T: Scalar> Simulator<T> {
    /// Prepares `model`; `options.start_s` plays no part here.
    ///
    /// # Errors
    /// [`RolloutError::Timestep`] and [`RolloutError::Unsupported`].
    pub fn new(model: &Model<T>, options: &RolloutOptions) -> Result<Self, RolloutError> {
        let timestep_s = options.timestep_s.unwrap_or(model.settings.timestep_s);
        if !(timestep_s.is_finite() && timestep_s > 0.0) {
            return Err(RolloutError::Timestep { timestep_s });
        }
        let integrator = options.integrator.unwrap_or(model.settings.integrator);
        let plant = Plant::new(model);
        if let (Integrator::ImplicitFast, Some(body)) = (integrator, plant.lone_free_body()) {
            return Err(RolloutError::Unsupported {
                what: format!("integrator implicitfast on the lone free body `{}`", model.bodies[body].name),
                instead: "use euler or rk4".into(),
            });
        }
        let slope = (integrator == Integrator::ImplicitFast).then(|| FluidSlope::new(&plant));
        let work = Work::new(&plant);
        let drives = model.actuators.len();
        let joint_of_dof = model
            .joints
            .iter()
            .flat_map(|joint| std::iter::repeat_n(joint.name.clone(), joint.kind.nv()))
            .collect();
        let follows = |kind| options.prescribed && kind == ActuatorKind::Position;
        let zeros = || vec![T::ZERO; plant.nv];
        let rest = model.rest_state();
        let mut simulator = Self {
            solver: None,
            slope,
            integrator,
            timestep_s,
            hold_command: options.hold_command,
            joint_of_dof,
            prescribed: model.actuators.iter().map(|actuator| follows(actuator.kind)).collect(),
            off: vec![false; drives],
            held: vec![false; plant.nv],
            command: vec![T::ZERO; drives],
            force: zeros(),
            matrix: vec![T::ZERO; plant.chain.len()],
            departure: zeros(),
            next_qpos: rest.qpos.clone(),
            sum_v: zeros(),
            sum_a: zeros(),
            rate: zeros(),
            turned: zeros(),
            stage: rest,
            plant,
            work,
        };
        simulator.mark_held();
        if !simulator.plant.restraints.is_empty() {
            let weights = simulator.inverse_weights(model);
            simulator.solver = Some(Solver::new(&simulator.plant, weights));
        }
        Ok(simulator)
    }

    /// The time step \[s\].
    pub fn timestep_s(&self) -> f64 {
        self.timestep_s
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
    fn inverse_weights(&mut self, model: &Model<T>) -> Vec<T> {
        self.position_stage(&model.rest_state().qpos);
        self.matrix.copy_from_slice(&self.work.mass);
        inertia::factor(&self.plant, &mut self.matrix);
        let mut weights: Vec<T> = (0..self.plant.nv)
            .map(|dof| {
                self.force.fill(T::ZERO);
                self.force[dof] = T::ONE;
                inertia::solve(&self.plant, &self.matrix, &mut self.force);
                self.force[dof]
            })
            .collect();
        for joint in &model.joints {
            let three: &[usize] = match joint.kind {
                JointKind::Hinge | JointKind::Slide => &[],
                JointKind::Ball => &[0],
                JointKind::Free => &[0, 3],
            };
            for &first in three {
                let axes = &mut weights[joint.dof_address + first..joint.dof_address + first + 3];
                let mean = (axes[0] + axes[1] + axes[2]) * T::from_f64(1.0 / 3.0);
                axes.fill(mean);
            }
        }
        weights
    }

    /// Puts the prescribed joints of `state` where their commands are at `time_s`, at rest.
    pub(crate) fn align(&mut self, state: &mut State<T>, time_s: f64, command: &impl Fn(usize, f64) -> f64) {
        for (index, drive) in
            self.plant.drives.iter().enumerate().filter(|(index, _)| self.prescribed[*index])
        {
            state.qpos[drive.q] = drive.command(T::from_f64(command(index, time_s))) / drive.gear;
            state.qvel[drive.dof] = T::ZERO;
        }
    }

    /// Takes one step from `time_s` with the commands held at `command`, shape (actuators).
    ///
    /// # Errors
    /// [`RolloutError::Diverged`].
    pub fn step(&mut self, state: &mut State<T>, time_s: f64, command: &[f64]) -> Result<(), RolloutError> {
        self.step_with(state, time_s, self.timestep_s, &|drive: usize, _: f64| command[drive])
    }

    /// Goes from `from_s` to `to_s` in whole steps and a shorter last one, the commands held.
    ///
    /// # Errors
    /// [`RolloutError::Diverged`].
    pub fn advance(
        &mut self,
        state: &mut State<T>,
        from_s: f64,
        to_s: f64,
        command: &[f64],
    ) -> Result<(), RolloutError> {
        let command = |drive: usize, _: f64| command[drive];
        let whole = ((to_s - from_s) / self.timestep_s).floor().max(0.0);
        for step in 0..whole as u64 {
            let time_s = from_s + step as f64 * self.timestep_s;
            self.step_with(state, time_s, self.timestep_s, &command)?;
        }
        let reached = from_s + whole * self.timestep_s;
        // what is left below a thousandth of a step is rounding
        if to_s - reached > 1e-3 * self.timestep_s {
            self.step_with(state, reached, to_s - reached, &command)?;
        }
        Ok(())
    }

    /// Takes one step of `h` \[s\] from `time_s`; `command(drive, time)` is asked where the integrator needs it.
    ///
    /// # Errors
    /// [`RolloutError::Diverged`].
    pub fn step_with(
        &mut self,
        state: &mut State<T>,
        time_s: f64,
        h: f64,
        command: &impl Fn(usize, f64) -> f64,
    ) -> Result<(), RolloutError> {
        self.sample(time_s, command);
        self.position_stage(&state.qpos);
        self.prescribe(state, time_s + h, h, command);
        self.departure.copy_from_slice(&state.qvel);
        match self.integrator {
            Integrator::Euler | Integrator::ImplicitFast => self.euler(state, h),
            Integrator::Rk4 => self.runge_kutta(state, time_s, h, command),
        }
        self.check(state, time_s + h)
    }

    fn sample(&mut self, time_s: f64, command: &impl Fn(usize, f64) -> f64) {
        for (drive, value) in self.command.iter_mut().enumerate() {
            *value = T::from_f64(command(drive, time_s));
        }
    }

    /// What depends on the coordinates alone.
    fn position_stage(&mut self, qpos: &[T]) {
        kinematics::kinematics(&self.plant, qpos, &mut self.work);
        inertia::body_inertias(&self.plant, &mut self.work);
        inertia::mass_matrix(&self.plant, &mut self.work);
    }

    /// The forces on the dofs at this state, after [`Self::position_stage`].
    fn force_stage(&mut self, qpos: &[T], qvel: &[T], h: f64) {
        let (plant, work, force) = (&self.plant, &mut self.work, &mut self.force);
        bias::velocities(plant, qvel, work);
        bias::bias(plant, work);
        passive::gravity_compensation(plant, work);
        fluid::fluid(plant, work);
        force.fill(T::ZERO);
        bias::project(plant, work, force);
        passive::springs(plant, qpos, force);
        passive::dampers(plant, qvel, force);
        actuation::actuation(plant, qpos, qvel, &self.command, &self.off, force);
        self.still_held();
        if let Some(solver) = &mut self.solver {
            solver.resolve(&self.plant, &self.work, &self.held, h, qpos, qvel, &mut self.force);
        }
    }

    fn still_held(&mut self) {
        for (force, &held) in self.force.iter_mut().zip(&self.held) {
            if held {
                *force = T::ZERO;
            }
        }
    }

    /// Turns `force` into accelerations.
    fn accelerate(&mut self) {
        inertia::hold(&self.plant, &self.held, &mut self.matrix);
        inertia::factor(&self.plant, &mut self.matrix);
        inertia::solve(&self.plant, &self.matrix, &mut self.force);
    }

    fn prescribe(&mut self, state: &mut State<T>, end_s: f64, h: f64, command: &impl Fn(usize, f64) -> f64) {
        if !self.prescribed.contains(&true) {
            return;
        }
        self.sum_v.fill(T::ZERO);
        for (index, drive) in
            self.plant.drives.iter().enumerate().filter(|(index, _)| self.prescribed[*index])
        {
            let target = drive.command(T::from_f64(command(index, end_s))) / drive.gear;
            let secant = (target - state.qpos[drive.q]) / T::from_f64(h);
            self.sum_v[drive.dof] = secant - state.qvel[drive.dof];
            state.qvel[drive.dof] = secant;
        }
        multiply(&self.plant, &self.work.mass, &self.sum_v, &mut self.force);
        for force in &mut self.force {
            *force = -*force;
        }
        self.still_held();
        self.matrix.copy_from_slice(&self.work.mass);
        self.accelerate();
        for (v, &dv) in state.qvel.iter_mut().zip(&self.force) {
            *v += dv;
        }
    }

    fn check(&self, state: &State<T>, time_s: f64) -> Result<(), RolloutError> {
        let limit = T::from_f64(ABSURD_SPEED);
        match state.qvel.iter().position(|v| !v.abs().less(limit).all()) {
            None => Ok(()),
            Some(dof) => Err(RolloutError::Diverged { joint: self.joint_of_dof[dof].clone(), time_s }),
        }
    }
}
