//! User-defined causes: terms that are written as expressions, without compiling anything.
//!
//! [`Model::define_cause`] takes its definition. From then on the model knows a cause of that name as it knows those of
//! [`Cause::ALL`]: [`Model::add_cause`] adds it, its parameters are called `<cause>/<parameter>`, and its derivatives are exact.
//!
//! ```
//! # let text = r#"<mujoco><worldbody><body><joint name="q2" axis="0 -1 0"/>
//! #   <geom type="sphere" size="0.01" pos="0 0 -0.1"/></body></worldbody></mujoco>"#;
//! use sim::causes::own::{Acts, OwnCause, OwnParameter, Place};
//! let mut model = sim::Model::from_mjcf(text)?;
//! model.define_cause(&OwnCause {
//!     name: "detent".into(),
//!     sentence: None,
//!     place: Place::Joint("q2".into()),
//!     terms: vec![(Acts::Torque, "-size * sin(8 * q)".into())],
//!     parameters: vec![OwnParameter::size("size", "N m", [0.0, 1e-2], 1e-5)],
//! })?;
//! model.add_cause("detent")?;
//! model.set_parameter("detent/size", 2e-5)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! `parse` makes a program of an expression, `program` works it out in any kind of number, `check` sees that the cause is absent
//! where its sizes are 0 and has sound numbers everywhere else, `act` puts it into a step and into the picture.

mod act;
mod check;
mod parse;
mod program;

pub(crate) use act::{Acting, Shifts};

use std::sync::Mutex;

use crate::model::Model;
use crate::model::cause::{Cause, CauseInfo, Kind, ParameterInfo, Per, Role};
use crate::scalar::Scalar;
use parse::{Scope, reserved};
use program::{Program, Variable};

/// Definition of a user-defined cause.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnCause {
    /// Its name: letters, digits and `_`, none of a known cause or of an element of the model.
    pub name: String,
    /// A sentence for the report; left out, one that says where it acts.
    pub sentence: Option<String>,
    /// The joint, body or keypoint it acts on.
    pub place: Place,
    /// What it exerts, each with its expression; one at least, none twice.
    pub terms: Vec<(Acts, String)>,
    /// Its parameters; one at least is a size.
    pub parameters: Vec<OwnParameter>,
}

/// Where a user-defined cause acts.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// On the hinge or slide of this name. Expressions know `q` \[rad\] or \[m\], its rate `v`, and, where an actuator drives the
    /// joint, its `command`.
    Joint(String),
    /// On a point of a body. Expressions know where the point is, `x`, `y`, `z` \[m\], and how it moves, `vx`, `vy`, `vz` \[m/s\], in
    /// world axes; the `angle` of the body's x axis in the picture, counter-clockwise from x, between -pi and pi, and its `rate`
    /// \[rad/s\].
    Body {
        /// The body's name.
        body: String,
        /// The point in the body's axes \[m\].
        point_m: [f64; 3],
    },
    /// On what the camera takes for this keypoint. Expressions know where it is: `x`, `y`, `z` \[m\].
    Keypoint(String),
}

/// What a user-defined cause exerts. Everywhere expressions know `t`, the time since the run's start \[s\], and `pi`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acts {
    /// On a joint \[N m\]; \[N\] on a slide.
    Torque,
    /// On a body, along the world's x, y or z (0, 1, 2) \[N\].
    Force(usize),
    /// Of a keypoint, along the world's x, y or z (0, 1, 2) \[m\].
    Shift(usize),
}

impl Acts {
    /// All kinds.
    pub const ALL: [Self; 7] = [
        Self::Torque,
        Self::Force(0),
        Self::Force(1),
        Self::Force(2),
        Self::Shift(0),
        Self::Shift(1),
        Self::Shift(2),
    ];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Torque => "torque",
            Self::Force(0) => "force_x",
            Self::Force(1) => "force_y",
            Self::Force(_) => "force_z",
            Self::Shift(0) => "shift_x",
            Self::Shift(1) => "shift_y",
            Self::Shift(_) => "shift_z",
        }
    }
}

/// A parameter of a user-defined cause.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnParameter {
    /// Its name in expressions.
    pub name: String,
    /// Unit, `1` for none.
    pub unit: String,
    /// Least and greatest value.
    pub bounds: [f64; 2],
    /// A typical value, SI; searches start on its scale.
    pub typical: f64,
    /// Empty for a size: 0 where the cause is absent. Otherwise it says nothing while all sizes are 0, and a search starts from each of
    /// these values.
    pub hidden: Vec<f64>,
    /// Description for the report.
    pub meaning: Option<String>,
}

impl OwnParameter {
    /// A parameter that is 0 where the cause is absent.
    pub fn size(name: &str, unit: &str, bounds: [f64; 2], typical: f64) -> Self {
        let (name, unit) = (name.to_owned(), unit.to_owned());
        Self { name, unit, bounds, typical, hidden: Vec::new(), meaning: None }
    }

