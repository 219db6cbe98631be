//! Moves one mechanism step by step.

mod engine;
mod forces;
mod halving;
mod integrators;
mod rosenbrock;
mod unsupported;

pub(crate) use engine::{AppliedForce, Engine};
pub use forces::Forces;

use crate::error::RolloutError;
use crate::model::{Integrator, Model, State};
use crate::options::RolloutOptions;
use crate::scalar::Scalar;
use crate::space::{Planar, Plane, Spatial};

/// Moves one mechanism step by step, allocating nothing after it is made.
///
/// With [`RolloutOptions::prescribed`] the joints of `position` drives follow their commands exactly: at the start
/// of each step their velocity becomes the secant over the step; the jump acts on the other joints as an
/// impulse through the mass matrix, v_f -= M_ff^-1 M_fp dv; inside the step they do not accelerate, whichever
/// the integrator. Their drives exert no force. A drive without any command then leaves its joint free.
///
/// The model's causes act as in a rollout, but for those between command and drive, which a
/// [`CommandPath`](crate::CommandPath) applies, and the camera's.
///
/// A mechanism whose hinges are all parallel is computed in their plane, at a fraction of the cost and with the same
/// motion to rounding.
///
/// A base that moves ([`RolloutOptions::base`]) is where its path is at the time of the step.
#[derive(Debug, Clone)]
pub struct Simulator(InSpace);

/// A mechanism in the space that suits it.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant, reason = "of similar size, and there are few of them")]
enum InSpace {
    Planar(Engine<Planar<f64>>),
    Spatial(Engine<Spatial<f64>>),
}

/// The plane to compute `model` in; `None` for space. The water's slopes for implicitfast, and contact, are there in space only.
pub(crate) fn plane<T: Scalar>(model: &Model<T>, options: &RolloutOptions) -> Option<Plane<T>> {
    let plane = (!one_by_one(model, options)).then(|| Plane::of(model)).flatten();
    // a base moves in the picture's plane
    plane.filter(|plane| options.base.is_none() || plane.is_pictured())
}

/// Whether the step needs the water's slopes or contact, which are there in space only and not in lanes.
pub(crate) fn one_by_one<T: Scalar>(model: &Model<T>, options: &RolloutOptions) -> bool {
    let integrator = options.integrator.unwrap_or(model.settings.integrator);
    model.contacts.simulated() || integrator == Integrator::ImplicitFast && options.steps.is_none()
}

macro_rules! in_space {
    ($self:expr, $engine:ident => $does:expr) => {
        match $self {
            InSpace::Planar($engine) => $does,
            InSpace::Spatial($engine) => $does,
        }
    };
}

impl Simulator {
    /// Prepares `model`; `options.start_s` plays no part here.
    ///
    /// # Errors
    /// [`RolloutError::Timestep`] and [`RolloutError::Unsupported`].
    pub fn new(model: &Model, options: &RolloutOptions) -> Result<Self, RolloutError> {
        let altered = model.altered();
        let model = altered.as_ref().unwrap_or(model);
        Ok(Self(match plane(model, options) {
            Some(plane) => InSpace::Planar(Engine::new(model, plane, options)?),
            None => InSpace::Spatial(Engine::new(model, (), options)?),
        }))
    }

    /// The time step \[s\].
    pub fn timestep_s(&self) -> f64 {
        in_space!(&self.0, engine => engine.timestep_s)
    }

    /// Every generalized force at `state` with the commands `command`, shape (actuators).
    pub fn forces(&mut self, state: &State, command: &[f64]) -> Forces<f64> {
        in_space!(&mut self.0, engine => engine.forces(state, command))
    }

    /// Takes one step from `time_s` with the commands held at `command`, shape (actuators).
    ///
    /// # Errors
    /// [`RolloutError::Diverged`].
    pub fn step(&mut self, state: &mut State, time_s: f64, command: &[f64]) -> Result<(), RolloutError> {
        self.step_with(state, time_s, self.timestep_s(), &|drive: usize, _: f64| command[drive])
    }

    /// Goes from `from_s` to `to_s` in whole steps and a shorter last one, the commands held.
    ///
    /// # Errors
    /// [`RolloutError::Diverged`].
    pub fn advance(
        &mut self,
        state: &mut State,
        from_s: f64,
        to_s: f64,
        command: &[f64],
    ) -> Result<(), RolloutError> {
        let command = |drive: usize, _: f64| command[drive];
        let h = self.timestep_s();
        let whole = ((to_s - from_s) / h).floor().max(0.0);
        for step in 0..whole as u64 {
            let time_s = from_s + step as f64 * h;
            self.step_with(state, time_s, h, &command)?;
        }
        let reached = from_s + whole * h;
        // what is left below a thousandth of a step is rounding
        if to_s - reached > 1e-3 * h {
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
        state: &mut State,
        time_s: f64,
        h: f64,
        command: &dyn Fn(usize, f64) -> f64,
    ) -> Result<(), RolloutError> {
        in_space!(&mut self.0, engine => {
            if engine.step_with(state, time_s, h, command) {
                return Ok(());
            }
            engine.diverged(state, 0, time_s + h).map_or(Ok(()), Err)
        })
    }
}
