//! `<option>`: time step, integrator, gravity, water, contact.

use super::attributes::Attributes;
use super::element::Element;
use super::error::Refusals;
use crate::math::Vec3;
use crate::model::{Cone, Integrator, KuttaLift, Settings};

/// MuJoCo's default gravity \[m/s2\].
const DEFAULT_GRAVITY_M_PER_S2: [f64; 3] = [0.0, 0.0, -9.81];

/// What `<option>` says.
pub(super) struct Options {
    pub(super) settings: Settings<f64>,
    /// Which constraints there are.
    pub(super) contact: bool,
    pub(super) equality: bool,
    pub(super) friction_loss: bool,
    pub(super) limit: bool,
    /// Whether commands stay in their ranges.
    pub(super) clamp_commands: bool,
}

impl Options {
    /// Reads the `<option>` elements.
    pub(super) fn read(root: &Element, refusals: &Refusals) -> Self {
        let mut gravity = true;
        let settings = Settings {
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
        let mut options = Self {
            settings,
            contact: true,
            equality: true,
            friction_loss: true,
            limit: true,
            clamp_commands: true,
        };
        for element in root.all("option") {
            let attributes = Attributes::new(element, None, refusals);
            let settings = &mut options.settings;
            settings.timestep_s = attributes.positive("timestep", settings.timestep_s);
            settings.integrator = attributes.one_of("integrator", &Integrator::NAMED, settings.integrator);
            settings.gravity = attributes.vector("gravity").unwrap_or(settings.gravity);
            settings.density = attributes.not_negative("density", settings.density);
            settings.viscosity = attributes.not_negative("viscosity", settings.viscosity);
            settings.wind = attributes.vector("wind").unwrap_or(settings.wind);
            const CONES: [(&str, Cone); 2] = [("pyramidal", Cone::Pyramidal), ("elliptic", Cone::Elliptic)];
            settings.cone = attributes.one_of("cone", &CONES, settings.cone);
            settings.impratio = attributes.positive("impratio", settings.impratio);
            for child in &element.children {
                if child.tag != "flag" {
                    child.refuse(refusals);
                    continue;
                }
                let flags = Attributes::new(child, None, refusals);
                let flag = |name, before: &mut bool| {
                    *before = flags.one_of(name, &[("enable", true), ("disable", false)], *before);
                };
                let mut constraint = true;
                flag("gravity", &mut gravity);
                flag("constraint", &mut constraint);
                flag("contact", &mut options.contact);
                flag("equality", &mut options.equality);
                flag("frictionloss", &mut options.friction_loss);
                flag("limit", &mut options.limit);
                flag("clampctrl", &mut options.clamp_commands);
                options.contact &= constraint;
                options.equality &= constraint;
                options.friction_loss &= constraint;
                options.limit &= constraint;
            }
        }
        if !gravity {
            options.settings.gravity = Vec3::ZERO;
        }
        options
    }
}
