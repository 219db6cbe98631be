//! `<replicate>`: the same elements many times, each time further on.

use super::attributes::{Angles, Attributes};
use super::element::{Attribute, Element};
use super::error::Refusals;
use crate::math::{Quat, Vec3};

/// Most elements of a model that are copies (chosen): a wrong count should not fill the memory.
const COPIES_MAX: usize = 100_000;

/// Writes out each `<replicate>` of a model.
pub(super) struct Replicator<'r> {
    angles: &'r Angles,
    refusals: &'r Refusals,
    copies: usize,
}

impl<'r> Replicator<'r> {
    pub(super) fn new(angles: &'r Angles, refusals: &'r Refusals) -> Self {
        Self { angles, refusals, copies: 0 }
    }

    /// Puts a `<frame>` for each copy in the place of each `<replicate>` below `element`.
    pub(super) fn expand(&mut self, element: &mut Element) {
        for mut child in std::mem::take(&mut element.children) {
            // the innermost first: so are its names' endings
            self.expand(&mut child);
            if child.tag == "replicate" {
                element.children.extend(self.copies(&child));
            } else {
                element.children.push(child);
            }
        }
    }

    fn copies(&mut self, replicate: &Element) -> Vec<Element> {
        let attributes = Attributes::new(replicate, None, self.refusals);
        attributes.needed("count");
        let count: usize = attributes.whole("count", 0, "a whole number");
        let (offset, turns) = (attributes.vector("offset"), attributes.array("euler"));
        let separator = attributes.text("sep").unwrap_or_default();
        self.copies = self.copies.saturating_add(count.saturating_mul(replicate.size()));
        if self.copies > COPIES_MAX {
            attributes
                .invalid("count", format_args!("so small that at most {COPIES_MAX} elements are copies"));
            return Vec::new();
        }
        let width = count.to_string().len();
        let mut pos = Vec3::ZERO;
        let mut frames = Vec::with_capacity(count);
        for copy in 0..count {
            let turn = |turns: [f64; 3]| self.angles.turn(turns.map(|turn| turn * copy as f64));
            let quat = turns.map_or(Quat::IDENTITY, turn);
            let mut frame = replicate.clone();
            frame.tag = "frame".into();
            frame.attributes.clear();
            for (name, numbers) in [("pos", &pos.0[..]), ("quat", &quat.0[..])] {
                let value = numbers.iter().map(|x| format!("{x:?}")).collect::<Vec<_>>().join(" ");
                frame.attributes.push(Attribute { name: name.into(), value, place: replicate.place.clone() });
            }
            let ending = format!("{separator}{copy:0width$}");
            frame.each_below(&mut |element| {
                for name in element.attributes.iter_mut().filter(|attribute| attribute.name == "name") {
                    name.value += &ending;
                }
            });
            frames.push(frame);
            pos += quat.matrix().apply(offset.unwrap_or(Vec3::ZERO));
        }
        frames
    }
}
