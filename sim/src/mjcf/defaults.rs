//! Default classes: attributes that elements inherit.

use std::collections::HashMap;

use roxmltree::Node;

use super::attributes::{Values, checked, line, refused};
use super::error::MjcfError;
use super::tables::table;

/// One class: its attributes by element.
type Class<'a> = HashMap<&'a str, Values<'a>>;

/// All default classes of a model, each with what it inherits already in it.
pub(super) struct Defaults<'a> {
    classes: HashMap<&'a str, Class<'a>>,
}

/// The class of elements that name none.
const MAIN_CLASS: &str = "main";
/// Elements whose defaults have no effect on what is simulated.
const IGNORED_ELEMENTS: [&str; 7] = ["camera", "light", "material", "mesh", "pair", "equality", "tendon"];
/// The drives share these attributes' defaults in MuJoCo, whichever of them states them.
const SHARED_DRIVE_ATTRIBUTES: [&str; 5] = ["gear", "ctrlrange", "ctrllimited", "forcerange", "forcelimited"];
const DRIVES: [&str; 3] = ["position", "velocity", "motor"];

impl<'a> Defaults<'a> {
    /// Reads the top-level `<default>` elements.
    pub(super) fn read<'i: 'a>(root: Node<'a, 'i>) -> Result<Self, MjcfError> {
        let mut defaults = Self { classes: HashMap::from([(MAIN_CLASS, Class::new())]) };
        for node in root.children().filter(|node| node.has_tag_name("default")) {
            defaults.add(node, None)?;
        }
        Ok(defaults)
    }

    fn add<'i: 'a>(&mut self, node: Node<'a, 'i>, parent: Option<&'a str>) -> Result<(), MjcfError> {
        let name = match (node.attribute("class"), parent) {
            (Some(name), _) => name,
            (None, None) => MAIN_CLASS,
            (None, Some(_)) => {
                return Err(MjcfError::Missing {
                    line: line(node),
                    element: "default".into(),
                    attribute: "class".into(),
                });
            }
        };
        let mut class = match parent {
            Some(parent) if self.classes.contains_key(name) => {
                return Err(MjcfError::Duplicate {
                    line: line(node),
                    element: "default".into(),
                    name: format!("{name} (in {parent})"),
                });
            }
            Some(parent) => self.classes[parent].clone(),
            None => self.classes.get(name).cloned().unwrap_or_default(),
        };
        for child in node.children().filter(Node::is_element) {
            let tag = child.tag_name().name();
            if tag == "default" || IGNORED_ELEMENTS.contains(&tag) {
                continue;
            }
            if table(tag).is_none() {
                return Err(refused(child));
            }
            let values = checked(child)?;
            if DRIVES.contains(&tag) {
                for other in DRIVES {
                    let shared = values.iter().filter(|(name, _)| SHARED_DRIVE_ATTRIBUTES.contains(name));
                    class.entry(other).or_default().extend(shared);
                }
            }
            class.entry(tag).or_default().extend(values);
        }
        self.classes.insert(name, class);
        for child in node.children().filter(|child| child.has_tag_name("default")) {
            self.add(child, Some(name))?;
        }
        Ok(())
    }

    /// The defaults of the element `node`: of its own class, else of the nearest `childclass`, else of main.
    pub(super) fn of(
        &self,
        node: Node<'a, '_>,
        childclass: Option<&'a str>,
    ) -> Result<Option<&Values<'a>>, MjcfError> {
        // a free joint written as such takes none
        if node.has_tag_name("freejoint") {
            return Ok(None);
        }
        let name = node.attribute("class").or(childclass).unwrap_or(MAIN_CLASS);
        match self.classes.get(name) {
            Some(class) => Ok(class.get(node.tag_name().name())),
            None => Err(MjcfError::Value {
                line: line(node),
                element: node.tag_name().name().into(),
                attribute: "class".into(),
                value: name.into(),
                wanted: "the name of a default class".into(),
            }),
        }
    }
}
