//! The body tree.

use super::Reader;
use super::attributes::Attributes;
use super::element::Element;
use super::error::Place;
use crate::math::{Quat, Sym3, Vec3};
use crate::model::shape::{self, MassProperties};
use crate::model::{Body, Geom, Joint, Site};

/// Least mass \[kg\] and moment \[kg m2\] of a body that moves, as in MuJoCo.
const MASS_AND_INERTIA_MIN: f64 = 1e-15;

/// The tree as far as it is read.
pub(super) struct Tree<'a> {
    pub(super) reader: &'a Reader<'a>,
    pub(super) bodies: Vec<Body<f64>>,
    pub(super) joints: Vec<Joint<f64>>,
    pub(super) geoms: Vec<Geom<f64>>,
    pub(super) sites: Vec<Site<f64>>,
    /// Where each body stands in the text.
    places: Vec<Place>,
}

/// What an element stands in.
#[derive(Clone, Copy)]
pub(super) struct Scope<'a> {
    pub(super) body: usize,
    /// The class of elements that name none.
    pub(super) class: Option<&'a str>,
    /// Whether an `<inertial>` says what the body weighs, whatever geoms it has.
    pub(super) weighed: bool,
    /// The frame that positions are given in: its place and orientation in the body's.
    pos: Vec3<f64>,
    quat: Quat<f64>,
}

impl Scope<'_> {
    fn of(body: usize) -> Self {
        Self { body, class: None, weighed: false, pos: Vec3::ZERO, quat: Quat::IDENTITY }
    }

    /// A direction in the body's frame.
    pub(super) fn turned(&self, direction: Vec3<f64>) -> Vec3<f64> {
        self.quat.matrix().apply(direction)
    }

    /// A place in the body's frame.
    pub(super) fn placed(&self, pos: Vec3<f64>) -> Vec3<f64> {
        self.pos + self.turned(pos)
    }

    /// An orientation in the body's frame.
    pub(super) fn oriented(&self, quat: Quat<f64>) -> Quat<f64> {
        self.quat.product(quat)
    }
}

/// What gives a body its mass.
#[derive(Default)]
struct Masses {
    inertial: Option<MassProperties>,
    geoms: Vec<MassProperties>,
}

impl<'a> Tree<'a> {
    /// Reads all `<worldbody>` in `root`.
    pub(super) fn read(root: &'a Element, reader: &'a Reader<'a>) -> Self {
        let world = Body {
            name: "world".into(),
            named: true,
            parent: 0,
            pos: Vec3::ZERO,
            quat: Quat::IDENTITY,
            mass: 0.0,
            inertia: Vec3::ZERO,
            com: Vec3::ZERO,
            principal: Quat::IDENTITY,
            gravity_compensation: 0.0,
        };
        let mut tree = Self {
            reader,
            bodies: vec![world],
            joints: Vec::new(),
            geoms: Vec::new(),
            sites: Vec::new(),
            places: vec![root.place.clone()],
        };
        for world in root.all("worldbody") {
            let scope = Scope::of(0);
            tree.add_content(world, scope, &mut Masses::default());
            tree.add_bodies(world, scope);
        }
        tree
    }

    fn add_body(&mut self, element: &'a Element, scope: Scope<'a>) {
        let attributes = Attributes::new(element, None, self.reader.refusals);
        let (name, named) =
            attributes.name("body", element.ordinal, self.bodies.iter().map(|body| &body.name));
        let index = self.bodies.len();
        self.places.push(element.place.clone());
        self.bodies.push(Body {
            name,
            named,
            parent: scope.body,
            pos: scope.placed(attributes.vector("pos").unwrap_or(Vec3::ZERO)),
            quat: scope.oriented(attributes.orientation(&self.reader.compiler.angles)),
            gravity_compensation: attributes.number("gravcomp", 0.0),
            ..self.bodies[0].clone()
        });
        let from_geoms = self.reader.compiler.inertia_from_geoms;
        let scope = Scope {
            class: element.attribute("childclass").or(scope.class),
            weighed: from_geoms == Some(false)
                || (from_geoms.is_none() && element.all("inertial").next().is_some()),
            ..Scope::of(index)
        };
        let mut masses = Masses::default();
        self.add_content(element, scope, &mut masses);
        let MassProperties { mass, com, inertia, principal } = match masses.inertial {
            Some(inertial) if from_geoms != Some(true) => inertial,
            _ if from_geoms == Some(false) => shape::combine(&[]),
            _ => shape::combine(&masses.geoms),
        };
        let body = &mut self.bodies[index];
        (body.mass, body.com, body.inertia, body.principal) = (mass, com, inertia, principal);
        self.add_bodies(element, scope);
    }

