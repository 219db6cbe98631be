//! Causes: what a simulation may lack, each one file behind one small interface.
//!
//! A model carries its causes ([`Model::effects`](crate::Model::effects)). [`Model::add_effect`] adds one with neutral
//! values, at which it changes nothing; its numbers are then parameters of the model like any other, called
//! `<cause>/<parameter>`, so that fits and derivatives need nothing new:
//!
//! ```
//! # let text = r#"<mujoco><option density="1000"/><worldbody><body gravcomp="0.8">
//! #   <joint name="hinge" axis="0 -1 0"/><geom name="link" type="box" size="0.005 0.0025 0.015" pos="0 0 -0.0125"
//! #   density="1240" fluidshape="ellipsoid"/><site name="P1" pos="0 0 -0.0275"/></body></worldbody></mujoco>"#;
//! let mut model = sim::Model::from_mjcf(text)?;
//! model.add_effect("added_mass")?;
//! model.set_parameter("added_mass/scale", 1.0)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! There are four ways in which a cause acts, one section of the list below each. Adding a cause is one file, with its
//! [`Info`] and that section's hook, and one line:
//!
//! - `model`: it changes the model's own numbers before anything moves (`fn alter`). Nothing in a step knows of it.
//! - `step`: it exerts forces or has inertia (`Step`); `+ alter` where one of its forms changes the model's own numbers instead.
//! - `drive`: it changes the command on its way to the drives (`drive::Stage`), in the order of the list.
//! - `picture`: it changes what the camera sees (`Look`), in the order of the list.
//!
//! A cause that is absent costs nothing and leaves the motion the same to the bit.

mod info;
mod joints;
#[macro_use]
mod step;
mod waters;

mod added_mass;
mod backlash;
mod basset;
mod buoyancy;
mod cob_offset;
mod coulomb_friction;
mod current;
mod drag_exponent;
pub(crate) mod drive;
mod end_stop;
mod joint_damping;
mod linear_drag;
mod link_mass;
mod one_sided_stiffness;
mod servo_delay;
mod servo_gain;
mod servo_lag;
mod servo_rate_limit;
mod slosh;
mod stiffness;
mod tether;
mod wall;

pub(crate) use coulomb_friction::is_soft;
pub use drive::CommandPath;
pub use info::{Alias, AliasWhen, Info, Kind, Mjcf, ParameterInfo, Per, Role};
pub(crate) use step::{Moment, Step};

use crate::model::{JointKind, Model};
use crate::observation::{
    Look, camera_delay, camera_rotation, camera_scale, camera_tilt, keypoint_slip, lens, rolling_shutter,
};
use crate::scalar::Scalar;
use crate::space::Space;

causes! {
    model {
        current Current,
        buoyancy Buoyancy,
        link_mass LinkMass,
        joint_damping JointDamping,
        stiffness Stiffness,
        keypoint_slip KeypointSlip,
    }
    step {
        added_mass AddedMass,
        slosh Slosh,
        cob_offset CobOffset,
        linear_drag LinearDrag,
        drag_exponent DragExponent,
        wall Wall,
        basset Basset,
        coulomb_friction CoulombFriction + alter,
        one_sided_stiffness OneSidedStiffness,
        end_stop EndStop,
        tether Tether,
    }
    drive {
        servo_gain ServoGain,
        servo_rate_limit ServoRateLimit,
        servo_lag ServoLag,
        backlash Backlash,
        servo_delay ServoDelay,
    }
    picture {
        camera_delay CameraDelay,
        rolling_shutter RollingShutter,
        lens Lens,
        camera_tilt CameraTilt,
        camera_scale CameraScale,
        camera_rotation CameraRotation,
    }
}

/// No such cause.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no cause `{name}`; the causes are {known}")]
pub struct UnknownCause {
    /// The name looked for.
    pub name: String,
    /// The causes there are, listed.
    pub known: String,
}

/// A cause in a model, with its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Effect<T = f64> {
    cause: Cause,
    names: Vec<String>,
    /// For each value, its place in the cause's [`Info::parameters`].
    of: Vec<usize>,
    values: Vec<T>,
}

impl<T: Scalar> Effect<T> {
    /// `cause` in `model`, every parameter neutral.
    fn new(cause: Cause, model: &Model<T>) -> Self {
        let mut effect = Self { cause, names: Vec::new(), of: Vec::new(), values: Vec::new() };
        for (place, parameter) in cause.info().parameters.iter().enumerate() {
            let elements: Vec<String> = match parameter.per {
                Per::Model => vec![parameter.name.into()],
                Per::Joint => axles(model).map(|joint| joint.name.clone()).collect(),
                Per::Body => weighty(model).map(|body| model.bodies[body].name.clone()).collect(),
                Per::Geom => {
                    let wet = model.geoms.iter().filter(|geom| geom.fluid.is_some());
                    wet.map(|geom| geom.name.clone()).collect()
                }
                Per::Keypoint => model.keypoints(),
            };
            for element in elements {
                effect.names.push(format!("{}/{element}", cause.info().name));
                effect.of.push(place);
                effect.values.push(T::from_f64(parameter.neutral));
            }
        }
        effect
    }

