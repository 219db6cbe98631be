//! Joints.

use super::body::{Scope, Tree};
use super::element::Element;
use crate::math::Vec3;
use crate::model::{Joint, JointKind, Softness};

impl<'a> Tree<'a> {
    pub(super) fn add_joint(&mut self, element: &'a Element, scope: Scope<'a>) {
        let attributes = self.reader.attributes(element, scope.class);
        let (name, named) =
            attributes.name("joint", element.ordinal, self.joints.iter().map(|joint| &joint.name));
        let kind = match element.tag.as_str() {
            "freejoint" => JointKind::Free,
            _ => attributes.one_of("type", &JointKind::NAMED, JointKind::Hinge),
        };
        let body = scope.body;
        let earlier: Vec<JointKind> =
            self.joints.iter().filter(|joint| joint.body == body).map(|joint| joint.kind).collect();
        if earlier.contains(&JointKind::Free) || (kind == JointKind::Free && !earlier.is_empty()) {
            attributes.inconsistent(&name, "shares its body with a free joint, which must be alone");
        }
        if kind == JointKind::Free && self.bodies[body].parent != 0 {
            attributes.inconsistent(&name, "is free, but its body is not a child of the world");
        }
        if earlier.contains(&JointKind::Ball) && kind != JointKind::Slide {
            attributes.inconsistent(&name, "turns a body after its ball joint; put it on a body between");
        }
        let compiler = &self.reader.compiler;
        let in_radians = |x: f64| if kind == JointKind::Hinge { compiler.angles.radians(x) } else { x };
        let single = kind.is_axle();
        let limited = || attributes.limited_range("range", "limited", compiler.autolimits);
        // what a free joint inherits of end stops has no effect
        let mut limit = if kind == JointKind::Free { None } else { limited() };
        if limit.is_some() && !single {
            attributes.invalid("range", "absent: end stops are supported on hinges and slides only");
            limit = None;
        }
        let (stiffness, damping) = (attributes.up_to_three("stiffness"), attributes.up_to_three("damping"));
        for (of, [_, second, third]) in [("stiffness", stiffness), ("damping", damping)] {
            if !single && (second != 0.0 || third != 0.0) {
                attributes.invalid(of, "one number on a ball or free joint");
            }
        }
        let upwards = [0.0, 0.0, 1.0];
        let axis = attributes.array("axis").filter(|_| single).unwrap_or(upwards);
        let axis = Vec3(attributes.unit("axis", axis).unwrap_or(upwards));
        let pos = scope.placed(attributes.vector("pos").unwrap_or(Vec3::ZERO));
        let friction_loss = attributes.not_negative("frictionloss", 0.0);
        let softness = |solref, solimp| Softness {
            solref: attributes.solref(solref, Softness::default().solref),
            solimp: attributes.first_of(solimp, Softness::default().solimp),
        };
        let options = &self.reader.options;
        self.joints.push(Joint {
            name,
            named,
            kind,
            body,
            qpos_address: self.joints.iter().map(|joint| joint.kind.nq()).sum(),
            dof_address: self.joints.iter().map(|joint| joint.kind.nv()).sum(),
            pos: if kind == JointKind::Free { Vec3::ZERO } else { pos },
            axis: if single { scope.turned(axis) } else { axis },
            reference: if single { in_radians(attributes.number("ref", 0.0)) } else { 0.0 },
            spring_reference: if single { in_radians(attributes.number("springref", 0.0)) } else { 0.0 },
            stiffness,
            damping,
            armature: attributes.not_negative("armature", 0.0),
            friction_loss: if options.friction_loss { friction_loss } else { 0.0 },
            limit: limit.map(|range| range.map(in_radians)).filter(|_| options.limit),
            limit_margin: attributes.not_negative("margin", 0.0),
            limit_softness: softness("solreflimit", "solimplimit"),
            friction_softness: softness("solreffriction", "solimpfriction"),
        });
    }
}
