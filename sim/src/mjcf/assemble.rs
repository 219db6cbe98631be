//! A whole document to a model.

use std::collections::HashMap;

use roxmltree::{Document, Node, NodeId};

use super::attributes::{Attributes, line, refused};
use super::body::Tree;
use super::compiler::{Compiler, compiler};
use super::defaults::Defaults;
use super::error::MjcfError;
use super::write::{BEFORE_3_14, LIFT};
use crate::causes::Cause;
use crate::math::Vec3;
use crate::model::{Actuator, ActuatorKind, Cone, Contacts, Integrator, KuttaLift, Model, Settings};

/// Sections that have no effect on what is simulated.
const IGNORED_SECTIONS: [&str; 7] = ["size", "visual", "statistic", "asset", "custom", "sensor", "keyframe"];
/// Sections that are refused unless empty.
const REFUSED_SECTIONS: [&str; 4] = ["equality", "tendon", "deformable", "extension"];
/// MuJoCo's default gravity \[m/s2\].
const DEFAULT_GRAVITY_M_PER_S2: [f64; 3] = [0.0, 0.0, -9.81];

pub(super) fn model(document: &Document<'_>) -> Result<Model<f64>, MjcfError> {
    let root = document.root_element();
    if !root.has_tag_name("mujoco") {
        return Err(refused(root));
    }
    for section in root.children().filter(Node::is_element) {
        match section.tag_name().name() {
            "compiler" | "option" | "default" | "worldbody" | "contact" | "actuator" => {}
            name if IGNORED_SECTIONS.contains(&name) => {}
            name if REFUSED_SECTIONS.contains(&name) => {
                if let Some(content) = section.first_element_child() {
                    return Err(refused(content));
                }
            }
            _ => return Err(refused(section)),
        }
    }
    let sections = |name: &'static str| root.children().filter(move |node| node.has_tag_name(name));
    let compiler = compiler(sections("compiler"))?;
    let (settings, contacts_on) = settings(sections("option"))?;
    let defaults = Defaults::read(root)?;

    let mut tree = Tree::new(&defaults, &compiler, places(root));
    for world in sections("worldbody") {
        tree.add_world(world)?;
    }
    tree.check_masses()?;
    let mut model = Model {
        name: root.attribute("model").unwrap_or("MuJoCo Model").into(),
        settings,
        bodies: tree.bodies,
        joints: tree.joints,
        geoms: tree.geoms,
        sites: tree.sites,
        actuators: Vec::new(),
        contacts: Contacts::default(),
        causes: Vec::new(),
        encoders: Vec::new(),
        own: Vec::new(),
        foreign: Vec::new(),
    };
    for node in sections("actuator").flat_map(|section| section.children()).filter(Node::is_element) {
        let actuator = actuator(node, &defaults, &compiler, &model)?;
        model.actuators.push(actuator);
    }
    let mut excluded = Vec::new();
    for node in sections("contact").flat_map(|section| section.children()).filter(Node::is_element) {
        excluded.push(exclusion(node, &model)?);
    }
    model.contacts = Contacts::new(&model, !contacts_on, excluded);
    for node in sections("custom").flat_map(|section| section.children()) {
        if node.has_tag_name("numeric") {
            cause(node, &mut model)?;
        } else if node.has_tag_name("text") && node.attribute("name") == Some(LIFT) {
            model.settings.kutta_lift = match node.attribute("data") {
                Some(BEFORE_3_14) => KuttaLift::Clamped,
                other => {
                    return Err(MjcfError::Value {
                        line: line(node),
                        element: "text".into(),
                        attribute: "data".into(),
                        value: other.unwrap_or_default().into(),
                        wanted: BEFORE_3_14.into(),
                    });
                }
            };
        }
    }
    Ok(model)
}

/// Each element's place among those of its kind, by which the unnamed ones are called.
fn places(root: Node<'_, '_>) -> HashMap<NodeId, usize> {
    let mut counts: HashMap<&str, usize> = HashMap::new();
    let mut places = HashMap::new();
    for node in root.descendants() {
        let kind = match node.tag_name().name() {
            "freejoint" => "joint",
            kind @ ("body" | "joint" | "geom" | "site") => kind,
            _ => continue,
        };
        if node.ancestors().any(|ancestor| ancestor.has_tag_name("worldbody")) {
            let count = counts.entry(kind).or_default();
            places.insert(node.id(), *count);
            *count += 1;
        }
    }
    places
}

