//! The model's numbers by name: what a fit turns.

use super::{ActuatorKind, JointKind, Model};
use crate::scalar::Scalar;

/// A place in a model, found once by name and then read and written quickly.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Parameter {
    /// `<geom>/blunt`, `slender`, `angular`, `kutta`, `magnus`: (geom, which of the five).
    Fluid(usize, usize),
    /// `<joint>/damping` \[N m s/rad\]: the linear term.
    Damping(usize),
    /// `<joint>/frictionloss` \[N m\].
    FrictionLoss(usize),
    /// `<joint>/armature`: inertia about the axis, of a gear's motor \[kg m2\].
    Armature(usize),
    /// `<joint>/stiffness`, `stiffness2`, `stiffness3`: (joint, which power - 1) \[N m/rad, ...\].
    Stiffness(usize, usize),
    /// `<body>/mass` \[kg\]; the body's inertia scales with it.
    Mass(usize),
    /// `<actuator>/gain`: a position drive's kp, a velocity drive's kv, a motor's gear.
    Gain(usize),
    /// `<cause>/<parameter>`: (which of the model's causes, which of its values).
    Cause(usize, usize),
}

/// No such parameter in the model.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("model `{model}` has no parameter `{name}`; it has {known}")]
pub struct UnknownParameter {
    /// The model.
    pub model: String,
    /// The name looked for.
    pub name: String,
    /// The names it has, listed.
    pub known: String,
}

const FLUID: [&str; 5] = ["blunt", "slender", "angular", "kutta", "magnus"];
const STIFFNESS: [&str; 3] = ["stiffness", "stiffness2", "stiffness3"];

impl<T: Scalar> Model<T> {
    /// Every parameter's name, geoms first, then joints, bodies, actuators, causes.
    pub fn parameter_names(&self) -> Vec<String> {
        self.parameters().map(|(name, _)| name).collect()
    }

    /// Finds the parameter called `name`.
    ///
    /// # Errors
    /// [`UnknownParameter`].
    pub fn find_parameter(&self, name: &str) -> Result<Parameter, UnknownParameter> {
        self.parameters().find(|(known, _)| known == name).map(|(_, parameter)| parameter).ok_or_else(|| {
            UnknownParameter {
                model: self.name.clone(),
                name: name.into(),
                known: self.parameter_names().join(", "),
            }
        })
    }

    /// The value of the parameter called `name`.
    ///
    /// # Errors
    /// [`UnknownParameter`].
    pub fn parameter(&self, name: &str) -> Result<T, UnknownParameter> {
        Ok(self.get(self.find_parameter(name)?))
    }

    /// Sets the parameter called `name`.
    ///
    /// # Errors
    /// [`UnknownParameter`].
    pub fn set_parameter(&mut self, name: &str, value: T) -> Result<(), UnknownParameter> {
        self.set(self.find_parameter(name)?, value);
        Ok(())
    }

    /// The value of `parameter`.
    ///
    /// # Panics
    /// When `parameter` was found in a model of another shape.
    pub fn get(&self, parameter: Parameter) -> T {
        match parameter {
            Parameter::Fluid(geom, which) => match &self.geoms[geom].fluid {
                Some(c) => [c.blunt, c.slender, c.angular, c.kutta, c.magnus][which],
                None => panic!("geom `{}` has no fluid coefficients", self.geoms[geom].name),
            },
            Parameter::Damping(joint) => self.joints[joint].damping[0],
            Parameter::FrictionLoss(joint) => self.joints[joint].friction_loss,
            Parameter::Armature(joint) => self.joints[joint].armature,
            Parameter::Stiffness(joint, power) => self.joints[joint].stiffness[power],
            Parameter::Mass(body) => self.bodies[body].mass,
            Parameter::Gain(actuator) => {
                let actuator = &self.actuators[actuator];
                match actuator.kind {
                    ActuatorKind::Position => actuator.kp,
                    ActuatorKind::Velocity => actuator.kv,
                    ActuatorKind::Motor => actuator.gear,
                }
            }
            Parameter::Cause(cause, value) => self.causes[cause].values()[value],
        }
    }

