//! `<tendon>` and `<equality>`: what couples joints.

use super::Reader;
use super::attributes::Attributes;
use super::element::Element;
use crate::model::{Joint, Tendon, reference_length};

impl<'a> Reader<'a> {
    /// Reads a fixed tendon. Of one over sites only that it does nothing but draw a line, or be measured by a sensor, is read.
    pub(super) fn tendon(
        &self,
        element: &'a Element,
        joints: &[Joint<f64>],
        place: usize,
    ) -> Option<Tendon<f64>> {
        if !["spatial", "fixed"].contains(&element.tag.as_str()) {
            element.refuse(self.refusals);
            return None;
        }
        let attributes = Attributes::new(element, self.defaults.of_kind("tendon", element), self.refusals);
        if attributes.limited_range("range", "limited", self.compiler.autolimits).is_some() {
            attributes.invalid("range", "absent: end stops are supported on hinges and slides only");
        }
        if element.tag == "spatial" {
            return None;
        }
        let (name, named) = attributes.name("tendon", place, std::iter::empty());
        let terms: Vec<_> = element.children.iter().filter_map(|child| self.term(child, joints)).collect();
        if (1..terms.len()).any(|at| terms[..at].iter().any(|(joint, _)| *joint == terms[at].0)) {
            attributes.inconsistent(&name, "runs over a joint twice; add up its coefficients");
        }
        // MuJoCo's way of saying: its length at the springs' references
        let given =
            attributes.list("springlength", 1, 2).filter(|lengths| lengths.iter().any(|x| *x != -1.0));
        let slack = match given.as_deref() {
            Some(&[length]) => [length; 2],
            Some(&[from, to]) if from <= to => [from, to],
            None => [reference_length(&terms, joints); 2],
            Some(_) => {
                attributes.invalid("springlength", "a length, or two that rise");
                [0.0; 2]
            }
        };
        let (stiffness, damping) = (attributes.up_to_three("stiffness"), attributes.up_to_three("damping"));
        Some(Tendon { name, named, terms, stiffness, damping, slack })
    }

    /// A joint of a fixed tendon, and its coefficient.
    fn term(&self, element: &'a Element, joints: &[Joint<f64>]) -> Option<(usize, f64)> {
        if element.tag != "joint" {
            element.refuse(self.refusals);
            return None;
        }
        let attributes = Attributes::of_kind("term", element, None, self.refusals);
        let joint = attributes.named("joint", "joint", joints.iter().map(|joint| &joint.name))?;
        if !joints[joint].kind.is_axle() {
            attributes.invalid("joint", "a hinge or a slide");
        }
        attributes.needed("coef");
        Some((joint, attributes.number("coef", 0.0)))
    }

    /// Refuses an equality that holds.
    pub(super) fn pass_over_equality(&self, element: &'a Element) {
        let defaults = self.defaults.of_kind("equality", element);
        let active =
            element.attribute("active").or_else(|| defaults?.get("active").map(|own| own.value.as_str()));
        if self.options.equality && active != Some("false") {
            let way = match element.tag.as_str() {
                "weld" => "make one body of the two, or a body and its child",
                "connect" => "put a joint in its place, so that the bodies are a tree",
                _ => "leave it out, or make one joint of what it couples",
            };
            let what =
                format!("equality <{}> is not supported here and would change the motion", element.tag);
            self.refusals.add(&element.place, format!("{what}; {way}"));
        }
    }
}
