//! A model back to MJCF.

use std::fmt::Write as _;

use crate::model::{ActuatorKind, Cone, GeomKind, Integrator, KuttaLift, Model, Softness, State, Surface};

/// The `<custom>` text that says which engines' Kutta lift a model has, and what it says.
pub(super) const LIFT: &str = "kutta_lift";
pub(super) const BEFORE_3_14: &str = "before-3.14";

/// For which engines an export moves the same way.
fn versions(model: &Model<f64>) -> &'static str {
    let rk4 = model.settings.integrator == Integrator::Rk4;
    let newest = rk4 && model.joints.iter().any(|joint| !joint.kind.is_axle());
    match (model.settings.kutta_lift, newest) {
        (KuttaLift::Whole, false) => {
            "Moves the same way in MuJoCo 3.14 and later; before that the Kutta lift of small shapes was lost."
        }
        (KuttaLift::Whole, true) => {
            "Moves the same way in MuJoCo 4.0 and later; before that RK4 turned ball and free joints to a lower order."
        }
        (KuttaLift::Clamped, false) => {
            "Moves the same way in MuJoCo before 3.14, where the Kutta lift of small shapes is lost."
        }
        (KuttaLift::Clamped, true) => {
            "Moves the same way in no MuJoCo: the Kutta lift is that before 3.14, RK4 of free turns that from 4.0 on."
        }
    }
}

struct Writer<'m> {
    model: &'m Model<f64>,
    out: String,
    children: Vec<Vec<usize>>,
}

/// The model as text. Numbers are written so that they read back to the same bits.
pub(super) fn model(model: &Model<f64>, comment: &str, starts: &[(&str, &State)]) -> String {
    let mut children = vec![Vec::new(); model.bodies.len()];
    for (index, body) in model.bodies.iter().enumerate().skip(1) {
        children[body.parent].push(index);
    }
    let mut writer = Writer { model, out: String::new(), children };
    writer.head(comment);
    writer.line(1, "worldbody", &[], false);
    writer.content(0, 2);
    writer.out.push_str("  </worldbody>\n");
    writer.exclusions();
    writer.tendons();
    writer.actuators();
    writer.causes();
    writer.keyframes(starts);
    writer.out.push_str("</mujoco>\n");
    writer.out
}

