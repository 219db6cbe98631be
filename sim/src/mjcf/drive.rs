//! Actuators: those that are motor, position or velocity servo, however they are written.

use std::collections::BTreeMap;

use super::Reader;
use super::attributes::{Attributes, Values, own, same};
use super::element::{Attribute, Element};
use crate::model::{Actuator, ActuatorKind, Model};

/// What MuJoCo itself writes every actuator as. All actuators share their defaults, which stand under this name.
pub(super) const GENERAL: &str = "general";
/// The others, each short for some `<general>`; those that are read first.
const SHORTHANDS: [&str; 9] =
    ["motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion", "dcmotor"];

/// What says by which law an actuator pushes, and with which values that is a law known here.
const LAW: [(&str, &[&str]); 10] = [
    ("gainprm", &[]),
    ("biasprm", &[]),
    ("kp", &[]),
    ("kv", &[]),
    ("gaintype", &["fixed"]),
    ("dyntype", &["none"]),
    ("biastype", &["none", "affine"]),
    ("dampratio", &["0"]),
    ("timeconst", &["0"]),
    ("inheritrange", &["0"]),
];

/// Most parameters of a gain or bias in MuJoCo.
const PARAMETERS_MAX: usize = 10;

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

/// The force of the command u, the joint's coordinate q and its rate v: gain u + bias\[0\] + bias\[1\] q + bias\[2\] v.
struct Law<'a> {
    gain: f64,
    bias: [f64; 3],
    affine: bool,
    /// Attributes that make it another law than this.
    odd: BTreeMap<&'a str, &'a Attribute>,
    /// The shorthand that makes it another.
    beyond: Option<&'a str>,
}

impl<'a> Law<'a> {
    fn motor() -> Self {
        Self { gain: 1.0, bias: [0.0; 3], affine: false, odd: BTreeMap::new(), beyond: None }
    }

    /// What `attributes`, of an actuator or of one among its defaults, make of the law so far.
    fn take(&mut self, attributes: &Attributes<'a>) {
        let tag = attributes.element.tag.as_str();
        match tag {
            GENERAL => {
                let before = |first: &[f64]| std::array::from_fn(|i| first.get(i).copied().unwrap_or(0.0));
                self.gain = attributes.first_of::<PARAMETERS_MAX>("gainprm", before(&[self.gain]))[0];
                let [constant, slope, damping, ..] =
                    attributes.first_of::<PARAMETERS_MAX>("biasprm", before(&self.bias));
                self.bias = [constant, slope, damping];
                if let Some(bias) = attributes.text("biastype") {
                    self.affine = bias == "affine";
                }
            }
            "position" => {
                let kp = attributes.not_negative("kp", self.gain);
                let kv = attributes.not_negative("kv", -self.bias[2]);
                (self.gain, self.bias, self.affine) = (kp, [0.0, -kp, -kv], true);
                self.odd.retain(|name, _| !["gaintype", "biastype", "dyntype"].contains(name));
                self.beyond = None;
            }
            "velocity" => {
                let kv = attributes.not_negative("kv", self.gain);
                *self = Self { gain: kv, bias: [0.0, 0.0, -kv], affine: true, ..Self::motor() };
            }
            "motor" => *self = Self::motor(),
            _ => self.beyond = Some(tag),
        }
        for attribute in &attributes.element.attributes {
            let name = attribute.name.as_str();
            let usual = LAW.iter().find(|(law, usual)| *law == name && !usual.is_empty());
            match usual {
                Some((_, usual)) if usual.iter().any(|usual| same(usual, &attribute.value)) => {
                    self.odd.remove(name);
                }
                Some(_) => {
                    self.odd.insert(name, attribute);
                }
                None => {}
            }
        }
    }

    /// Whether a drive of that kind obeys it; a motor but for a factor.
    fn is(&self, kind: ActuatorKind) -> bool {
        let [constant, slope, damping] = if self.affine { self.bias } else { [0.0; 3] };
        constant == 0.0
            && damping <= 0.0
            && match kind {
                ActuatorKind::Motor => slope == 0.0 && damping == 0.0,
                ActuatorKind::Position => slope == -self.gain && self.gain >= 0.0,
                ActuatorKind::Velocity => slope == 0.0 && damping == -self.gain,
            }
    }
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
        let mut law = Law::motor();
        for inherited in self.defaults.drives(element) {
            law.take(&Attributes::new(inherited, None, self.refusals));
        }
        law.take(&attributes);
        for attribute in law.odd.values() {
            let Attribute { name, value, place } = attribute;
            let known = LAW.iter().find(|(law, _)| law == name).map_or("", |(_, usual)| usual[0]);
            self.refusals.add(
                place,
                format!("<{tag}> attribute {name}=\"{value}\" is not supported; only \"{known}\" is"),
            );
        }
        let kinds = [ActuatorKind::Motor, ActuatorKind::Position, ActuatorKind::Velocity];
        let kind = shorthand.into_iter().chain(kinds).find(|kind| law.is(*kind));
        if let (Some(other), true) = (law.beyond, kind.is_some()) {
            attributes.inconsistent(&name, format_args!("has the law of <{other}> from its class"));
        }
        let Some(kind) = kind else {
            let Law { gain, bias, .. } = law;
            attributes.inconsistent(
                &name,
                format_args!(
                    "pushes with {gain} u + {bias:?} (1, q, v), and is no motor (bias 0 0 0), position servo (gain kp, bias 0 -kp -kv) or velocity servo (gain kv, bias 0 0 -kv)"
                ),
            );
            return None;
        };
        let joint = attributes.text("jointinparent").map_or("joint", |_| "jointinparent");
        let joint = attributes.named(joint, "joint", model.joints.iter().map(|joint| &joint.name))?;
        if !model.joints[joint].kind.is_axle() {
            attributes.invalid("joint", "a hinge or a slide");
        }
        // only the first of up to six acts on a hinge or slide
        let mut gear = attributes.first_of::<6>("gear", [1.0; 6])[0];
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
            kp: if kind == ActuatorKind::Position { law.gain } else { 0.0 },
            kv: if servo { -law.bias[2] } else { 0.0 },
            gear,
            command_range: limits("ctrlrange", "ctrllimited"),
            force_range,
        })
    }
}