    fn is_size(&self) -> bool {
        self.hidden.is_empty()
    }
}

/// Why a user-defined cause was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("cause `{cause}`: {reason}{}", known(unknown.as_ref()))]
pub struct OwnCauseError {
    /// Name of the cause.
    pub cause: String,
    /// The text that it is about, as it was given: an expression, or a name.
    pub text: String,
    /// Of that text, the characters before what is meant, and how many are meant.
    pub meant: (usize, usize),
    /// What is wrong, and what to do.
    pub reason: String,
    /// A name that is not known, and those that are.
    pub unknown: Option<(String, Vec<String>)>,
}

fn known(unknown: Option<&(String, Vec<String>)>) -> String {
    unknown.map_or(String::new(), |(_, known)| format!("; known here: {}", known.join(", ")))
}

/// A user-defined cause that has been checked.
#[derive(Debug)]
pub(crate) struct Own {
    definition: OwnCause,
    info: CauseInfo,
    programs: Vec<(Acts, Program)>,
}

/// All user-defined causes of the process: one for each that a config states; they are never freed.
static DEFINED: Mutex<Vec<&'static Own>> = Mutex::new(Vec::new());

impl<T: Scalar> Model<T> {
    /// The user-defined causes that the model knows, whether it carries them or not.
    pub fn own_causes(&self) -> &[Cause] {
        &self.own
    }

    /// All causes that the model may carry: those of [`Cause::ALL`], then the user-defined ones.
    pub fn known_causes(&self) -> impl Iterator<Item = Cause> + '_ {
        Cause::ALL.iter().chain(&self.own).copied()
    }
}

impl Model<f64> {
    /// Makes a user-defined cause known to the model. A model whose MJCF holds numbers called `<cause>/<parameter>` carries the cause
    /// from then on, with these.
    ///
    /// # Errors
    /// [`OwnCauseError`]: a name that is taken or unknown, an expression that is not understood, or one that does not vanish where the
    /// sizes are 0, does not change with them there, or is no finite number somewhere.
    pub fn define_cause(&mut self, definition: &OwnCause) -> Result<Cause, OwnCauseError> {
        let own = self.own_cause(definition)?;
        let cause = Cause::own(&own.info, own);
        self.own.push(cause);
        for (name, value) in self.foreign.clone() {
            let parameter = name.split_once('/').filter(|(of, _)| *of == definition.name);
            let Some((_, parameter)) = parameter else { continue };
            let carried = self.carry(cause);
            let place = carried.names().iter().position(|known| *known == name);
            let place = place.ok_or_else(|| {
                let known = definition.parameters.iter().map(|parameter| parameter.name.clone()).collect();
                let reason = format!("the model's file has a number `{name}`, which the cause lacks");
                OwnCauseError {
                    unknown: Some((parameter.to_owned(), known)),
                    ..definition.refused(&definition.name, reason)
                }
            })?;
            *carried.value_mut(place) = value;
        }
        Ok(cause)
    }

