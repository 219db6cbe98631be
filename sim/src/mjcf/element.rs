//! The XML elements of a model, each with where it stands.

use std::collections::HashMap;
use std::sync::Arc;

use super::error::{Place, Refusals};

/// An element with all it contains.
#[derive(Debug, Clone)]
pub(super) struct Element {
    pub(super) tag: String,
    pub(super) place: Place,
    pub(super) attributes: Vec<Attribute>,
    pub(super) children: Vec<Self>,
    /// In a body tree: its place among the elements of its kind, by which it is called where it has no name.
    pub(super) ordinal: usize,
}

/// An attribute as it is written.
#[derive(Debug, Clone)]
pub(super) struct Attribute {
    pub(super) name: String,
    pub(super) value: String,
    pub(super) place: Place,
}

impl Element {
    /// The root of `text`; `None`, and a refusal, where it is no XML. `file`: the included file that it is from.
    pub(super) fn parse(text: &str, file: Option<&Arc<str>>, refusals: &Refusals) -> Option<Self> {
        let place = |line| Place { file: file.cloned(), line };
        let options = roxmltree::ParsingOptions { allow_dtd: false, ..Default::default() };
        match roxmltree::Document::parse_with_options(text, options) {
            Ok(document) => {
                let ends: Vec<usize> = text.match_indices('\n').map(|(at, _)| at).collect();
                let line = |at: usize| place(ends.partition_point(|end| *end < at) as u32 + 1);
                Some(Self::of(document.root_element(), &line))
            }
            Err(error) => {
                let problem = format!("this is not well-formed XML: {error}");
                refusals.add(&place(error.pos().row), problem);
                None
            }
        }
    }

    fn of(node: roxmltree::Node<'_, '_>, place: &dyn Fn(usize) -> Place) -> Self {
        let attributes = node.attributes().map(|attribute| Attribute {
            name: attribute.name().into(),
            value: attribute.value().into(),
            place: place(attribute.range().start),
        });
        Self {
            tag: node.tag_name().name().into(),
            place: place(node.range().start),
            attributes: attributes.collect(),
            children: node
                .children()
                .filter(roxmltree::Node::is_element)
                .map(|child| Self::of(child, place))
                .collect(),
            ordinal: 0,
        }
    }

    /// Does `work` with each element below, in the order of the text.
    pub(super) fn each_below(&mut self, work: &mut impl FnMut(&mut Self)) {
        for child in &mut self.children {
            work(child);
            child.each_below(work);
        }
    }

    /// How many elements are below.
    pub(super) fn size(&self) -> usize {
        self.children.iter().map(|child| 1 + child.size()).sum()
    }

    /// Numbers the elements of all `<worldbody>` by kind.
    pub(super) fn number(&mut self) {
        let mut met: HashMap<String, usize> = HashMap::new();
        for world in self.children.iter_mut().filter(|section| section.tag == "worldbody") {
            world.each_below(&mut |element| {
                let kind = if element.tag == "freejoint" { "joint" } else { &element.tag };
                let count = met.entry(kind.into()).or_default();
                element.ordinal = *count;
                *count += 1;
            });
        }
    }

    /// The value of an attribute.
    pub(super) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|attribute| attribute.name == name).map(|found| found.value.as_str())
    }

    /// Its children with that tag.
    pub(super) fn all<'a>(&'a self, tag: &'a str) -> impl Iterator<Item = &'a Self> {
        self.children.iter().filter(move |child| child.tag == tag)
    }

    /// Refuses the element as one that is not supported where it stands.
    pub(super) fn refuse(&self, refusals: &Refusals) {
        let instead = INSTEAD.iter().find(|(tag, _)| *tag == self.tag).map_or("remove it", |(_, way)| way);
        let problem = format!("element <{}> is not supported here and would change the motion; ", self.tag);
        refusals.add(&self.place, problem + instead);
    }
}

/// What to do about elements that cannot just be left out.
const INSTEAD: [(&str, &str); 9] = [
    ("composite", "MuJoCo writes it out as bodies and joints (mj_saveLastXML)"),
    ("attach", "MuJoCo writes it out as bodies (mj_saveLastXML)"),
    ("model", "MuJoCo writes out what is attached (mj_saveLastXML)"),
    ("flexcomp", "what bends is a chain of bodies here, with springs in the hinges"),
    ("flex", "what bends is a chain of bodies here, with springs in the hinges"),
    ("muscle", "drives are motors, position and velocity servos"),
    ("intvelocity", "drives are motors, position and velocity servos; command the integral to a <position>"),
    ("pair", "give the geoms themselves contype, conaffinity and their contact's parameters"),
    ("plugin", "what a plugin computes may be a cause of your own"),
];
