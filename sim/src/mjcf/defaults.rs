//! Default classes: attributes that elements inherit.

use std::collections::HashMap;

use super::attributes::{Values, own};
use super::drive;
use super::element::Element;
use super::error::Refusals;
use super::tables::table;

/// One class, with what it inherits already in it.
#[derive(Default, Clone)]
struct Class<'a> {
    /// Attributes by element; those of all actuators stand under [`drive::GENERAL`].
    values: HashMap<&'a str, Values<'a>>,
    /// Its actuators in order, each with how deep its class is: each makes its own sense of what those before it say.
    drives: Vec<(usize, &'a Element)>,
    depth: usize,
}

/// All default classes of a model.
pub(super) struct Defaults<'a> {
    classes: HashMap<&'a str, Class<'a>>,
    refusals: &'a Refusals,
}

/// The class of elements that name none.
const MAIN_CLASS: &str = "main";
/// Elements that may have defaults, which have no effect on what is simulated.
const IGNORED_ELEMENTS: [&str; 5] = ["camera", "light", "material", "mesh", "pair"];

impl<'a> Defaults<'a> {
    /// Reads the top-level `<default>` elements.
    pub(super) fn read(root: &'a Element, refusals: &'a Refusals) -> Self {
        let mut defaults = Self { classes: HashMap::from([(MAIN_CLASS, Class::default())]), refusals };
        for element in root.all("default") {
            defaults.add(element, None);
        }
        defaults
    }

    fn add(&mut self, element: &'a Element, parent: Option<&'a str>) {
        let name = element.attribute("class");
        if name.is_none() && parent.is_some() {
            self.refusals.add(&element.place, "<default> needs the attribute class");
        }
        let name = name.unwrap_or(MAIN_CLASS);
        if parent.is_none() && name != MAIN_CLASS {
            let problem = format!("<default> attribute class=\"{name}\" must be {MAIN_CLASS} at the top");
            self.refusals.add(&element.place, problem);
        }
        if parent.is_some() && self.classes.contains_key(name) {
            self.refusals
                .add(&element.place, format!("<default> name \"{name}\" is taken by an earlier one"));
        }
        let mut class = self.classes.get(parent.unwrap_or(name)).cloned().unwrap_or_default();
        class.depth += usize::from(parent.is_some());
        for child in &element.children {
            let tag = child.tag.as_str();
            if drive::is_drive(tag) {
                class.drives.push((class.depth, child));
                class.values.entry(drive::GENERAL).or_default().extend(drive::shared(child));
            } else if table(tag).is_some() {
                class.values.entry(tag).or_default().extend(own(child));
            } else if tag != "default" && !IGNORED_ELEMENTS.contains(&tag) {
                child.refuse(self.refusals);
            }
        }
        self.classes.insert(name, class);
        for child in element.all("default") {
            self.add(child, Some(name));
        }
    }

    /// The class of `element`: its own, else the nearest `childclass`, else main.
    fn class(&self, element: &Element, childclass: Option<&str>) -> Option<&Class<'a>> {
        let name = element.attribute("class").or(childclass).unwrap_or(MAIN_CLASS);
        let class = self.classes.get(name);
        if class.is_none() {
            let problem =
                format!("<{}> attribute class=\"{name}\" must be the name of a default class", element.tag);
            self.refusals.add(&element.place, problem);
        }
        class
    }

    /// The defaults of `element`.
    pub(super) fn of(&self, element: &Element, childclass: Option<&str>) -> Option<&Values<'a>> {
        // a free joint written as such takes none
        if element.tag == "freejoint" {
            return None;
        }
        let tag = if drive::is_drive(&element.tag) { drive::GENERAL } else { &element.tag };
        self.class(element, childclass)?.values.get(tag)
    }

    /// The same for an element of those that share the defaults `kind`.
    pub(super) fn of_kind(&self, kind: &str, element: &Element) -> Option<&Values<'a>> {
        self.class(element, None)?.values.get(kind)
    }

    /// The actuators whose say the actuator `element` inherits, in order.
    pub(super) fn drives(&self, element: &Element) -> &[(usize, &'a Element)] {
        self.class(element, None).map_or(&[], |class| &class.drives)
    }
}
