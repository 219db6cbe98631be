//! `<compiler>`: how the text is to be read.

use super::attributes::{Angles, Attributes};
use super::element::Element;
use super::error::Refusals;

/// How the text is to be read.
pub(super) struct Compiler {
    pub(super) angles: Angles,
    pub(super) autolimits: bool,
    /// `None`: geoms count where a body has no `<inertial>`.
    pub(super) inertia_from_geoms: Option<bool>,
}

impl Compiler {
    /// Reads the `<compiler>` elements.
    pub(super) fn read(root: &Element, refusals: &Refusals) -> Self {
        let mut compiler = Self {
            angles: Angles { degrees: true, euler_sequence: "xyz".into() },
            autolimits: true,
            inertia_from_geoms: None,
        };
        const FLAG: [(&str, bool); 2] = [("true", true), ("false", false)];
        for element in root.all("compiler") {
            let attributes = Attributes::new(element, None, refusals);
            let angles = [("degree", true), ("radian", false)];
            compiler.angles.degrees = attributes.one_of("angle", &angles, compiler.angles.degrees);
            compiler.autolimits = attributes.one_of("autolimits", &FLAG, compiler.autolimits);
            compiler.inertia_from_geoms = attributes.one_of(
                "inertiafromgeom",
                &[("true", Some(true)), ("false", Some(false)), ("auto", None)],
                compiler.inertia_from_geoms,
            );
            if let Some(sequence) = attributes.text("eulerseq") {
                if sequence.len() == 3 && sequence.chars().all(|c| "xyzXYZ".contains(c)) {
                    compiler.angles.euler_sequence = sequence.into();
                } else {
                    attributes.invalid("eulerseq", "three letters out of xyzXYZ");
                }
            }
        }
        compiler
    }
}
