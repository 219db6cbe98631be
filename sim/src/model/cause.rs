//! Causes as values: what a cause says about itself, and a cause in a model with its numbers. Which causes there are and
//! what they do stands in [`crate::causes`].

use std::any::Any;

use super::{Actuator, ActuatorKind, Joint, JointKind, Model};
use crate::scalar::Scalar;

/// The part of the system that a cause acts in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Acts in the water or in the bodies.
    Physics,
    /// Acts in the joints.
    Joint,
    /// Acts between the command and the drive.
    Drive,
    /// Acts through a cable.
    Tether,
    /// Acts in the camera or in the extraction of keypoints.
    Camera,
}

/// What part a parameter plays in its cause.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Role {
    /// How strong the cause is. At its neutral value the cause is absent and the motion's derivative by it is not 0: what
    /// a score test looks along.
    Size,
    /// 0 for absent, 1 for there; in between only to give a score test its direction.
    Switch,
    /// Shapes the cause and says nothing while the size is neutral: a search starts from each of these values.
    Hidden(&'static [f64]),
    /// One of these values, none in between.
    Choice(&'static [f64]),
    /// Is varied only where a fit names it.
    Detail,
}

/// What a parameter has one value for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Per {
    /// The whole model.
    Model,
    /// Each hinge and slide, after which it is called.
    Joint,
    /// Each body with mass, after which it is called.
    Body,
    /// Each geom with `fluidshape="ellipsoid"`, after which it is called.
    Geom,
    /// Each keypoint, after which it is called.
    Keypoint,
    /// Each hinge that a drive or a spring holds or an encoder reads, after which it is called.
    Held,
    /// Each drive that pushes as it is told and holds nothing, after which it is called.
    Motor,
    /// Each body that carries another one on a joint, after which it is called.
    Link,
}

/// One parameter of a cause, or one family of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterInfo {
    /// Its name after the cause's; empty where each element lends its own ([`Self::per`]).
    pub name: &'static str,
    /// Unit, `1` for none.
    pub unit: &'static str,
    /// Least and greatest value that physics allows; a size that is never below 0 has one sign only.
    pub bounds: [f64; 2],
    /// Its value in a model that the cause was just added to: absent, or a good start.
    pub neutral: f64,
    /// A typical value, SI: the scale of steps and weak priors.
    pub typical: f64,
    /// Its role in the cause.
    pub role: Role,
    /// What it has one value for.
    pub per: Per,
    /// Whether each run has its own value, as the phase of waves does.
    pub per_run: bool,
    /// Whether it may differ from run to run: bubbles gather and go, somebody touches the camera between runs.
    pub may_differ: bool,
    /// It has no effect where the choice of this name has this value.
    pub idle_where: Option<(&'static str, f64)>,
    /// Description for reports.
    pub meaning: &'static str,
}

impl ParameterInfo {
    /// A size, neutral at 0.
    pub(crate) const fn size(
        name: &'static str,
        unit: &'static str,
        bounds: [f64; 2],
        typical: f64,
        meaning: &'static str,
    ) -> Self {
        let (role, per) = (Role::Size, Per::Model);
        Self {
            name,
            unit,
            bounds,
            neutral: 0.0,
            typical,
            role,
            per,
            per_run: false,
            may_differ: false,
            idle_where: None,
            meaning,
        }
    }

    /// The same, called after each element of a kind.
    pub(crate) const fn each(mut self, per: Per) -> Self {
        self.per = per;
        self
    }

    /// The same, in another part and with another neutral value.
    pub(crate) const fn role(mut self, role: Role, neutral: f64) -> Self {
        self.role = role;
        self.neutral = neutral;
        self
    }

    /// The same, without a say where the choice called `name` has `value`.
    pub(crate) const fn idle_where(mut self, name: &'static str, value: f64) -> Self {
        self.idle_where = Some((name, value));
        self
    }

    /// The same, perhaps another in each run.
    pub(crate) const fn may_differ(mut self) -> Self {
        self.may_differ = true;
        self
    }

    /// The same, with a value of its own in each run.
    pub(crate) const fn each_run(mut self) -> Self {
        self.per_run = true;
        self
    }
}

/// How MJCF holds a cause, so that MuJoCo moves with it too.
#[derive(Debug, Clone, Copy)]
pub struct Mjcf {
    /// Which attribute holds it, for the report.
    pub how: &'static str,
    /// Whether MuJoCo then moves exactly the same way.
    pub exact: fn(&CauseValues<f64>) -> bool,
    /// Writes the parameters' values into the model, in the order of [`CauseValues::values`].
    pub(crate) fold: fn(&CauseValues<f64>, &mut Model<f64>),
}