    /// Which cause it is.
    pub fn cause(&self) -> Cause {
        self.cause
    }

    /// Names of its parameters, `<cause>/<parameter>`, in the order of [`Self::values`].
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// What is known of its parameters, in the order of [`Self::values`].
    pub fn parameters(&self) -> impl Iterator<Item = &'static ParameterInfo> + '_ {
        self.of.iter().map(|&place| &self.cause.info().parameters[place])
    }

    /// Its parameters' values.
    pub fn values(&self) -> &[T] {
        &self.values
    }

    pub(crate) fn value_mut(&mut self, place: usize) -> &mut T {
        &mut self.values[place]
    }

    /// The parameter at `place` in the cause's list, of which there is one.
    pub(crate) fn one(&self, place: usize) -> T {
        self.each(place)[0]
    }

    /// The family of parameters at `place` in the cause's list.
    pub(crate) fn each(&self, place: usize) -> &[T] {
        let first = self.of.partition_point(|&of| of < place);
        let end = self.of.partition_point(|&of| of <= place);
        &self.values[first..end]
    }

    fn map<U: Scalar>(&self, f: impl Fn(T) -> U) -> Effect<U> {
        Effect {
            cause: self.cause,
            names: self.names.clone(),
            of: self.of.clone(),
            values: self.values.iter().map(|&value| f(value)).collect(),
        }
    }
}

/// The joints with one axis: hinges and slides.
pub(crate) fn axles<T: Scalar>(model: &Model<T>) -> impl Iterator<Item = &crate::model::Joint<T>> {
    model.joints.iter().filter(|joint| matches!(joint.kind, JointKind::Hinge | JointKind::Slide))
}

/// The bodies with mass.
pub(crate) fn weighty<T: Scalar>(model: &Model<T>) -> impl Iterator<Item = usize> + '_ {
    (1..model.bodies.len()).filter(|&body| model.bodies[body].mass != T::ZERO)
}

impl<T: Scalar> Model<T> {
    /// The causes that the model carries, in the order they were added.
    pub fn effects(&self) -> &[Effect<T>] {
        &self.effects
    }

    /// Adds the cause called `name` with neutral values, at which it changes nothing. One that is there stays as it is.
    ///
    /// # Errors
    /// [`UnknownCause`].
    pub fn add_effect(&mut self, name: &str) -> Result<Cause, UnknownCause> {
        let cause: Cause = name.parse()?;
        self.add_cause(cause);
        Ok(cause)
    }

    /// The model's `cause`, added with neutral values if it was not there.
    pub(crate) fn add_cause(&mut self, cause: Cause) -> &mut Effect<T> {
        let place = self.effects.iter().position(|effect| effect.cause == cause).unwrap_or_else(|| {
            let effect = Effect::new(cause, self);
            self.effects.push(effect);
            self.effects.len() - 1
        });
        &mut self.effects[place]
    }

    /// Takes `cause` out of the model; whether it was there.
    pub fn remove_effect(&mut self, cause: Cause) -> bool {
        let before = self.effects.len();
        self.effects.retain(|effect| effect.cause != cause);
        self.effects.len() < before
    }

    /// Whether the model carries `cause`.
    pub fn has(&self, cause: Cause) -> bool {
        self.effect(cause).is_some()
    }

    pub(crate) fn effect(&self, cause: Cause) -> Option<&Effect<T>> {
        self.effects.iter().find(|effect| effect.cause == cause)
    }

    pub(crate) fn map_effects<U: Scalar>(&self, f: impl Fn(T) -> U + Copy) -> Vec<Effect<U>> {
        self.effects.iter().map(|effect| effect.map(f)).collect()
    }

    /// The model with the causes that change its own numbers at work in them; `None` when it carries no such cause.
    pub(crate) fn altered(&self) -> Option<Self> {
        if self.effects.is_empty() {
            return None;
        }
        let mut model = self.clone();
        let mut changed = false;
        for effect in &self.effects {
            changed |= alter(effect, &mut model);
        }
        changed.then_some(model)
    }
}

impl Model<f64> {
    /// The model as plain MJCF holds it: its causes written into its numbers, where MJCF can. Also the causes that MJCF
    /// cannot hold, which are left out, and those that MuJoCo has in a slightly other form.
    pub fn folded(&self) -> Folded {
        let mut model = self.clone();
        model.effects.clear();
        let (mut lost, mut altered) = (Vec::new(), Vec::new());
        for effect in &self.effects {
            match effect.cause.info().mjcf {
                Some(mjcf) => {
                    (mjcf.fold)(effect, &mut model);
                    if !(mjcf.exact)(effect) {
                        altered.push(effect.cause);
                    }
                }
                None => lost.push(effect.cause),
            }
        }
        Folded { model, lost, altered }
    }
}

/// A model as plain MJCF holds it.
#[derive(Debug, Clone, PartialEq)]
pub struct Folded {
    /// The model, which carries no causes.
    pub model: Model<f64>,
    /// Causes that MJCF cannot hold: the model moves without them.
    pub lost: Vec<Cause>,
    /// Causes that MuJoCo has in a slightly other form.
    pub altered: Vec<Cause>,
}

#[cfg(test)]
mod tests;
