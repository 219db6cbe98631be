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

    /// Numbers the elements below by kind, in the order of the text; `met`: how many there were before.
    pub(super) fn number(&mut self, met: &mut HashMap<String, usize>) {
        for child in &mut self.children {
            let kind = if child.tag == "freejoint" { "joint" } else { &child.tag };
            let met_so_far = met.entry(kind.into()).or_default();
            child.ordinal = *met_so_far;
            *met_so_far += 1;
            child.number(met);
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
        let problem = format!("element <{}> is not supported here and would change the motion; ", self.tag);
        refusals.add(&self.place, problem + "remove it");
    }
}