/// Description of a cause: names, parameters and texts for the report.
#[derive(Debug, Clone, Copy)]
pub struct CauseInfo {
    /// Its name, part of the contract.
    pub name: &'static str,
    /// The part of the system it acts in.
    pub kind: Kind,
    /// Descriptions of its parameters, in their order.
    pub parameters: &'static [ParameterInfo],
    /// Causes that no video can distinguish from it, and when.
    pub aliases: &'static [Alias],
    /// A sentence for the report.
    pub sentence: &'static str,
    /// How to look for it at the tank, without a run, or by which run.
    pub check: &'static str,
    /// The term it adds.
    pub formula: &'static str,
    /// Where the term comes from, and its limits.
    pub source: &'static str,
    /// How MJCF holds it, if it can.
    pub mjcf: Option<Mjcf>,
    /// Whether its vectors lie in the picture's plane, x and z: a mechanism that moves in another plane then needs
    /// all of space.
    pub in_picture_plane: bool,
}

/// A cause that no video can distinguish from this one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Alias {
    /// Name of the other cause.
    pub name: &'static str,
    /// When the two cannot be distinguished.
    pub when: AliasWhen,
}

/// When two causes are the same to any video.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AliasWhen {
    /// Unless both weights, dry and wet, carry a prior.
    UnlessWeighed,
    /// Where no drop states its release and no encoder reads a hinge: what is let go at an unknown time shows no clock.
    NoReleaseStated,
}

/// One of the causes that a simulation may lack.
#[derive(Clone, Copy)]
pub struct Cause {
    info: &'static CauseInfo,
    /// The definition of a user-defined cause; none for those of [`Self::ALL`]. Only [`crate::causes::own`] knows its type.
    own: Option<&'static (dyn Any + Send + Sync)>,
}

impl Cause {
    pub(crate) const fn new(info: &'static CauseInfo) -> Self {
        Self { info, own: None }
    }

    pub(crate) const fn own(info: &'static CauseInfo, own: &'static (dyn Any + Send + Sync)) -> Self {
        Self { info, own: Some(own) }
    }

    /// Its description.
    pub fn info(self) -> &'static CauseInfo {
        self.info
    }

    /// Its name, as in files and parameter names.
    pub fn name(self) -> &'static str {
        self.info.name
    }

    /// Whether it is user-defined ([`crate::causes::own`]), not one of [`Self::ALL`].
    pub fn is_own(self) -> bool {
        self.own.is_some()
    }

    /// Its user-defined definition, if that is an `Own`.
    pub(crate) fn as_own<Own: Any>(self) -> Option<&'static Own> {
        self.own?.downcast_ref()
    }
}

impl PartialEq for Cause {
    fn eq(&self, other: &Self) -> bool {
        // two that were written down are one where everything written is the same
        let place = |cause: &Self| cause.own.map(|own| std::ptr::from_ref(own).cast::<()>());
        self.name() == other.name() && place(self) == place(other)
    }
}

impl Eq for Cause {}

impl std::fmt::Debug for Cause {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.own {
            // with its name and place its expressions say all that it does
            Some(_) => write!(f, "{} ({})", self.name(), self.info.formula),
            None => f.write_str(self.name()),
        }
    }
}

/// A cause in a model, with its numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct CauseValues<T = f64> {
    cause: Cause,
    names: Vec<String>,
    /// For each value, its place in the cause's [`CauseInfo::parameters`].
    of: Vec<usize>,
    values: Vec<T>,
}

impl<T: Scalar> CauseValues<T> {
    /// `cause` in `model`, every parameter neutral.
    pub(crate) fn neutral(cause: Cause, model: &Model<T>) -> Self {
        let mut carried = Self { cause, names: Vec::new(), of: Vec::new(), values: Vec::new() };
        for (place, parameter) in cause.info().parameters.iter().enumerate() {
            let elements: Vec<String> = match parameter.per {
                Per::Model => vec![parameter.name.into()],
                Per::Joint => model.axles().map(|(_, joint)| joint.name.clone()).collect(),
                Per::Body => model.bodies_with_mass().map(|body| model.bodies[body].name.clone()).collect(),
                Per::Geom => {
                    let wet = model.geoms.iter().filter(|geom| geom.fluid.is_some());
                    wet.map(|geom| geom.name.clone()).collect()
                }
                Per::Keypoint => model.keypoints(),
                Per::Held => model.held_hinges().map(|(_, joint)| joint.name.clone()).collect(),
                Per::Motor => model.motors().map(|(_, motor)| motor.name.clone()).collect(),
                Per::Link => model.carriers().map(|body| model.bodies[body].name.clone()).collect(),
            };
            for element in elements {
                carried.names.push(format!("{}/{element}", cause.info().name));
                carried.of.push(place);
                carried.values.push(T::from_f64(parameter.neutral));
            }
        }
        carried
    }