    /// What is fixed to a body itself.
    fn add_content(&mut self, element: &'a Element, scope: Scope<'a>, masses: &mut Masses) {
        for child in &element.children {
            match child.tag.as_str() {
                "body" | "light" | "camera" => {}
                "joint" | "freejoint" if scope.body != 0 => self.add_joint(child, scope),
                "geom" => masses.geoms.extend(self.add_geom(child, scope)),
                "frame" => {
                    let scope = self.framed(child, scope);
                    self.add_content(child, scope, masses);
                }
                "site" => self.add_site(child, scope),
                "inertial" if element.tag == "body" => masses.inertial = self.inertial(child),
                _ => child.refuse(self.reader.refusals),
            }
        }
    }

    /// The bodies that it carries.
    fn add_bodies(&mut self, element: &'a Element, scope: Scope<'a>) {
        for child in &element.children {
            match child.tag.as_str() {
                "body" => self.add_body(child, scope),
                "frame" => self.add_bodies(child, self.framed(child, scope)),
                _ => {}
            }
        }
    }

    /// What stands in a `<frame>` of `scope`.
    fn framed(&self, frame: &'a Element, scope: Scope<'a>) -> Scope<'a> {
        let attributes = Attributes::new(frame, None, self.reader.refusals);
        Scope {
            class: attributes.text("childclass").or(scope.class),
            pos: scope.placed(attributes.vector("pos").unwrap_or(Vec3::ZERO)),
            quat: scope.oriented(attributes.orientation(&self.reader.compiler.angles)),
            ..scope
        }
    }

    fn inertial(&self, element: &'a Element) -> Option<MassProperties> {
        let attributes = Attributes::new(element, None, self.reader.refusals);
        attributes.needed("pos");
        attributes.needed("mass");
        let com = attributes.vector("pos").unwrap_or(Vec3::ZERO);
        let mass = attributes.not_negative("mass", 0.0);
        let (which, inertia, principal) = match attributes.array::<6>("fullinertia") {
            Some(full) => {
                let (inertia, principal) = shape::principal_axes(Sym3(full));
                ("fullinertia", inertia, principal)
            }
            None => {
                attributes.needed("diaginertia");
                let principal = attributes.orientation(&self.reader.compiler.angles);
                ("diaginertia", attributes.vector("diaginertia")?, principal)
            }
        };
        let [a, b, c] = inertia.0;
        let largest = a.max(b).max(c);
        // the largest may exceed the others' sum by rounding only
        if [a, b, c].iter().any(|moment| *moment < 0.0) || 2.0 * largest > (a + b + c) * (1.0 + 1e-9) {
            let wanted = "moments of a real body: none negative, none above the sum of the other two";
            attributes.invalid(which, wanted);
        }
        Some(MassProperties { mass, com, inertia, principal })
    }

    fn add_site(&mut self, element: &'a Element, scope: Scope<'a>) {
        let attributes = self.reader.attributes(element, scope.class);
        let (name, named) =
            attributes.name("site", element.ordinal, self.sites.iter().map(|site| &site.name));
        let pos = match attributes.array::<6>("fromto") {
            Some([a, b, c, d, e, f]) => Vec3([a + d, b + e, c + f]) * 0.5,
            None => attributes.vector("pos").unwrap_or(Vec3::ZERO),
        };
        self.sites.push(Site { name, named, body: scope.body, pos: scope.placed(pos) });
    }

    /// A body that moves must weigh something, itself or through what is fixed to it.
    pub(super) fn check_masses(&self) {
        let jointed = |body: usize| self.joints.iter().any(|joint| joint.body == body);
        let mut heavy: Vec<bool> = self
            .bodies
            .iter()
            .map(|body| {
                body.mass > MASS_AND_INERTIA_MIN && body.inertia.0.iter().all(|i| *i > MASS_AND_INERTIA_MIN)
            })
            .collect();
        for index in (1..self.bodies.len()).rev() {
            if heavy[index] && !jointed(index) {
                heavy[self.bodies[index].parent] = true;
            }
        }
        for index in (1..self.bodies.len()).filter(|&index| jointed(index) && !heavy[index]) {
            let problem = format!(
                "<body> \"{}\" moves but has no mass or inertia; give it a geom or an <inertial>",
                self.bodies[index].name
            );
            self.reader.refusals.add(&self.places[index], problem);
        }
    }
}
