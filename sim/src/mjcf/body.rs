//! The body tree.

use std::collections::HashMap;

use roxmltree::{Node, NodeId};

use super::attributes::{Attributes, from_z, line, refused};
use super::compiler::Compiler;
use super::defaults::Defaults;
use super::error::MjcfError;
use crate::math::{Quat, Sym3, Vec3};
use crate::model::shape::{self, MassProperties};
use crate::model::{Body, FluidCoefficients, Geom, GeomKind, Joint, JointKind, Site, Surface};

/// MuJoCo's density where a geom states none \[kg/m3\].
const DEFAULT_DENSITY_KG_PER_M3: f64 = 1000.0;
/// MuJoCo's coefficients where a geom states none.
const DEFAULT_FLUID_COEFFICIENTS: [f64; 5] = [0.5, 0.25, 1.5, 1.0, 1.0];
/// Least mass \[kg\] and moment \[kg m2\] of a body that moves, as in MuJoCo.
const MASS_AND_INERTIA_MIN: f64 = 1e-15;

/// The tree as far as it is read.
pub(super) struct Tree<'a, 'd> {
    defaults: &'d Defaults<'a>,
    compiler: &'d Compiler,
    places: HashMap<NodeId, usize>,
    pub(super) bodies: Vec<Body<f64>>,
    pub(super) joints: Vec<Joint<f64>>,
    pub(super) geoms: Vec<Geom<f64>>,
    pub(super) sites: Vec<Site<f64>>,
    /// Where each body stands in the text.
    lines: Vec<u32>,
    next_q: usize,
    next_dof: usize,
}

impl<'a, 'd> Tree<'a, 'd> {
    pub(super) fn new(
        defaults: &'d Defaults<'a>,
        compiler: &'d Compiler,
        places: HashMap<NodeId, usize>,
    ) -> Self {
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
        Self {
            defaults,
            compiler,
            places,
            bodies: vec![world],
            joints: Vec::new(),
            geoms: Vec::new(),
            sites: Vec::new(),
            lines: vec![0],
            next_q: 0,
            next_dof: 0,
        }
    }

    /// The element's name, or its kind and place; refused when taken.
    fn name(&self, node: Node<'a, '_>, kind: &str) -> Result<(String, bool), MjcfError> {
        let Some(name) = node.attribute("name").filter(|name| !name.is_empty()) else {
            let place = self.places.get(&node.id()).copied().unwrap_or_default();
            return Ok((format!("{kind}#{place}"), false));
        };
        let taken = match kind {
            "body" => self.bodies.iter().any(|body| body.name == name),
            "joint" => self.joints.iter().any(|joint| joint.name == name),
            "geom" => self.geoms.iter().any(|geom| geom.name == name),
            _ => self.sites.iter().any(|site| site.name == name),
        };
        if taken {
            return Err(MjcfError::Duplicate { line: line(node), element: kind.into(), name: name.into() });
        }
        Ok((name.into(), true))
    }

