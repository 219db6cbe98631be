//! `<tendon>` and `<equality>`: read where they have no effect, else refused.

use super::Reader;
use super::attributes::Attributes;
use super::element::Element;

impl<'a> Reader<'a> {
    /// Refuses a tendon that pulls. One that only draws a line through sites, or is measured by a sensor, does not.
    pub(super) fn pass_over_tendon(&self, element: &'a Element) {
        if !["spatial", "fixed"].contains(&element.tag.as_str()) {
            element.refuse(self.refusals);
            return;
        }
        let attributes =
            Attributes::of_kind("tendon", element, self.defaults.of_kind("tendon", element), self.refusals);
        if attributes.limited_range("range", "limited", self.compiler.autolimits).is_some() {
            attributes.invalid("range", "absent: end stops are supported on hinges and slides only");
        }
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
            let problem = format!(
                "equality <{}> is not supported here and would change the motion; {way}",
                element.tag
            );
            self.refusals.add(&element.place, problem);
        }
    }
}
