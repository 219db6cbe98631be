//! By which law an actuator pushes, as it and its classes say.

use std::collections::BTreeMap;

use super::attributes::{Attributes, same};
use super::drive::GENERAL;
use super::element::{Attribute, Element};
use super::error::Refusals;
use crate::model::ActuatorKind;

/// What says by which law an actuator pushes, and with which values that is a law known here.
pub(super) const LAW: [(&str, &[&str]); 10] = [
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

/// The force of the command u, the joint's coordinate q and its rate v: gain u + bias\[0\] + bias\[1\] q + bias\[2\] v.
#[derive(Clone)]
pub(super) struct Law<'a> {
    pub(super) gain: f64,
    pub(super) bias: [f64; 3],
    affine: bool,
    /// The shorthand that said so, where one did: only the same goes on from it.
    servo: Option<ActuatorKind>,
    /// Attributes that make it another law than this.
    odd: BTreeMap<&'a str, &'a Attribute>,
    /// The shorthand that makes it another.
    pub(super) beyond: Option<&'a str>,
}

impl<'a> Law<'a> {
    /// The law of an actuator after `inherited`, those of its classes, each with how deep its class is.
    pub(super) fn of(
        attributes: &Attributes<'a>,
        inherited: &[(usize, &'a Element)],
        refusals: &'a Refusals,
    ) -> Self {
        let mut laws: Vec<(usize, Self)> = Vec::new();
        for &(depth, element) in inherited {
            let law = Self::after(&laws, &Attributes::new(element, None, refusals));
            laws.retain(|(before, _)| *before != depth);
            laws.push((depth, law));
        }
        let law = Self::after(&laws, attributes);
        let tag = &attributes.element.tag;
        for Attribute { name, value, place } in law.odd.values() {
            let known = LAW.iter().find(|(law, _)| law == name).map_or("", |(_, usual)| usual[0]);
            let given = format!("<{tag}> attribute {name}=\"{value}\" is not supported");
            refusals.add(place, format!("{given}; only \"{known}\" is"));
        }
        law
    }

    fn motor() -> Self {
        Self { gain: 1.0, bias: [0.0; 3], affine: false, servo: None, odd: BTreeMap::new(), beyond: None }
    }

    /// The law that `attributes` of an actuator, or of one among its defaults, make of those `before`, each at the end of a class of
    /// that depth.
    fn after(before: &[(usize, Self)], attributes: &Attributes<'a>) -> Self {
        let from = |kind| {
            let mut laws = before.iter().rev().map(|(_, law)| law);
            laws.find(|law| law.servo.is_none_or(|servo| servo == kind)).cloned().unwrap_or_else(Self::motor)
        };
        let tag = attributes.element.tag.as_str();
        let mut law = match tag {
            "motor" => Self::motor(),
            "position" => {
                let servo = ActuatorKind::Position;
                let mut law = from(servo);
                let kp = attributes.not_negative("kp", law.gain);
                let kv = attributes.not_negative("kv", -law.bias[2]);
                law.odd.retain(|name, _| !["gaintype", "biastype", "dyntype"].contains(name));
                let (gain, bias) = (kp, [0.0, -kp, -kv]);
                Self { gain, bias, affine: true, servo: Some(servo), odd: law.odd, beyond: None }
            }
            "velocity" => {
                let servo = ActuatorKind::Velocity;
                let kv = attributes.not_negative("kv", from(servo).gain);
                Self { gain: kv, bias: [0.0, 0.0, -kv], affine: true, servo: Some(servo), ..Self::motor() }
            }
            _ => before.last().map_or_else(Self::motor, |(_, law)| law.clone()).adjusted(attributes),
        };
        for attribute in &attributes.element.attributes {
            let name = attribute.name.as_str();
            match LAW.iter().find(|(law, usual)| *law == name && !usual.is_empty()) {
                Some((_, usual)) if usual.iter().any(|usual| same(usual, &attribute.value)) => {
                    law.odd.remove(name);
                }
                Some(_) => {
                    law.odd.insert(name, attribute);
                }
                None => {}
            }
        }
        law
    }

    /// With what a `<general>` says of it; any other shorthand makes it a law that is not known here.
    fn adjusted(mut self, attributes: &Attributes<'a>) -> Self {
        if attributes.element.tag != GENERAL {
            return Self { beyond: Some(&attributes.element.tag), ..self };
        }
        let before = |first: &[f64]| std::array::from_fn(|i| first.get(i).copied().unwrap_or(0.0));
        self.gain = attributes.first_of::<PARAMETERS_MAX>("gainprm", before(&[self.gain]))[0];
        let bias = attributes.first_of::<PARAMETERS_MAX>("biasprm", before(&self.bias));
        self.bias = std::array::from_fn(|i| bias[i]);
        self.affine = attributes.text("biastype").map_or(self.affine, |bias| bias == "affine");
        self.servo = None;
        self
    }

    /// Whether a drive of that kind obeys it; a motor but for a factor.
    pub(super) fn is(&self, kind: ActuatorKind) -> bool {
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