    fn attributes(&self, node: Node<'a, '_>, class: Option<&'a str>) -> Result<Attributes<'a>, MjcfError> {
        Attributes::new(node, self.defaults.of(node, class)?)
    }

    /// Reads a `<worldbody>`.
    pub(super) fn add_world(&mut self, node: Node<'a, '_>) -> Result<(), MjcfError> {
        self.add_content(node, 0, None)
    }

    fn add_body(
        &mut self,
        node: Node<'a, '_>,
        parent: usize,
        class: Option<&'a str>,
    ) -> Result<(), MjcfError> {
        let attributes = Attributes::new(node, None)?;
        let (name, named) = self.name(node, "body")?;
        let index = self.bodies.len();
        self.lines.push(line(node));
        self.bodies.push(Body {
            name,
            named,
            parent,
            pos: attributes.vector("pos")?.unwrap_or(Vec3::ZERO),
            quat: attributes.orientation(&self.compiler.angles)?,
            gravity_compensation: attributes.number("gravcomp", 0.0)?,
            ..self.bodies[0].clone()
        });
        self.add_content(node, index, node.attribute("childclass").or(class))
    }

    /// Everything in a body: what is fixed to it first, then the bodies it carries.
    fn add_content(
        &mut self,
        node: Node<'a, '_>,
        body: usize,
        class: Option<&'a str>,
    ) -> Result<(), MjcfError> {
        let mut inertial = None;
        let mut parts = Vec::new();
        for child in node.children().filter(Node::is_element) {
            match child.tag_name().name() {
                "body" | "light" | "camera" => {}
                "joint" | "freejoint" if body != 0 => self.add_joint(child, body, class)?,
                "geom" => parts.extend(self.add_geom(child, body, class)?),
                "site" => self.add_site(child, body, class)?,
                "inertial" if body != 0 => inertial = Some(self.inertial(child)?),
                _ => return Err(refused(child)),
            }
        }
        if body != 0 {
            let from_geoms = self.compiler.inertia_from_geoms;
            let properties = match inertial {
                Some(inertial) if from_geoms != Some(true) => inertial,
                _ if from_geoms == Some(false) => shape::combine(&[]),
                _ => shape::combine(&parts),
            };
            let body = &mut self.bodies[body];
            body.mass = properties.mass;
            body.com = properties.com;
            body.inertia = properties.inertia;
            body.principal = properties.principal;
        }
        for child in node.children().filter(|child| child.has_tag_name("body")) {
            self.add_body(child, body, class)?;
        }
        Ok(())
    }

    fn inertial(&self, node: Node<'a, '_>) -> Result<MassProperties, MjcfError> {
        let attributes = Attributes::new(node, None)?;
        let com = attributes.vector("pos")?.ok_or_else(|| attributes.missing("pos"))?;
        if attributes.text("mass").is_none() {
            return Err(attributes.missing("mass"));
        }
        let mass = attributes.not_negative("mass", 0.0)?;
        let (which, inertia, principal) = match attributes.array::<6>("fullinertia")? {
            Some(full) => {
                let (inertia, principal) = shape::principal_axes(Sym3(full));
                ("fullinertia", inertia, principal)
            }
            None => {
                let diagonal =
                    attributes.vector("diaginertia")?.ok_or_else(|| attributes.missing("diaginertia"))?;
                ("diaginertia", diagonal, attributes.orientation(&self.compiler.angles)?)
            }
        };
        let [a, b, c] = inertia.0;
        let largest = a.max(b).max(c);
        // the largest may exceed the others' sum by rounding only
        if [a, b, c].iter().any(|moment| *moment < 0.0) || 2.0 * largest > (a + b + c) * (1.0 + 1e-9) {
            let wanted = "moments of a real body: none negative, none above the sum of the other two";
            return Err(attributes.invalid(which, wanted));
        }
        Ok(MassProperties { mass, com, inertia, principal })
    }

    fn add_joint(
        &mut self,
        node: Node<'a, '_>,
        body: usize,
        class: Option<&'a str>,
    ) -> Result<(), MjcfError> {
        let attributes = self.attributes(node, class)?;
        let (name, named) = self.name(node, "joint")?;
        let kind = if node.has_tag_name("freejoint") {
            JointKind::Free
        } else {
            attributes.one_of("type", &JointKind::NAMED, JointKind::Hinge)?
        };
        let earlier: Vec<JointKind> =
            self.joints.iter().filter(|joint| joint.body == body).map(|joint| joint.kind).collect();
        if earlier.contains(&JointKind::Free) || (kind == JointKind::Free && !earlier.is_empty()) {
            return Err(
                attributes.inconsistent(&name, "shares its body with a free joint, which must be alone")
            );
        }
        if kind == JointKind::Free && self.bodies[body].parent != 0 {
            return Err(attributes.inconsistent(&name, "is free, but its body is not a child of the world"));
        }
        if earlier.contains(&JointKind::Ball) && kind != JointKind::Slide {
            return Err(
                attributes.inconsistent(&name, "turns a body after its ball joint; put it on a body between")
            );
        }
        let angles = &self.compiler.angles;
        let in_radians = |x: f64| if kind == JointKind::Hinge { angles.radians(x) } else { x };
        let single = kind.is_axle();
        let limit = attributes.limited_range("range", "limited", self.compiler.autolimits)?;
        if limit.is_some() && !single {
            return Err(
                attributes.invalid("range", "absent: end stops are supported on hinges and slides only")
            );
        }
        let (stiffness, damping) = (attributes.up_to_three("stiffness")?, attributes.up_to_three("damping")?);
        for (of, [_, second, third]) in [("stiffness", stiffness), ("damping", damping)] {
            if !single && (second != 0.0 || third != 0.0) {
                return Err(attributes.invalid(of, "one number on a ball or free joint"));
            }
        }
        let axis = attributes.vector("axis")?.unwrap_or(Vec3([0.0, 0.0, 1.0]));
        if single && axis.norm() < 1e-14 {
            return Err(attributes.invalid("axis", "of nonzero length"));
        }
        self.joints.push(Joint {
            name,
            named,
            kind,
            body,
            qpos_address: self.next_q,
            dof_address: self.next_dof,
            pos: if kind == JointKind::Free {
                Vec3::ZERO
            } else {
                attributes.vector("pos")?.unwrap_or(Vec3::ZERO)
            },
            axis: if single { axis * (1.0 / axis.norm()) } else { Vec3([0.0, 0.0, 1.0]) },
            reference: if single { in_radians(attributes.number("ref", 0.0)?) } else { 0.0 },
            spring_reference: if single { in_radians(attributes.number("springref", 0.0)?) } else { 0.0 },
            stiffness,
            damping,
            armature: attributes.not_negative("armature", 0.0)?,
            friction_loss: attributes.not_negative("frictionloss", 0.0)?,
            limit: limit.map(|range| range.map(in_radians)),
        });
        self.next_q += kind.nq();
        self.next_dof += kind.nv();
        Ok(())
    }

    /// Adds the geom; its mass properties where it has any.
    fn add_geom(
        &mut self,
        node: Node<'a, '_>,
        body: usize,
        class: Option<&'a str>,
    ) -> Result<Option<MassProperties>, MjcfError> {
        let attributes = self.attributes(node, class)?;
        let (name, named) = self.name(node, "geom")?;
        let kinds = [
            ("sphere", GeomKind::Sphere),
            ("capsule", GeomKind::Capsule),
            ("cylinder", GeomKind::Cylinder),
            ("ellipsoid", GeomKind::Ellipsoid),
            ("box", GeomKind::Box),
            ("plane", GeomKind::Plane),
        ];
        let kind = attributes.one_of("type", &kinds, GeomKind::Sphere)?;
        let (mut pos, mut quat) =
            (attributes.vector("pos")?.unwrap_or(Vec3::ZERO), attributes.orientation(&self.compiler.angles)?);
        let mut size = attributes.up_to_three("size")?;
        if let Some([a, b, c, d, e, f]) = attributes.array::<6>("fromto")? {
            let (from, to) = (Vec3([a, b, c]), Vec3([d, e, f]));
            let along = from - to;
            let length = along.norm();
            match kind {
                GeomKind::Capsule | GeomKind::Cylinder => size[1] = length / 2.0,
                GeomKind::Ellipsoid | GeomKind::Box => size = [size[0], size[0], length / 2.0],
                GeomKind::Sphere | GeomKind::Plane => {
                    return Err(attributes.invalid("fromto", "absent from a sphere or plane"));
                }
            }
            if length < 1e-14 {
                return Err(attributes.invalid("fromto", "two points apart"));
            }
            pos = (from + to) * 0.5;
            quat = from_z(along * (1.0 / length));
        }
        let used = match kind {
            GeomKind::Sphere => 1,
            GeomKind::Capsule | GeomKind::Cylinder => 2,
            GeomKind::Ellipsoid | GeomKind::Box => 3,
            GeomKind::Plane => 0,
        };
        if size[..used].iter().any(|size| *size <= 0.0) {
            return Err(attributes.invalid("size", format!("{used} numbers above 0")));
        }
        size[used..].fill(0.0);
        if kind == GeomKind::Plane && body != 0 {
            return Err(attributes.inconsistent(&name, "is a plane on a body; planes belong to the world"));
        }
        let ellipsoid = attributes.one_of("fluidshape", &[("none", false), ("ellipsoid", true)], false)?;
        // MuJoCo takes the first of fewer than five and leaves the others at their defaults
        let given = attributes.list("fluidcoef", 1, 5)?.unwrap_or_default();
        let coefficient = |i: usize| given.get(i).copied().unwrap_or(DEFAULT_FLUID_COEFFICIENTS[i]);
        let bits = |name: &str| {
            attributes
                .text(name)
                .map_or(Some(1), |text| text.trim().parse::<u32>().ok())
                .ok_or_else(|| attributes.invalid(name, "a whole number of 0 or more"))
        };
        self.geoms.push(Geom {
            name,
            named,
            body,
            kind,
            size,
            pos,
            quat,
            fluid: (ellipsoid && body != 0).then(|| FluidCoefficients {
                blunt: coefficient(0),
                slender: coefficient(1),
                angular: coefficient(2),
                kutta: coefficient(3),
                magnus: coefficient(4),
            }),
            contact_bits: [bits("contype")?, bits("conaffinity")?],
            contact_margin_m: attributes.not_negative("margin", 0.0)?,
            surface: surface(&attributes)?,
        });
        if body == 0 || kind == GeomKind::Plane {
            return Ok(None);
        }
        let by_density =
            attributes.not_negative("density", DEFAULT_DENSITY_KG_PER_M3)? * shape::volume(kind, size);
        let mass = attributes.not_negative("mass", by_density)?;
        Ok((mass > 0.0).then(|| MassProperties {
            mass,
            com: pos,
            inertia: shape::inertia(kind, size, mass),
            principal: quat,
        }))
    }

    fn add_site(&mut self, node: Node<'a, '_>, body: usize, class: Option<&'a str>) -> Result<(), MjcfError> {
        let attributes = self.attributes(node, class)?;
        let (name, named) = self.name(node, "site")?;
        let pos = match attributes.array::<6>("fromto")? {
            Some([a, b, c, d, e, f]) => Vec3([a + d, b + e, c + f]) * 0.5,
            None => attributes.vector("pos")?.unwrap_or(Vec3::ZERO),
        };
        self.sites.push(Site { name, named, body, pos });
        Ok(())
    }

    /// A body that moves must weigh something, itself or through what is fixed to it.
    pub(super) fn check_masses(&self) -> Result<(), MjcfError> {
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
        match (1..self.bodies.len()).find(|&index| jointed(index) && !heavy[index]) {
            None => Ok(()),
            Some(index) => Err(MjcfError::Inconsistent {
                line: self.lines[index],
                element: "body".into(),
                name: self.bodies[index].name.clone(),
                problem: "moves but has no mass or inertia; give it a geom or an <inertial>".into(),
            }),
        }
    }
}

/// What a geom brings to its contacts.
fn surface(attributes: &Attributes<'_>) -> Result<Surface, MjcfError> {
    let usual = Surface::default();
    // MuJoCo takes the first of fewer and leaves the others at their defaults
    let friction = attributes.first_of("friction", usual.friction)?;
    let solref = attributes.first_of("solref", usual.solref)?;
    if (solref[0] > 0.0) != (solref[1] > 0.0) {
        return Err(attributes.invalid("solref", "two numbers above 0, or two that are not"));
    }
    if friction.iter().any(|friction| *friction < 0.0) {
        return Err(attributes.invalid("friction", "up to three numbers, none below 0"));
    }
    const CONDIMS: [(&str, usize); 4] = [("1", 1), ("3", 3), ("4", 4), ("6", 6)];
    let priority = attributes.text("priority").map_or(Some(0), |text| text.trim().parse().ok());
    Ok(Surface {
        priority: priority.ok_or_else(|| attributes.invalid("priority", "a whole number"))?,
        condim: attributes.one_of("condim", &CONDIMS, usual.condim)?,
        friction,
        solmix: attributes.not_negative("solmix", usual.solmix)?,
        solref,
        solimp: attributes.first_of("solimp", usual.solimp)?,
        gap_m: attributes.not_negative("gap", 0.0)?,
    })
}