    fn own_cause(&self, definition: &OwnCause) -> Result<&'static Own, OwnCauseError> {
        self.check_name(definition)?;
        let variables = self.variables(definition)?;
        definition.check_parameters(&variables)?;
        let programs = self.programs(definition, &variables)?;
        check::check(definition, &programs)?;
        // a list of pointers stays whole whatever a thread does that holds it
        let mut defined = DEFINED.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(&known) = defined.iter().find(|known| known.definition == *definition) {
            return Ok(known);
        }
        let info = definition.info();
        let own: &'static Own = Box::leak(Box::new(Own { definition: definition.clone(), info, programs }));
        defined.push(own);
        Ok(own)
    }

    fn check_name(&self, definition: &OwnCause) -> Result<(), OwnCauseError> {
        let name = &definition.name;
        let refuse = |reason: String| Err(definition.refused(name, reason));
        if !is_name(name) {
            return refuse("its name must be letters, digits and `_`, a letter first".into());
        }
        if Cause::ALL.iter().any(|cause| cause.name() == name) {
            return refuse("a known cause is called that: choose another name".into());
        }
        if self.own.iter().any(|cause| cause.name() == name) {
            return refuse("there are two of that name: rename one".into());
        }
        let elements = self
            .bodies
            .iter()
            .map(|body| &body.name)
            .chain(self.joints.iter().map(|joint| &joint.name))
            .chain(self.geoms.iter().map(|geom| &geom.name))
            .chain(self.actuators.iter().map(|actuator| &actuator.name));
        if elements.into_iter().any(|element| element == name) {
            return refuse("an element of the model is called that: choose another name".into());
        }
        Ok(())
    }

    /// What expressions may speak of where `definition` acts.
    fn variables(&self, definition: &OwnCause) -> Result<Vec<Variable>, OwnCauseError> {
        use Variable::{Angle, Command, Q, Rate, T, V, Vx, Vy, Vz, X, Y, Z};
        let missing = |what: &str, name: &str, known: Vec<String>| OwnCauseError {
            unknown: Some((name.to_owned(), known)),
            ..definition.refused(name, format!("the model has no {what} `{name}`"))
        };
        match &definition.place {
            Place::Joint(name) => {
                let known = || self.axles().map(|(_, joint)| joint.name.clone()).collect();
                if let Some(joint) = self.joints.iter().find(|joint| joint.name == *name)
                    && !joint.kind.is_axle()
                {
                    let reason = format!("`{name}` is a ball or free joint; a torque needs a hinge or slide");
                    return Err(definition.refused(name, reason));
                }
                let (place, _) = self
                    .axles()
                    .find(|(_, joint)| joint.name == *name)
                    .ok_or_else(|| missing("hinge or slide", name, known()))?;
                let driven = self.actuators.iter().any(|actuator| actuator.drives(place));
                Ok([Q, V, T].into_iter().chain(driven.then_some(Command)).collect())
            }
            Place::Body { body: name, point_m } => {
                let known = || self.bodies.iter().skip(1).map(|body| body.name.clone()).collect();
                if !self.bodies.iter().skip(1).any(|body| body.name == *name) {
                    return Err(missing("body", name, known()));
                }
                if !point_m.iter().all(|x| x.is_finite()) {
                    return Err(definition.refused(name, "`point` must be three finite numbers".into()));
                }
                Ok(vec![X, Y, Z, Angle, Vx, Vy, Vz, Rate, T])
            }
            Place::Keypoint(name) => {
                if !self.keypoints().contains(name) {
                    return Err(missing("keypoint", name, self.keypoints()));
                }
                Ok(vec![X, Y, Z, T])
            }
        }
    }

    fn programs(
        &self,
        definition: &OwnCause,
        variables: &[Variable],
    ) -> Result<Vec<(Acts, Program)>, OwnCauseError> {
        let names: Vec<String> =
            definition.parameters.iter().map(|parameter| parameter.name.clone()).collect();
        let here: Vec<&str> = variables.iter().map(|variable| variable.name()).collect();
        let (at, here) = (definition.site(), here.join(", "));
        let lacking = |variable: Variable| match (variable, &definition.place) {
            (Variable::Command, Place::Joint(joint)) => {
                format!("no actuator drives the joint `{joint}`, so it has no `command`; known here: {here}")
            }
            (Variable::Vx | Variable::Vy | Variable::Vz, Place::Keypoint(_)) => {
                format!("a picture shows where a keypoint is, not how fast; known here: {here}")
            }
            _ => format!("`{}` is not known at {at}; known here: {here}", variable.name()),
        };
        let scope = Scope { variables, lacking: &lacking, parameters: &names };
        let mut programs: Vec<(Acts, Program)> = Vec::new();
        for (acts, text) in &definition.terms {
            let fits = match acts {
                Acts::Torque => matches!(definition.place, Place::Joint(_)),
                Acts::Force(axis) => *axis < 3 && matches!(definition.place, Place::Body { .. }),
                Acts::Shift(axis) => *axis < 3 && matches!(definition.place, Place::Keypoint(_)),
            };
            let name = acts.name();
            if !fits {
                let wanted = match definition.place {
                    Place::Joint(_) => "`torque`",
                    Place::Body { .. } => "`force_x`, `force_y` or `force_z`",
                    Place::Keypoint(_) => "`shift_x`, `shift_y` or `shift_z`",
                };
                let reason = format!("`{name}` does not go with {at}: that takes {wanted}");
                return Err(definition.refused(name, reason));
            }
            if programs.iter().any(|(other, _)| other == acts) {
                return Err(definition.refused(name, format!("`{name}` stands there twice")));
            }
            let program = parse::parse(text, &scope).map_err(|stumble| OwnCauseError {
                cause: definition.name.clone(),
                text: text.clone(),
                meant: (stumble.at, stumble.width),
                reason: format!("`{name}`: {}", stumble.reason),
                unknown: stumble.unknown,
            })?;
            programs.push((*acts, program));
        }
        if programs.is_empty() {
            let wanted = match definition.place {
                Place::Joint(_) => "`torque = \"...\"`",
                Place::Body { .. } => "`force_x = \"...\"` or `force_z = \"...\"`",
                Place::Keypoint(_) => "`shift_x = \"...\"` or `shift_z = \"...\"`",
            };
            let reason = format!("nothing says what it does at {at}: add {wanted}");
            return Err(definition.refused(&definition.name, reason));
        }
        Ok(programs)
    }
}