    /// Which cause it is.
    pub fn cause(&self) -> Cause {
        self.cause
    }

    /// Names of its parameters, `<cause>/<parameter>`, in the order of [`Self::values`].
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Descriptions of its parameters, in the order of [`Self::values`].
    pub fn parameters(&self) -> impl Iterator<Item = &'static ParameterInfo> + '_ {
        self.of.iter().map(|&place| &self.cause.info().parameters[place])
    }

    /// Values of its parameters, in the order of [`Self::parameters`].
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

    pub(crate) fn map<U: Scalar>(&self, f: impl Fn(T) -> U) -> CauseValues<U> {
        CauseValues {
            cause: self.cause,
            names: self.names.clone(),
            of: self.of.clone(),
            values: self.values.iter().map(|&value| f(value)).collect(),
        }
    }
}

impl<T: Scalar> Model<T> {
    /// The causes that the model carries, in the order they were added.
    pub fn causes(&self) -> &[CauseValues<T>] {
        &self.causes
    }

    /// The model's `cause`, added with neutral values if it was not there.
    pub(crate) fn carry(&mut self, cause: Cause) -> &mut CauseValues<T> {
        let place = self.causes.iter().position(|carried| carried.cause == cause).unwrap_or_else(|| {
            let carried = CauseValues::neutral(cause, self);
            self.causes.push(carried);
            self.causes.len() - 1
        });
        &mut self.causes[place]
    }

    /// Takes `cause` out of the model; whether it was there.
    pub fn remove_cause(&mut self, cause: Cause) -> bool {
        let before = self.causes.len();
        self.causes.retain(|carried| carried.cause != cause);
        self.causes.len() < before
    }

    /// Whether the model carries `cause`.
    pub fn has(&self, cause: Cause) -> bool {
        self.carried(cause).is_some()
    }

    /// Its values, if the model carries `cause`.
    pub(crate) fn carried(&self, cause: Cause) -> Option<&CauseValues<T>> {
        self.causes.iter().find(|carried| carried.cause == cause)
    }

    /// The joints with one axis, hinges and slides, each with its place in `joints`.
    pub(crate) fn axles(&self) -> impl Iterator<Item = (usize, &Joint<T>)> {
        self.joints.iter().enumerate().filter(|(_, joint)| joint.kind.is_axle())
    }

    /// The hinges that a drive or a spring holds or an encoder reads, each with its place in `joints`.
    pub(crate) fn held_hinges(&self) -> impl Iterator<Item = (usize, &Joint<T>)> {
        let is_held = |(place, joint): &(usize, &Joint<T>)| {
            let sprung = joint.stiffness.iter().any(|power| *power != T::ZERO);
            let driven = self.actuators.iter().any(|actuator| actuator.drives(*place));
            let read = self.encoders.iter().any(|encoder| encoder.joint == *place);
            joint.kind == JointKind::Hinge && (sprung || driven || read)
        };
        self.joints.iter().enumerate().filter(is_held)
    }

    /// The drives that push as they are told and hold nothing, with their places.
    pub(crate) fn motors(&self) -> impl Iterator<Item = (usize, &Actuator<T>)> {
        self.actuators.iter().enumerate().filter(|(_, actuator)| actuator.kind == ActuatorKind::Motor)
    }

    /// The bodies that carry another one on a joint, and move themselves.
    pub(crate) fn carriers(&self) -> impl Iterator<Item = usize> + '_ {
        let moves = |body: usize| self.joints.iter().any(|joint| joint.body == body);
        (1..self.bodies.len()).filter(move |&body| moves(body) && !self.carried_by(body).is_empty())
    }

    /// The bodies that `body` carries on joints.
    pub(crate) fn carried_by(&self, body: usize) -> Vec<usize> {
        let moves = |body: usize| self.joints.iter().any(|joint| joint.body == body);
        (1..self.bodies.len()).filter(|&next| self.bodies[next].parent == body && moves(next)).collect()
    }

    /// The bodies with mass.
    pub(crate) fn bodies_with_mass(&self) -> impl Iterator<Item = usize> + '_ {
        (1..self.bodies.len()).filter(|&body| self.bodies[body].mass != T::ZERO)
    }
}
