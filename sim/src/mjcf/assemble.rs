//! A whole document to a model.

use super::Reader;
use super::attributes::Attributes;
use super::body::Tree;
use super::compiler::Compiler;
use super::defaults::Defaults;
use super::element::Element;
use super::error::Refusals;
use super::option::Options;
use super::write::{BEFORE_3_14, LIFT};
use crate::causes::Cause;
use crate::model::{Contacts, KuttaLift, Model, Tendon};

/// Sections that have no effect on what is simulated.
const IGNORED_SECTIONS: [&str; 7] = ["size", "visual", "statistic", "asset", "custom", "sensor", "keyframe"];
/// Sections that are refused unless empty.
const REFUSED_SECTIONS: [&str; 2] = ["deformable", "extension"];

/// Reads what stands in `root`.
pub(super) fn model(root: &Element, compiler: Compiler, refusals: &Refusals) -> Option<Model<f64>> {
    match root.tag.as_str() {
        "mujoco" => {}
        "robot" => {
            let problem = "this is a URDF; MuJoCo makes MJCF of it, in Python: \
                mujoco.mj_saveLastXML(\"model.xml\", mujoco.MjModel.from_xml_path(\"model.urdf\"))";
            refusals.add(&root.place, problem);
            return None;
        }
        other => {
            refusals.add(&root.place, format!("this is no MJCF: its root is <{other}>, not <mujoco>"));
            return None;
        }
    }
    let defaults = Defaults::read(root, refusals);
    let reader = Reader { compiler, defaults, options: Options::read(root, refusals), refusals };
    let content = |section| root.all(section).flat_map(|section| &section.children);
    for section in &root.children {
        match section.tag.as_str() {
            "compiler" | "option" | "default" | "worldbody" | "contact" | "tendon" | "actuator" => {}
            "equality" => section.children.iter().for_each(|child| reader.pass_over_equality(child)),
            name if IGNORED_SECTIONS.contains(&name) => {}
            name if REFUSED_SECTIONS.contains(&name) => {
                // a skin only draws
                let moving = section.children.iter().filter(|child| child.tag != "skin");
                moving.for_each(|child| child.refuse(refusals));
            }
            _ => section.refuse(refusals),
        }
    }
    let mut tree = Tree::read(root, &reader);
    reader.compiler.weigh(&mut tree.bodies);
    if refusals.is_empty() {
        tree.check_masses();
    }
    let mut model = Model {
        name: root.attribute("model").unwrap_or("MuJoCo Model").into(),
        settings: reader.options.settings.clone(),
        bodies: tree.bodies,
        joints: tree.joints,
        geoms: tree.geoms,
        sites: tree.sites,
        tendons: Vec::new(),
        actuators: Vec::new(),
        contacts: Contacts::default(),
        causes: Vec::new(),
        encoders: Vec::new(),
        own: Vec::new(),
        foreign: Vec::new(),
    };
    for (place, element) in content("tendon").enumerate() {
        let tendon = reader.tendon(element, &model.joints, place);
        model.tendons.extend(tendon);
    }
    for element in content("actuator") {
        let actuator = reader.actuator(element, &model);
        model.actuators.extend(actuator);
    }
    // the actuators have what they need of the others
    model.tendons.retain(Tendon::pulls);
    let excluded = content("contact").filter_map(|element| exclusion(element, &model, refusals)).collect();
    model.contacts = Contacts::new(&model, !reader.options.contact, excluded);
    for element in content("custom") {
        match element.tag.as_str() {
            "numeric" => cause(element, &mut model, refusals),
            "text" if element.attribute("name") == Some(LIFT) => match element.attribute("data") {
                Some(BEFORE_3_14) => model.settings.kutta_lift = KuttaLift::Clamped,
                other => invalid(element, "data", other.unwrap_or_default(), BEFORE_3_14, refusals),
            },
            _ => {}
        }
    }
    Some(model)
}

fn invalid(element: &Element, attribute: &str, value: &str, wanted: &str, refusals: &Refusals) {
    let problem = format!("<{}> attribute {attribute}=\"{value}\" must be {wanted}", element.tag);
    refusals.add(&element.place, problem);
}

/// A number called `<cause>/<parameter>` adds the cause; any other is somebody else's, or of a cause that is yet to be written down.
fn cause(element: &Element, model: &mut Model<f64>, refusals: &Refusals) {
    let name = element.attribute("name").unwrap_or_default();
    let text = element.attribute("data").unwrap_or_default();
    let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    let Some(cause) = name.split_once('/').and_then(|(cause, _)| cause.parse::<Cause>().ok()) else {
        if let Some(number) = number.filter(|_| name.contains('/')) {
            model.foreign.push((name.to_owned(), number));
        }
        return;
    };
    let carried = model.carry(cause);
    let known = carried.names();
    match (known.iter().position(|known| known == name), number) {
        (Some(place), Some(number)) => *carried.value_mut(place) = number,
        (None, _) => invalid(element, "name", name, &format!("one of {}", known.join(", ")), refusals),
        (_, None) => invalid(element, "data", text, "one finite number", refusals),
    }
}

/// The two bodies of an `<exclude>`; a `<pair>` asks for contact and is refused.
fn exclusion(element: &Element, model: &Model<f64>, refusals: &Refusals) -> Option<[usize; 2]> {
    if element.tag != "exclude" {
        element.refuse(refusals);
        return None;
    }
    let attributes = Attributes::new(element, None, refusals);
    let body = |which| attributes.named(which, "body", model.bodies.iter().map(|body| &body.name));
    Some([body("body1")?, body("body2")?])
}