fn is_name(name: &str) -> bool {
    name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

impl OwnCause {
    /// A refusal that is about `text`, which the definition holds.
    fn refused(&self, text: &str, reason: String) -> OwnCauseError {
        let width = text.chars().count();
        let (cause, text) = (self.name.clone(), text.to_owned());
        OwnCauseError { cause, text, meant: (0, width), reason, unknown: None }
    }

    /// Where it acts, in words.
    fn site(&self) -> String {
        match &self.place {
            Place::Joint(joint) => format!("joint `{joint}`"),
            Place::Body { body, .. } => format!("body `{body}`"),
            Place::Keypoint(keypoint) => format!("keypoint `{keypoint}`"),
        }
    }

    fn check_parameters(&self, variables: &[Variable]) -> Result<(), OwnCauseError> {
        if !self.parameters.iter().any(OwnParameter::is_size) {
            let reason = "it needs a size, a parameter without `hidden`: 0 where the cause is absent";
            return Err(self.refused(&self.name, reason.into()));
        }
        for (place, parameter) in self.parameters.iter().enumerate() {
            let name = &parameter.name;
            let refuse = |reason: String| Err(self.refused(name, format!("parameter `{name}`: {reason}")));
            if !is_name(name) {
                return refuse("its name must be letters, digits and `_`, a letter first".into());
            }
            if reserved().any(|known| known == name) {
                return refuse("a function or number is called that: choose another name".into());
            }
            if variables.iter().any(|variable| variable.name() == name) {
                return refuse(format!("`{name}` stands for what {} does: choose another name", self.site()));
            }
            if self.parameters[..place].iter().any(|other| other.name == *name) {
                return refuse("there are two of that name".into());
            }
            let [lower, upper] = parameter.bounds;
            if !(lower.is_finite() && upper.is_finite() && lower < upper) {
                return refuse(format!("its bounds {lower} and {upper} must be finite and rise"));
            }
            let within = |x: f64| (lower..=upper).contains(&x);
            if parameter.is_size() && !within(0.0) {
                return refuse(format!(
                    "0, where the cause is absent, must lie within the bounds {lower} and {upper} of a size"
                ));
            }
            let most = lower.abs().max(upper.abs());
            if !(parameter.typical > 0.0 && parameter.typical <= most) {
                let typical = parameter.typical;
                return refuse(format!("`typical` is {typical}; it must be above 0 and at most {most}"));
            }
            if let Some(start) = parameter.hidden.iter().find(|start| !within(**start)) {
                return refuse(format!(
                    "its start {start} under `hidden` lies outside its bounds {lower} and {upper}"
                ));
            }
        }
        Ok(())
    }

    /// What the cause says about itself, for as long as the program runs.
    fn info(&self) -> CauseInfo {
        let keep = |text: String| -> &'static str { Box::leak(text.into_boxed_str()) };
        let parameters: Vec<ParameterInfo> = self
            .parameters
            .iter()
            .map(|parameter| {
                let starts: &'static [f64] = Box::leak(parameter.hidden.clone().into_boxed_slice());
                let (role, neutral) = match starts.first() {
                    Some(&first) => (Role::Hidden(starts), first),
                    None => (Role::Size, 0.0),
                };
                ParameterInfo {
                    name: keep(parameter.name.clone()),
                    unit: keep(parameter.unit.clone()),
                    bounds: parameter.bounds,
                    neutral,
                    typical: parameter.typical,
                    role,
                    per: Per::Model,
                    per_run: false,
                    may_differ: false,
                    idle_where: None,
                    meaning: keep(parameter.meaning.clone().unwrap_or_default()),
                }
            })
            .collect();
        let at = self.site();
        let kind = match self.place {
            Place::Joint(_) => Kind::Joint,
            Place::Body { .. } => Kind::Physics,
            Place::Keypoint(_) => Kind::Camera,
        };
        let sentence = || format!("a cause of this experiment's own, `{}`, acts at {at}", self.name);
        let formula = self.terms.iter().map(|(acts, text)| format!("{} = {text}", acts.name()));
        let at_point = match &self.place {
            Place::Body { point_m: [x, y, z], .. } => format!(", point ({x}, {y}, {z}) m"),
            _ => String::new(),
        };
        CauseInfo {
            name: keep(self.name.clone()),
            kind,
            parameters: Box::leak(parameters.into_boxed_slice()),
            aliases: &[],
            sentence: keep(self.sentence.clone().unwrap_or_else(sentence)),
            check: keep(format!("measure it where it acts, at {at}")),
            formula: keep(format!("{} at {at}{at_point}", formula.collect::<Vec<_>>().join(", "))),
            source: "written down with the experiment",
            mjcf: None,
            // its axes are the world's, which whoever wrote it knows
            in_picture_plane: false,
        }
    }
}

#[cfg(test)]
mod tests;