    /// Sets `parameter`. A new mass scales the body's inertia with it.
    ///
    /// # Panics
    /// When `parameter` was found in a model of another shape.
    pub fn set(&mut self, parameter: Parameter, value: T) {
        let place = match parameter {
            Parameter::Fluid(geom, which) => match &mut self.geoms[geom].fluid {
                Some(c) => match which {
                    0 => &mut c.blunt,
                    1 => &mut c.slender,
                    2 => &mut c.angular,
                    3 => &mut c.kutta,
                    _ => &mut c.magnus,
                },
                None => panic!("geom `{}` has no fluid coefficients", self.geoms[geom].name),
            },
            Parameter::Damping(joint) => &mut self.joints[joint].damping[0],
            Parameter::FrictionLoss(joint) => &mut self.joints[joint].friction_loss,
            Parameter::Armature(joint) => &mut self.joints[joint].armature,
            Parameter::Stiffness(joint, power) => &mut self.joints[joint].stiffness[power],
            Parameter::Mass(body) => {
                let body = &mut self.bodies[body];
                body.inertia = body.inertia * (value / body.mass);
                &mut body.mass
            }
            Parameter::Gain(actuator) => {
                let actuator = &mut self.actuators[actuator];
                match actuator.kind {
                    ActuatorKind::Position => &mut actuator.kp,
                    ActuatorKind::Velocity => &mut actuator.kv,
                    ActuatorKind::Motor => &mut actuator.gear,
                }
            }
            Parameter::Cause(cause, value) => self.causes[cause].value_mut(value),
        };
        *place = value;
    }

    /// The unit of `parameter`, `1` for none: of what turns, N m and rad; of what slides, N and m.
    ///
    /// # Panics
    /// When `parameter` was found in a model of another shape.
    pub fn unit(&self, parameter: Parameter) -> &'static str {
        let slides = |joint: usize| self.joints[joint].kind == JointKind::Slide;
        let stiffness = |joint, power| match (slides(joint), power) {
            (false, 0) => "N m/rad",
            (false, 1) => "N m/rad^2",
            (false, _) => "N m/rad^3",
            (true, 0) => "N/m",
            (true, 1) => "N/m^2",
            (true, _) => "N/m^3",
        };
        let damping = |joint| if slides(joint) { "N s/m" } else { "N m s/rad" };
        match parameter {
            Parameter::Fluid(..) => "1",
            Parameter::Damping(joint) => damping(joint),
            Parameter::Armature(joint) if slides(joint) => "kg",
            Parameter::Armature(_) => "kg m2",
            Parameter::FrictionLoss(joint) if slides(joint) => "N",
            Parameter::FrictionLoss(_) => "N m",
            Parameter::Stiffness(joint, power) => stiffness(joint, power),
            Parameter::Mass(_) => "kg",
            Parameter::Gain(actuator) => {
                let actuator = &self.actuators[actuator];
                match actuator.kind {
                    ActuatorKind::Position => stiffness(actuator.joint, 0),
                    ActuatorKind::Velocity => damping(actuator.joint),
                    ActuatorKind::Motor => "1",
                }
            }
            Parameter::Cause(cause, value) => {
                self.causes[cause].parameters().nth(value).map_or("1", |info| info.unit)
            }
        }
    }

    /// Every parameter with its name.
    pub(crate) fn parameters(&self) -> impl Iterator<Item = (String, Parameter)> + '_ {
        let fluid =
            self.geoms.iter().enumerate().filter(|(_, geom)| geom.fluid.is_some()).flat_map(|(i, geom)| {
                FLUID
                    .iter()
                    .enumerate()
                    .map(move |(k, of)| (format!("{}/{of}", geom.name), Parameter::Fluid(i, k)))
            });
        let joints = self.joints.iter().enumerate().flat_map(|(i, joint)| {
            let powers = if joint.kind.is_axle() { 3 } else { 1 };
            let ones = [
                ("damping", Parameter::Damping(i)),
                ("frictionloss", Parameter::FrictionLoss(i)),
                ("armature", Parameter::Armature(i)),
            ];
            ones.into_iter()
                .chain((0..powers).map(move |k| (STIFFNESS[k], Parameter::Stiffness(i, k))))
                .map(|(of, parameter)| (format!("{}/{of}", joint.name), parameter))
        });
        let masses = self
            .bodies
            .iter()
            .enumerate()
            .filter(|(_, body)| body.mass != T::ZERO)
            .map(|(i, body)| (format!("{}/mass", body.name), Parameter::Mass(i)));
        let gains = self
            .actuators
            .iter()
            .enumerate()
            .map(|(i, actuator)| (format!("{}/gain", actuator.name), Parameter::Gain(i)));
        let causes = self.causes.iter().enumerate().flat_map(|(i, cause)| {
            let names = cause.names().iter().enumerate();
            names.map(move |(k, name)| (name.clone(), Parameter::Cause(i, k)))
        });
        fluid.chain(joints).chain(masses).chain(gains).chain(causes)
    }
}
