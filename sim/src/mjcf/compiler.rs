//! `<compiler>`: how the text is to be read.

use roxmltree::Node;

use super::attributes::{Angles, Attributes};
use super::error::MjcfError;

/// How the text is to be read.
pub(super) struct Compiler {
    pub(super) angles: Angles,
    pub(super) autolimits: bool,
    /// `None`: geoms count where a body has no `<inertial>`.
    pub(super) inertia_from_geoms: Option<bool>,
}

/// Reads the `<compiler>` elements.
pub(super) fn compiler<'a, 'i: 'a>(
    sections: impl Iterator<Item = Node<'a, 'i>>,
) -> Result<Compiler, MjcfError> {
    let mut compiler = Compiler {
        angles: Angles { degrees: true, euler_sequence: "xyz".into() },
        autolimits: true,
        inertia_from_geoms: None,
    };
    const FLAG: [(&str, bool); 2] = [("true", true), ("false", false)];
    for node in sections {
        let attributes = Attributes::new(node, None)?;
        let degrees = compiler.angles.degrees;
        compiler.angles.degrees =
            attributes.one_of("angle", &[("degree", true), ("radian", false)], degrees)?;
        compiler.autolimits = attributes.one_of("autolimits", &FLAG, compiler.autolimits)?;
        compiler.inertia_from_geoms = attributes.one_of(
            "inertiafromgeom",
            &[("true", Some(true)), ("false", Some(false)), ("auto", None)],
            compiler.inertia_from_geoms,
        )?;
        if let Some(sequence) = attributes.text("eulerseq") {
            if sequence.len() != 3 || !sequence.chars().all(|c| "xyzXYZ".contains(c)) {
                return Err(attributes.invalid("eulerseq", "three letters out of xyzXYZ"));
            }
            compiler.angles.euler_sequence = sequence.into();
        }
    }
    Ok(compiler)
}