fn numbers(values: &[f64]) -> String {
    values.iter().map(|x| format!("{x:?}")).collect::<Vec<_>>().join(" ")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

/// `numbers`, without trailing zeros beyond the first.
fn polynomial([a, b, c]: [f64; 3]) -> String {
    match (b, c) {
        (0.0, 0.0) => numbers(&[a]),
        _ => numbers(&[a, b, c]),
    }
}

/// What the tendon of an actuator on several joints is called.
fn coupled(actuator: &str) -> String {
    format!("{actuator} joints")
}

/// One attribute to write.
type Attribute = (&'static str, String);

/// The attribute, unless it says the default.
fn unless(default: f64, name: &'static str, value: f64) -> Option<Attribute> {
    (value != default).then(|| (name, numbers(&[value])))
}

fn name(name: &str, named: bool) -> Option<Attribute> {
    named.then(|| ("name", escaped(name)))
}

fn range(name: &'static str, range: Option<[f64; 2]>) -> Option<Attribute> {
    range.map(|range| (name, numbers(&range)))
}

impl Writer<'_> {
    fn line(&mut self, depth: usize, tag: &str, attributes: &[Option<Attribute>], closed: bool) {
        let _ = write!(self.out, "{:width$}<{tag}", "", width = 2 * depth);
        for (name, value) in attributes.iter().flatten() {
            let _ = write!(self.out, " {name}=\"{value}\"");
        }
        self.out.push_str(if closed { "/>\n" } else { ">\n" });
    }

    fn head(&mut self, comment: &str) {
        let settings = &self.model.settings;
        let named = Integrator::NAMED.iter().find(|(_, integrator)| *integrator == settings.integrator);
        let integrator = named.map_or("", |(name, _)| name);
        // two hyphens would end the comment
        let comment = comment.replace("--", "- - ");
        let _ = writeln!(self.out, "<!-- {comment}\n     {} -->", versions(self.model));
        if !self.model.causes().is_empty() {
            let names: Vec<_> = self.model.causes().iter().map(|carried| carried.cause().name()).collect();
            let names = names.join(", ");
            let _ = writeln!(
                self.out,
                "<!-- Except for the causes under custom, which MuJoCo passes over: {names} -->"
            );
            let own = self.model.causes().iter().filter(|carried| carried.cause().is_own());
            for info in own.map(|carried| carried.cause().info()) {
                // no comment may hold two dashes in a row
                let formula = info.formula.replace("--", "- - ");
                let _ = writeln!(
                    self.out,
                    "<!-- {} is no cause that every reader knows; its numbers go with [[cause]] {formula} -->",
                    info.name
                );
            }
        }
        self.line(0, "mujoco", &[Some(("model", escaped(&self.model.name)))], false);
        let compiler = [Some(("angle", "radian".into())), Some(("autolimits", "true".into()))];
        self.line(1, "compiler", &compiler, true);
        let option = [
            Some(("timestep", numbers(&[settings.timestep_s]))),
            Some(("integrator", integrator.into())),
            Some(("gravity", numbers(&settings.gravity.0))),
            unless(0.0, "density", settings.density),
            unless(0.0, "viscosity", settings.viscosity),
            (settings.wind.0 != [0.0; 3]).then(|| ("wind", numbers(&settings.wind.0))),
            (settings.cone == Cone::Elliptic).then(|| ("cone", "elliptic".into())),
            unless(1.0, "impratio", settings.impratio),
        ];
        self.line(1, "option", &option, !self.model.contacts.off);
        if self.model.contacts.off {
            self.line(2, "flag", &[Some(("contact", "disable".into()))], true);
            self.out.push_str("  </option>\n");
        }
    }

    fn body(&mut self, index: usize, depth: usize) {
        let body = &self.model.bodies[index];
        let attributes = [
            name(&body.name, body.named),
            Some(("pos", numbers(&body.pos.0))),
            (body.quat.0 != [1.0, 0.0, 0.0, 0.0]).then(|| ("quat", numbers(&body.quat.0))),
            unless(0.0, "gravcomp", body.gravity_compensation),
        ];
        self.line(depth, "body", &attributes, false);
        if body.mass > 0.0 {
            let inertial = [
                Some(("mass", numbers(&[body.mass]))),
                Some(("pos", numbers(&body.com.0))),
                Some(("quat", numbers(&body.principal.0))),
                Some(("diaginertia", numbers(&body.inertia.0))),
            ];
            self.line(depth + 1, "inertial", &inertial, true);
        }
        self.content(index, depth + 1);
        let _ = writeln!(self.out, "{:width$}</body>", "", width = 2 * depth);
    }

    fn content(&mut self, body: usize, depth: usize) {
        let model = self.model;
        for joint in model.joints.iter().filter(|joint| joint.body == body) {
            self.joint(joint, depth);
        }
        for geom in model.geoms.iter().filter(|geom| geom.body == body) {
            self.geom(geom, depth);
        }
        for site in model.sites.iter().filter(|site| site.body == body) {
            self.line(
                depth,
                "site",
                &[name(&site.name, site.named), Some(("pos", numbers(&site.pos.0)))],
                true,
            );
        }
        for child in self.children[body].clone() {
            self.body(child, depth);
        }
    }

    fn joint(&mut self, joint: &crate::model::Joint<f64>, depth: usize) {
        let (limit, friction, usual) = (joint.limit_softness, joint.friction_softness, Softness::default());
        let attributes = [
            name(&joint.name, joint.named),
            Some(("type", joint.kind.mjcf_name().into())),
            (joint.pos.0 != [0.0; 3]).then(|| ("pos", numbers(&joint.pos.0))),
            joint.kind.is_axle().then(|| ("axis", numbers(&joint.axis.0))),
            unless(0.0, "ref", joint.reference),
            unless(0.0, "springref", joint.spring_reference),
            (joint.stiffness != [0.0; 3]).then(|| ("stiffness", polynomial(joint.stiffness))),
            (joint.damping != [0.0; 3]).then(|| ("damping", polynomial(joint.damping))),
            unless(0.0, "armature", joint.armature),
            unless(0.0, "frictionloss", joint.friction_loss),
            range("range", joint.limit),
            unless(0.0, "margin", joint.limit_margin),
            (limit.solref != usual.solref).then(|| ("solreflimit", numbers(&limit.solref))),
            (limit.solimp != usual.solimp).then(|| ("solimplimit", numbers(&limit.solimp))),
            (friction.solref != usual.solref).then(|| ("solreffriction", numbers(&friction.solref))),
            (friction.solimp != usual.solimp).then(|| ("solimpfriction", numbers(&friction.solimp))),
        ];
        self.line(depth, "joint", &attributes, true);
    }

    fn geom(&mut self, geom: &crate::model::Geom<f64>, depth: usize) {
        let (kind, sizes) = match geom.kind {
            GeomKind::Sphere => ("sphere", 1),
            GeomKind::Capsule => ("capsule", 2),
            GeomKind::Cylinder => ("cylinder", 2),
            GeomKind::Ellipsoid => ("ellipsoid", 3),
            GeomKind::Box => ("box", 3),
            GeomKind::Plane => ("plane", 3),
        };
        // a plane's size only says how far it is drawn, but MuJoCo wants one
        let (surface, usual) = (&geom.surface, Surface::default());
        let size = if geom.kind == GeomKind::Plane { [1.0; 3] } else { geom.size };
        let attributes = [
            name(&geom.name, geom.named),
            Some(("type", kind.into())),
            Some(("size", numbers(&size[..sizes]))),
            Some(("pos", numbers(&geom.pos.0))),
            (geom.quat.0 != [1.0, 0.0, 0.0, 0.0]).then(|| ("quat", numbers(&geom.quat.0))),
            Some(("contype", geom.contact_bits[0].to_string())),
            Some(("conaffinity", geom.contact_bits[1].to_string())),
            (geom.contact_margin_m > 0.0).then(|| ("margin", numbers(&[geom.contact_margin_m]))),
            unless(0.0, "gap", surface.gap_m),
            (surface.priority != 0).then(|| ("priority", surface.priority.to_string())),
            (surface.condim != usual.condim).then(|| ("condim", surface.condim.to_string())),
            (surface.friction != usual.friction).then(|| ("friction", numbers(&surface.friction))),
            unless(usual.solmix, "solmix", surface.solmix),
            (surface.solref != usual.solref).then(|| ("solref", numbers(&surface.solref))),
            (surface.solimp != usual.solimp).then(|| ("solimp", numbers(&surface.solimp))),
            geom.fluid.map(|_| ("fluidshape", "ellipsoid".into())),
            geom.fluid.map(|c| ("fluidcoef", numbers(&[c.blunt, c.slender, c.angular, c.kutta, c.magnus]))),
        ];
        self.line(depth, "geom", &attributes, true);
    }

    fn exclusions(&mut self) {
        let model = self.model;
        if model.contacts.excluded.is_empty() {
            return;
        }
        self.line(1, "contact", &[], false);
        for [first, second] in &model.contacts.excluded {
            let body = |index: usize| escaped(&model.bodies[index].name);
            self.line(2, "exclude", &[Some(("body1", body(*first))), Some(("body2", body(*second)))], true);
        }
        self.out.push_str("  </contact>\n");
    }

    /// The causes' numbers, where MuJoCo keeps what it does not use itself.
    fn causes(&mut self) {
        let model = self.model;
        let clamped = model.settings.kutta_lift == KuttaLift::Clamped;
        if model.causes().is_empty() && !clamped {
            return;
        }
        self.line(1, "custom", &[], false);
        if clamped {
            let text = [Some(("name", LIFT.into())), Some(("data", BEFORE_3_14.into()))];
            self.line(2, "text", &text, true);
        }
        for cause in model.causes() {
            for (name, &value) in cause.names().iter().zip(cause.values()) {
                let number = [Some(("name", escaped(name))), Some(("data", numbers(&[value])))];
                self.line(2, "numeric", &number, true);
            }
        }
        self.out.push_str("  </custom>\n");
    }

    fn keyframes(&mut self, starts: &[(&str, &State)]) {
        if starts.is_empty() {
            return;
        }
        self.line(1, "keyframe", &[], false);
        for (of, state) in starts {
            let moves = state.qvel.iter().any(|rate| *rate != 0.0);
            let key = [
                name(of, true),
                Some(("qpos", numbers(&state.qpos))),
                moves.then(|| ("qvel", numbers(&state.qvel))),
            ];
            self.line(2, "key", &key, true);
        }
        self.out.push_str("  </keyframe>\n");
    }

    /// Tendons that pull, then those by which actuators move several joints.
    fn tendons(&mut self) {
        let model = self.model;
        let coupling: Vec<_> = model.actuators.iter().filter(|actuator| !actuator.also.is_empty()).collect();
        if model.tendons.is_empty() && coupling.is_empty() {
            return;
        }
        self.line(1, "tendon", &[], false);
        for tendon in &model.tendons {
            let attributes = [
                name(&tendon.name, tendon.named),
                Some(("stiffness", polynomial(tendon.stiffness))),
                Some(("damping", polynomial(tendon.damping))),
                Some(("springlength", numbers(&tendon.slack))),
            ];
            self.fixed(&attributes, &tendon.terms);
        }
        for actuator in coupling {
            let terms: Vec<_> = [(actuator.joint, 1.0)].iter().chain(&actuator.also).copied().collect();
            self.fixed(&[name(&coupled(&actuator.name), true)], &terms);
        }
        self.out.push_str("  </tendon>\n");
    }

    fn fixed(&mut self, attributes: &[Option<Attribute>], terms: &[(usize, f64)]) {
        let model = self.model;
        self.line(2, "fixed", attributes, false);
        for &(joint, coefficient) in terms {
            let joint = Some(("joint", escaped(&model.joints[joint].name)));
            self.line(3, "joint", &[joint, Some(("coef", numbers(&[coefficient])))], true);
        }
        self.out.push_str("    </fixed>\n");
    }

    fn actuators(&mut self) {
        let model = self.model;
        if model.actuators.is_empty() {
            return;
        }
        self.line(1, "actuator", &[], false);
        for actuator in &model.actuators {
            let kind = match actuator.kind {
                ActuatorKind::Position => "position",
                ActuatorKind::Velocity => "velocity",
                ActuatorKind::Motor => "motor",
            };
            let on = match actuator.also.is_empty() {
                true => ("joint", escaped(&model.joints[actuator.joint].name)),
                false => ("tendon", escaped(&coupled(&actuator.name))),
            };
            let attributes = [
                name(&actuator.name, actuator.named),
                Some(on),
                unless(1.0, "gear", actuator.gear),
                (actuator.kind == ActuatorKind::Position).then(|| ("kp", numbers(&[actuator.kp]))),
                (actuator.kind != ActuatorKind::Motor).then(|| ("kv", numbers(&[actuator.kv]))),
                range("ctrlrange", actuator.command_range),
                range("forcerange", actuator.force_range),
            ];
            self.line(2, kind, &attributes, true);
        }
        self.out.push_str("  </actuator>\n");
    }
}
