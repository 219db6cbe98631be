//! Actuators: those that are motor, position or velocity servo, however they are written.

use super::Reader;
use super::attributes::{Attributes, Values, own};
use super::element::Element;
use super::law::{LAW, Law};
use crate::model::{Actuator, ActuatorKind, Model};

/// What MuJoCo itself writes every actuator as. All actuators share their defaults, which stand under this name.
pub(super) const GENERAL: &str = "general";
/// The others, each short for some `<general>`; those that are read first.
const SHORTHANDS: [&str; 9] =
    ["motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion", "dcmotor"];

/// What actuators may act on in MuJoCo beside joints, by the attributes that name it.
const TRANSMISSIONS: [&str; 6] = ["site", "refsite", "body", "cranksite", "slidersite", "cranklength"];

/// Whether `tag` is that of an actuator.
pub(super) fn is_drive(tag: &str) -> bool {
    tag == GENERAL || SHORTHANDS.contains(&tag)
}

/// What the defaults of an actuator say to every other, whichever it is: all but its law.
pub(super) fn shared(element: &Element) -> Values<'_> {
    let mut values = own(element);
    values.retain(|name, _| LAW.iter().all(|(law, _)| law != name));
    values
}

impl<'a> Reader<'a> {
    /// Reads an actuator of the joints in `model`.
    pub(super) fn actuator(&self, element: &'a Element, model: &Model<f64>) -> Option<Actuator<f64>> {
        let tag = element.tag.as_str();
        let shorthand = match tag {
            GENERAL => None,
            "motor" => Some(ActuatorKind::Motor),
            "position" => Some(ActuatorKind::Position),
            "velocity" => Some(ActuatorKind::Velocity),
            _ => {
                element.refuse(self.refusals);
                return None;
            }
        };
        let attributes = self.attributes(element, None);
        let taken = model.actuators.iter().map(|other| &other.name);
        let (name, named) = attributes.name("actuator", model.actuators.len(), taken);
        let law = Law::of(&attributes, self.defaults.drives(element), self.refusals);
        let kinds = [ActuatorKind::Motor, ActuatorKind::Position, ActuatorKind::Velocity];
        let kind = shorthand.into_iter().chain(kinds).find(|kind| law.is(*kind));
        if let (Some(other), true) = (law.beyond, kind.is_some()) {
            attributes.inconsistent(&name, format_args!("has the law of <{other}> from its class"));
        }
        let Some(kind) = kind else {
            let [constant, slope, damping] = law.bias;
            let given = format!("has gain {} and bias {constant} {slope} {damping}", law.gain);
            let known = "a motor has bias 0 0 0, a position servo gain kp and bias 0 -kp -kv, a velocity servo gain kv and bias 0 0 -kv";
            attributes
                .inconsistent(&name, format_args!("{given}, which is none of the drives here; {known}"));
            return None;
        };
        if let Some(other) = TRANSMISSIONS.iter().find(|name| element.attribute(name).is_some()) {
            let problem =
                format_args!("acts on a {other}, which is not supported; drives turn hinges and move slides");
            attributes.inconsistent(&name, problem);
            return None;
        }
        let terms = self.coordinate(&attributes, model)?;
        let (&(joint, first), others) = terms.split_first()?;
        // only the first of up to six acts on a hinge or slide
        let mut gear = first * attributes.first_of::<6>("gear", [1.0; 6])[0];
        let limits = |range, limited| attributes.limited_range(range, limited, self.compiler.autolimits);
        let mut force_range = limits("forcerange", "forcelimited");
        if kind == ActuatorKind::Motor && law.gain != 1.0 {
            // a motor has no gain here: it is in the gear, which comes after the limits
            gear *= law.gain;
            force_range = force_range.filter(|_| law.gain != 0.0).map(|[low, high]| {
                let ends = [low / law.gain, high / law.gain];
                [ends[0].min(ends[1]), ends[0].max(ends[1])]
            });
        }
        let servo = kind != ActuatorKind::Motor;
        Some(Actuator {
            name,
            named,
            kind,
            joint,
            also: others.iter().map(|&(joint, coefficient)| (joint, coefficient / first)).collect(),
            kp: if kind == ActuatorKind::Position { law.gain } else { 0.0 },
            kv: if servo { -law.bias[2] } else { 0.0 },
            gear,
            command_range: limits("ctrlrange", "ctrllimited").filter(|_| self.options.clamp_commands),
            force_range,
            gearmotor: None,
        })
    }

    /// The joints that an actuator acts on, each with its coefficient: one, or those of a fixed tendon.
    fn coordinate(&self, attributes: &Attributes<'a>, model: &Model<f64>) -> Option<Vec<(usize, f64)>> {
        if attributes.text("tendon").is_some() {
            let known = model.tendons.iter().map(|tendon| &tendon.name);
            let tendon = attributes.named("tendon", "fixed tendon", known)?;
            let acting = |term: &&(usize, f64)| term.1 != 0.0;
            let terms: Vec<_> = model.tendons[tendon].terms.iter().filter(acting).copied().collect();
            if terms.is_empty() {
                attributes.invalid("tendon", "a tendon with a joint whose coefficient is not 0");
            }
            return Some(terms);
        }
        let which = attributes.text("jointinparent").map_or("joint", |_| "jointinparent");
        let joint = attributes.named(which, "joint", model.joints.iter().map(|joint| &joint.name))?;
        if !model.joints[joint].kind.is_axle() {
            attributes.invalid(which, "a hinge or a slide");
        }
        Some(vec![(joint, 1.0)])
    }
}
