//! Moves one mechanism step by step.

use crate::dynamics::implicit::FluidSlope;
use crate::dynamics::plant::Plant;
use crate::dynamics::restraint::{Solver, multiply};
use crate::dynamics::{Work, actuation, bias, fluid, inertia, integrate, kinematics, passive};
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

/// The generalized forces at one state, shape (nv) each, with MuJoCo's signs.
#[derive(Debug, Clone, PartialEq)]
pub struct Forces<T> {
    /// What gravity and rotation call for; the others add up against it.
    pub bias: Vec<T>,
    /// Joint springs.
    pub spring: Vec<T>,
    /// Joint dampers.
    pub damper: Vec<T>,
    /// Gravity compensation.
    pub gravity_compensation: Vec<T>,
    /// Water.
    pub fluid: Vec<T>,
    /// Drives.
    pub actuator: Vec<T>,
    /// Friction loss and end stops.
    pub restraint: Vec<T>,
    /// The acceleration that follows.
    pub acceleration: Vec<T>,
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

    fn euler(&mut self, state: &mut State<T>, h: f64) {
        self.force_stage(&state.qpos, &state.qvel, h);
        let h = T::from_f64(h);
        self.matrix.copy_from_slice(&self.work.mass);
        if self.plant.damped {
            passive::add_damping(&self.plant, &state.qvel, h, &mut self.matrix);
        }
        if let Some(slope) = &mut self.slope {
            let (plant, matrix) = (&self.plant, &mut self.matrix);
            slope.add(plant, &self.work, h, matrix);
            actuation::add_slope(plant, &state.qpos, &state.qvel, &self.command, &self.off, h, matrix);
        }
        self.accelerate();
        for (v, &a) in state.qvel.iter_mut().zip(&self.force) {
            *v += h * a;
        }
        integrate::advance(&self.plant, &state.qpos, &state.qvel, h, &mut self.next_qpos);
        state.qpos.copy_from_slice(&self.next_qpos);
    }

    fn runge_kutta(
        &mut self,
        state: &mut State<T>,
        time_s: f64,
        h: f64,
        command: &impl Fn(usize, f64) -> f64,
    ) {
        // shares of the step at which the next stage stands, and weights in the sum
        const STAGES: [(f64, f64); 4] =
            [(0.5, 1.0 / 6.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 3.0), (0.0, 1.0 / 6.0)];
        let mut stage = std::mem::replace(&mut self.stage, State { qpos: Vec::new(), qvel: Vec::new() });
        stage.qpos.copy_from_slice(&state.qpos);
        stage.qvel.copy_from_slice(&state.qvel);
        self.sum_v.fill(T::ZERO);
        self.sum_a.fill(T::ZERO);
        for (k, (ahead, weight)) in STAGES.into_iter().enumerate() {
            if k > 0 {
                self.position_stage(&stage.qpos);
            }
            self.force_stage(&stage.qpos, &stage.qvel, h);
            self.matrix.copy_from_slice(&self.work.mass);
            self.accelerate();
            self.rate.copy_from_slice(&stage.qvel);
            if k > 0 {
                integrate::follow_turn(&self.plant, &self.turned, &mut self.rate);
            }
            let weight = T::from_f64(weight);
            for dof in 0..self.plant.nv {
                self.sum_v[dof] += weight * self.rate[dof];
                self.sum_a[dof] += weight * self.force[dof];
            }
            if k < 3 {
                let forward = T::from_f64(ahead * h);
                integrate::advance(&self.plant, &state.qpos, &self.rate, forward, &mut stage.qpos);
                for dof in 0..self.plant.nv {
                    self.turned[dof] = forward * self.rate[dof];
                    stage.qvel[dof] = state.qvel[dof] + forward * self.force[dof];
                }
                if !self.hold_command {
                    self.sample(time_s + ahead * h, command);
                }
            }
        }
        let h = T::from_f64(h);
        integrate::advance(&self.plant, &state.qpos, &self.sum_v, h, &mut self.next_qpos);
        state.qpos.copy_from_slice(&self.next_qpos);
        for (v, &a) in state.qvel.iter_mut().zip(&self.sum_a) {
            *v += h * a;
        }
        self.stage = stage;
    }

    fn check(&self, state: &State<T>, time_s: f64) -> Result<(), RolloutError> {
        let limit = T::from_f64(ABSURD_SPEED);
        match state.qvel.iter().position(|v| !v.abs().less(limit).all()) {
            None => Ok(()),
            Some(dof) => Err(RolloutError::Diverged { joint: self.joint_of_dof[dof].clone(), time_s }),
        }
    }

    /// Every generalized force at `state` with the commands `command`, shape (actuators).
    pub fn forces(&mut self, state: &State<T>, command: &[f64]) -> Forces<T> {
        let (qpos, qvel) = (&state.qpos, &state.qvel);
        self.sample(0.0, &|drive, _| command[drive]);
        self.position_stage(qpos);
        let (plant, work) = (&self.plant, &mut self.work);
        bias::velocities(plant, qvel, work);
        let zeros = || vec![T::ZERO; plant.nv];
        let mut of_wrenches = |add: &dyn Fn(&Plant<T>, &mut Work<T>)| {
            let mut force = zeros();
            add(plant, work);
            bias::project(plant, work, &mut force);
            force
        };
        let bias: Vec<T> = of_wrenches(&bias::bias).into_iter().map(|force| -force).collect();
        let gravity_compensation = of_wrenches(&passive::gravity_compensation);
        let fluid = of_wrenches(&fluid::fluid);
        let (mut spring, mut damper, mut actuator) = (zeros(), zeros(), zeros());
        passive::springs(plant, qpos, &mut spring);
        passive::dampers(plant, qvel, &mut damper);
        actuation::actuation(plant, qpos, qvel, &self.command, &self.off, &mut actuator);

        self.force_stage(qpos, qvel, self.timestep_s);
        let total = self.force.clone();
        let restraint = (0..total.len())
            .map(|i| {
                total[i]
                    - (spring[i] + damper[i] + gravity_compensation[i] + fluid[i] + actuator[i] - bias[i])
            })
            .collect();
        self.matrix.copy_from_slice(&self.work.mass);
        self.accelerate();
        let acceleration = self.force.clone();
        Forces { bias, spring, damper, gravity_compensation, fluid, actuator, restraint, acceleration }
    }
}