/// The settings, and whether contact is on.
fn settings<'a, 'i: 'a>(
    sections: impl Iterator<Item = Node<'a, 'i>>,
) -> Result<(Settings<f64>, bool), MjcfError> {
    let mut contact = true;
    let mut settings = Settings {
        timestep_s: 0.002,
        integrator: Integrator::Euler,
        gravity: Vec3(DEFAULT_GRAVITY_M_PER_S2),
        density: 0.0,
        viscosity: 0.0,
        wind: Vec3::ZERO,
        kutta_lift: KuttaLift::Whole,
        cone: Cone::default(),
        impratio: 1.0,
    };
    for node in sections {
        let attributes = Attributes::new(node, None)?;
        settings.timestep_s = attributes.number("timestep", settings.timestep_s)?;
        if settings.timestep_s <= 0.0 {
            return Err(attributes.invalid("timestep", "above 0"));
        }
        const INTEGRATORS: [(&str, Integrator); 3] = [
            ("Euler", Integrator::Euler),
            ("RK4", Integrator::Rk4),
            ("implicitfast", Integrator::ImplicitFast),
        ];
        settings.integrator = attributes.one_of("integrator", &INTEGRATORS, settings.integrator)?;
        settings.gravity = attributes.vector("gravity")?.unwrap_or(settings.gravity);
        settings.density = attributes.not_negative("density", settings.density)?;
        settings.viscosity = attributes.not_negative("viscosity", settings.viscosity)?;
        settings.wind = attributes.vector("wind")?.unwrap_or(settings.wind);
        const CONES: [(&str, Cone); 2] = [("pyramidal", Cone::Pyramidal), ("elliptic", Cone::Elliptic)];
        settings.cone = attributes.one_of("cone", &CONES, settings.cone)?;
        settings.impratio = attributes.number("impratio", settings.impratio)?;
        if settings.impratio <= 0.0 {
            return Err(attributes.invalid("impratio", "above 0"));
        }
        for child in node.children().filter(Node::is_element) {
            if !child.has_tag_name("flag") {
                return Err(refused(child));
            }
            let flags = Attributes::new(child, None)?;
            contact = flags.one_of("contact", &[("enable", true), ("disable", false)], contact)?;
        }
    }
    Ok((settings, contact))
}

fn actuator<'a>(
    node: Node<'a, '_>,
    defaults: &Defaults<'a>,
    compiler: &Compiler,
    model: &Model<f64>,
) -> Result<Actuator<f64>, MjcfError> {
    let kind = match node.tag_name().name() {
        "position" => ActuatorKind::Position,
        "velocity" => ActuatorKind::Velocity,
        "motor" => ActuatorKind::Motor,
        _ => return Err(refused(node)),
    };
    let attributes = Attributes::new(node, defaults.of(node, None)?)?;
    let place = model.actuators.len();
    let named = attributes.text("name");
    let name = named.map_or_else(|| format!("actuator#{place}"), str::to_owned);
    if model.actuators.iter().any(|other| other.name == name) {
        return Err(MjcfError::Duplicate { line: line(node), element: attributes.tag.into(), name });
    }
    let joint_name = attributes.text("joint").ok_or_else(|| attributes.missing("joint"))?;
    let joint = model
        .joints
        .iter()
        .position(|joint| joint.name == joint_name)
        .ok_or_else(|| attributes.invalid("joint", "the name of a joint"))?;
    if !model.joints[joint].kind.is_axle() {
        return Err(attributes.invalid("joint", "a hinge or a slide"));
    }
    let (kp, kv) = match kind {
        ActuatorKind::Position => (attributes.not_negative("kp", 1.0)?, attributes.not_negative("kv", 0.0)?),
        ActuatorKind::Velocity => (0.0, attributes.not_negative("kv", 1.0)?),
        ActuatorKind::Motor => (0.0, 0.0),
    };
    let stray = match kind {
        ActuatorKind::Position => None,
        ActuatorKind::Velocity => Some("kp"),
        ActuatorKind::Motor => ["kp", "kv"].into_iter().find(|name| attributes.text(name).is_some()),
    };
    if let Some(stray) = stray.filter(|name| attributes.text(name).is_some()) {
        return Err(attributes.invalid(stray, format!("absent from a {}", attributes.tag)));
    }
    // only the first of up to six acts on a hinge or slide
    let gear = attributes.list("gear", 1, 6)?.map_or(1.0, |gear| gear[0]);
    Ok(Actuator {
        name,
        named: named.is_some(),
        kind,
        joint,
        kp,
        kv,
        gear,
        command_range: attributes.limited_range("ctrlrange", "ctrllimited", compiler.autolimits)?,
        force_range: attributes.limited_range("forcerange", "forcelimited", compiler.autolimits)?,
    })
}

/// A number called `<cause>/<parameter>` adds the cause; any other is somebody else's, or of a cause that is yet to be written down.
fn cause(node: Node<'_, '_>, model: &mut Model<f64>) -> Result<(), MjcfError> {
    let name = node.attribute("name").unwrap_or_default();
    let text = node.attribute("data").unwrap_or_default();
    let Some(cause) = name.split_once('/').and_then(|(cause, _)| cause.parse::<Cause>().ok()) else {
        if let Some(number) = text.trim().parse::<f64>().ok().filter(|x| x.is_finite() && name.contains('/'))
        {
            model.foreign.push((name.to_owned(), number));
        }
        return Ok(());
    };
    let invalid = |attribute: &str, value: &str, wanted: String| MjcfError::Value {
        line: line(node),
        element: "numeric".into(),
        attribute: attribute.into(),
        value: value.into(),
        wanted,
    };
    let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    let number = number.ok_or_else(|| invalid("data", text, "one finite number".into()))?;
    let carried = model.carry(cause);
    let known = carried.names().join(", ");
    let place = carried.names().iter().position(|known| known == name);
    let place = place.ok_or_else(|| invalid("name", name, format!("one of {known}")))?;
    *carried.value_mut(place) = number;
    Ok(())
}

/// The two bodies of an `<exclude>`; a `<pair>` asks for contact and is refused.
fn exclusion(node: Node<'_, '_>, model: &Model<f64>) -> Result<[usize; 2], MjcfError> {
    if !node.has_tag_name("exclude") {
        return Err(refused(node));
    }
    let attributes = Attributes::new(node, None)?;
    let body = |which: &str| {
        let name = attributes.text(which).ok_or_else(|| attributes.missing(which))?;
        model
            .bodies
            .iter()
            .position(|body| body.name == name)
            .ok_or_else(|| attributes.invalid(which, "the name of a body"))
    };
    Ok([body("body1")?, body("body2")?])
}
