//! Geoms.

use super::attributes::{Attributes, from_z};
use super::body::{Scope, Tree};
use super::element::Element;
use crate::math::Vec3;
use crate::model::shape::{self, MassProperties};
use crate::model::{FluidCoefficients, Geom, GeomKind, Surface};

/// MuJoCo's density where a geom states none \[kg/m3\].
const DEFAULT_DENSITY_KG_PER_M3: f64 = 1000.0;
/// MuJoCo's coefficients where a geom states none.
const DEFAULT_FLUID_COEFFICIENTS: [f64; 5] = [0.5, 0.25, 1.5, 1.0, 1.0];
/// Size of what stands in for a geom without a good one \[m\].
const STAND_IN_SIZE_M: f64 = 1.0;

impl<'a> Tree<'a> {
    /// Adds the geom; its mass properties where it has any.
    pub(super) fn add_geom(&mut self, element: &'a Element, scope: Scope<'a>) -> Option<MassProperties> {
        let attributes = self.reader.attributes(element, scope.class);
        let (name, named) =
            attributes.name("geom", element.ordinal, self.geoms.iter().map(|geom| &geom.name));
        let kinds = [
            ("sphere", Some(GeomKind::Sphere)),
            ("capsule", Some(GeomKind::Capsule)),
            ("cylinder", Some(GeomKind::Cylinder)),
            ("ellipsoid", Some(GeomKind::Ellipsoid)),
            ("box", Some(GeomKind::Box)),
            ("plane", Some(GeomKind::Plane)),
            // shapes from files and formulas
            ("mesh", None),
            ("hfield", None),
            ("sdf", None),
        ];
        let body = scope.body;
        let heavy = self.reader.compiler.is_heavy(attributes.whole("group", 0, "a whole number"))
            && body != 0
            && !scope.weighed;
        let Some(kind) = attributes.one_of("type", &kinds, Some(GeomKind::Sphere)) else {
            self.pass_over(&attributes, &name, heavy);
            return None;
        };
        if attributes.text("mesh").is_some() {
            attributes
                .invalid("mesh", "absent from another shape, which MuJoCo would fit to it: give its size");
        }
        let mut pos = attributes.vector("pos").unwrap_or(Vec3::ZERO);
        let mut quat = attributes.orientation(&self.reader.compiler.angles);
        let mut size = attributes.up_to_three("size");
        if let Some([a, b, c, d, e, f]) = attributes.array::<6>("fromto") {
            let (from, to) = (Vec3([a, b, c]), Vec3([d, e, f]));
            let along = from - to;
            let length = along.norm();
            match kind {
                GeomKind::Capsule | GeomKind::Cylinder => size[1] = length / 2.0,
                GeomKind::Ellipsoid | GeomKind::Box => size = [size[0], size[0], length / 2.0],
                GeomKind::Sphere | GeomKind::Plane => {
                    attributes.invalid("fromto", "absent from a sphere or plane");
                }
            }
            if length < 1e-14 {
                attributes.invalid("fromto", "two points apart");
            } else {
                quat = from_z(along * (1.0 / length));
            }
            pos = (from + to) * 0.5;
        }
        let used = match kind {
            GeomKind::Sphere => 1,
            GeomKind::Capsule | GeomKind::Cylinder => 2,
            GeomKind::Ellipsoid | GeomKind::Box => 3,
            GeomKind::Plane => 0,
        };
        if size[..used].iter().any(|size| *size <= 0.0) {
            attributes.invalid("size", format_args!("{used} numbers above 0"));
            size = [STAND_IN_SIZE_M; 3];
        }
        size[used..].fill(0.0);
        if kind == GeomKind::Plane && body != 0 {
            attributes.inconsistent(&name, "is a plane on a body; planes belong to the world");
        }
        let ellipsoid = attributes.one_of("fluidshape", &[("none", false), ("ellipsoid", true)], false);
        // MuJoCo takes the first of fewer than five and leaves the others at their defaults
        let [blunt, slender, angular, kutta, magnus] =
            attributes.first_of("fluidcoef", DEFAULT_FLUID_COEFFICIENTS);
        let bits = |name| attributes.whole(name, 1, "a whole number of 0 or more");
        self.geoms.push(Geom {
            name,
            named,
            body,
            kind,
            size,
            pos: scope.placed(pos),
            quat: scope.oriented(quat),
            fluid: (ellipsoid && body != 0).then_some(FluidCoefficients {
                blunt,
                slender,
                angular,
                kutta,
                magnus,
            }),
            contact_bits: [bits("contype"), bits("conaffinity")],
            contact_margin_m: attributes.not_negative("margin", 0.0),
            surface: surface(&attributes),
        });
        if !heavy || kind == GeomKind::Plane {
            return None;
        }
        let density = attributes.not_negative("density", DEFAULT_DENSITY_KG_PER_M3);
        let mass = attributes.not_negative("mass", density * shape::volume(kind, size));
        let inertia = shape::inertia(kind, size, mass);
        let (com, principal) = (scope.placed(pos), scope.oriented(quat));
        (mass > 0.0).then_some(MassProperties { mass, com, inertia, principal })
    }

    /// Refuses a mesh, or another shape that is not computed here, unless it only draws.
    fn pass_over(&self, attributes: &Attributes<'a>, name: &str, heavy: bool) {
        let kind = attributes.text("type").unwrap_or_default();
        let zero = |what| attributes.text(what).is_some() && attributes.number(what, 1.0) == 0.0;
        if heavy
            && kind != "hfield"
            && !zero("mass")
            && (attributes.text("mass").is_some() || !zero("density"))
        {
            let problem = "whose mass is not computed here; give its body an <inertial>, as MuJoCo writes it: \
                set <compiler saveinertial=\"true\"/> and save the model (mj_saveLastXML)";
            attributes.inconsistent(name, format_args!("is of type {kind}, {problem}"));
        }
        let touches = self.reader.options.contact && !(zero("contype") && zero("conaffinity"));
        if touches {
            let problem = "which may touch others; give it contype=\"0\" conaffinity=\"0\", and a shape that is \
                simulated in its place: box, capsule, cylinder, ellipsoid, sphere or plane";
            attributes.inconsistent(name, format_args!("is of type {kind}, {problem}"));
        }
        if attributes.text("fluidshape").is_some_and(|shape| shape != "none") {
            attributes.invalid("fluidshape", format_args!("absent from a geom of type {kind}"));
        }
    }
}

/// What a geom brings to its contacts.
fn surface(attributes: &Attributes<'_>) -> Surface {
    let usual = Surface::default();
    // MuJoCo takes the first of fewer and leaves the others at their defaults
    let friction = attributes.first_of("friction", usual.friction);
    if friction.iter().any(|friction| *friction < 0.0) {
        attributes.invalid("friction", "up to three numbers, none below 0");
    }
    const CONDIMS: [(&str, usize); 4] = [("1", 1), ("3", 3), ("4", 4), ("6", 6)];
    Surface {
        priority: attributes.whole("priority", 0, "a whole number"),
        condim: attributes.one_of("condim", &CONDIMS, usual.condim),
        friction,
        solmix: attributes.not_negative("solmix", usual.solmix),
        solref: attributes.solref("solref", usual.solref),
        solimp: attributes.first_of("solimp", usual.solimp),
        gap_m: attributes.not_negative("gap", 0.0),
    }
}
