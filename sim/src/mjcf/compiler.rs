//! `<compiler>`: how the text is to be read.

use super::attributes::{Angles, Attributes};
use super::element::Element;
use super::error::Refusals;
use crate::math::Vec3;
use crate::model::Body;

/// How the text is to be read.
pub(super) struct Compiler {
    pub(super) angles: Angles,
    pub(super) autolimits: bool,
    /// `None`: geoms count where a body has no `<inertial>`.
    pub(super) inertia_from_geoms: Option<bool>,
    /// The groups of geoms that have mass.
    heavy_groups: [i32; 2],
    /// Least mass \[kg\] and moment of inertia \[kg m2\] of a body.
    least: [f64; 2],
    /// Mass of all bodies together \[kg\], where it is set.
    total_mass: Option<f64>,
}

impl Compiler {
    /// Reads the `<compiler>` elements.
    pub(super) fn read(root: &Element, refusals: &Refusals) -> Self {
        let mut compiler = Self {
            angles: Angles { degrees: true, euler_sequence: "xyz".into() },
            autolimits: true,
            inertia_from_geoms: None,
            heavy_groups: [0, 5],
            least: [0.0; 2],
            total_mass: None,
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
            if let Some(range) = attributes.array("inertiagrouprange") {
                compiler.heavy_groups = range.map(|group: f64| group as i32);
            }
            let [mass, inertia] = compiler.least;
            compiler.least = [
                attributes.not_negative("boundmass", mass),
                attributes.not_negative("boundinertia", inertia),
            ];
            // below 0 is MuJoCo's way of saying that it is not set
            let total = attributes.number("settotalmass", compiler.total_mass.unwrap_or(-1.0));
            compiler.total_mass = Some(total).filter(|total| *total > 0.0);
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
    /// Whether geoms of the group have mass.
    pub(super) fn is_heavy(&self, group: i32) -> bool {
        (self.heavy_groups[0]..=self.heavy_groups[1]).contains(&group)
    }

    /// Raises and scales the masses of `bodies` as asked for.
    pub(super) fn weigh(&self, bodies: &mut [Body<f64>]) {
        let [least_mass, least_inertia] = self.least;
        for body in bodies.iter_mut().skip(1) {
            body.mass = body.mass.max(least_mass);
            body.inertia = Vec3(body.inertia.0.map(|moment| moment.max(least_inertia)));
        }
        let mass: f64 = bodies.iter().map(|body| body.mass).sum();
        if let Some(total) = self.total_mass.filter(|_| mass > 0.0) {
            let scale = total / mass;
            for body in bodies {
                body.mass *= scale;
                body.inertia = body.inertia * scale;
            }
        }
    }
}
