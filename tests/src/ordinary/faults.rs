//! What may be wrong, and how badly.

use crate::hidden::bench::{Bench, Draw};
use crate::hidden::fluid::Ellipsoid;
use crate::hidden::terms::Hidden;
use crate::hidden::three_links::{self, LINKS};

/// The nominal model without water.
const IN_AIR: &str = include_str!("../../data/hidden/chain_in_air.xml");
/// Share of the angles at which drops start in air, where a chain that falls far is chaos.
const AIR_DROP_ANGLE_SHARE: f64 = 0.4;
/// The random stream from which the fault of a case is drawn.
const FAULT_RANDOM_STREAM: u64 = 21;

/// A kind of fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// None.
    Nothing,
    /// The servo's own hinge, which drops turn freely, is more viscous than the model says; dampings are fitted.
    OwnHinge,
    /// Water carries one link otherwise: a bubble.
    Bubble,
    /// One link has another mass.
    HeavyLink,
    /// One hinge rubs.
    RubbingHinge,
    /// The hinges rub with what they bear.
    LoadedHinges,
    /// Something springs one hinge.
    SprungHinge,
    /// One hinge is more viscous.
    ViscousHinge,
    /// The picture's origin is off.
    Origin,
    /// A link is longer, or shorter.
    LongLink,
    /// The horn sits askew on the servo.
    AskewHorn,
    /// A link's inertia is another.
    Inertia,
    /// The servo's reach sags.
    Sagging,
    /// The servo looks at its pulse every so often.
    Refresh,
    /// The air resists, which the model has none of.
    Air,
    /// The servo lags, hinges rub, and the camera is not level.
    LagFrictionTurn,
    /// A bubble on one link and an origin that is off.
    BubbleAndOrigin,
    /// The water flows differently in each run.
    ShiftingCurrent,
    /// Bubbles come and go between runs.
    Bubbles,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 19] = [
        Self::Nothing,
        Self::OwnHinge,
        Self::Bubble,
        Self::HeavyLink,
        Self::RubbingHinge,
        Self::LoadedHinges,
        Self::SprungHinge,
        Self::ViscousHinge,
        Self::Origin,
        Self::LongLink,
        Self::AskewHorn,
        Self::Inertia,
        Self::Sagging,
        Self::Refresh,
        Self::Air,
        Self::LagFrictionTurn,
        Self::BubbleAndOrigin,
        Self::ShiftingCurrent,
        Self::Bubbles,
    ];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Nothing => "nothing",
            Self::OwnHinge => "damping of the servo's hinge",
            Self::Bubble => "buoyancy of one link",
            Self::HeavyLink => "mass of one link",
            Self::RubbingHinge => "friction in one hinge",
            Self::LoadedHinges => "friction of loaded hinges",
            Self::SprungHinge => "spring in one hinge",
            Self::ViscousHinge => "damping of one hinge",
            Self::Origin => "origin of the picture",
            Self::LongLink => "length of one link",
            Self::AskewHorn => "zero of the servo's horn",
            Self::Inertia => "inertia of one link",
            Self::Sagging => "reach of the servo sags",
            Self::Refresh => "servo looks every so often",
            Self::Air => "drag of the air",
            Self::LagFrictionTurn => "lag, friction, turned camera",
            Self::BubbleAndOrigin => "buoyancy of one link, origin",
            Self::ShiftingCurrent => "current, differently in each run",
            Self::Bubbles => "buoyancy, differently in each run",
        }
    }
}

/// A cause that is at work.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Fault {
    /// Its name.
    pub cause: String,
    /// The one element it sits in, where there are several.
    pub element: Option<String>,
    /// How strong it is.
    pub size: f64,
    /// Whether it is another in each run.
    #[serde(default)]
    pub by_run: bool,
}

/// A mechanism with faults.
#[derive(Debug, Clone)]
pub struct Faulty {
    /// The mechanism and its runs.
    pub bench: Bench<LINKS>,
    /// The faults as the generator takes them.
    pub hidden: Hidden,
    /// The same as they should be found.
    pub truth: Vec<Fault>,
}

impl Faulty {
    /// The mechanism of `seed` with what is drawn of `kind`.
    pub fn draw(kind: Kind, seed: u64) -> Self {
        let mut draw = Draw::new(seed, FAULT_RANDOM_STREAM);
        let draw = &mut draw;
        // a damping that is fitted is no candidate
        let fits_damping = match kind {
            Kind::ViscousHinge => false,
            Kind::OwnHinge | Kind::Air => true,
            _ => !seed.is_multiple_of(3),
        };
        let mut bench = three_links::draw(seed, fits_damping);
        let mut hidden = Hidden::default();
        let mut truth = Vec::new();
        let mut put = |cause: &str, element: Option<String>, parameter: &str, size: f64| {
            let name = format!("{cause}/{}", element.as_deref().unwrap_or(parameter));
            hidden.0.insert(name, size);
            truth.push(Fault { cause: cause.into(), element, size, by_run: false });
        };
        let link = |draw: &mut Draw, count: usize| Some(format!("link{}", 1 + draw.place(count)));
        let hinge =
            |draw: &mut Draw, first: usize| Some(format!("q{}", first + draw.place(LINKS + 1 - first)));
        let either = |draw: &mut Draw, low: f64, high: f64| draw.sign() * draw.even(low, high);
        match kind {
            Kind::Nothing => {}
            Kind::OwnHinge => bench.chain.links[0].damping *= draw.even(2.0, 5.0),
            Kind::Bubble | Kind::BubbleAndOrigin => {
                put("buoyancy", link(draw, LINKS), "", either(draw, 0.03, 0.08));
            }
            Kind::HeavyLink => put("link_mass", link(draw, LINKS), "", either(draw, 0.03, 0.06)),
            Kind::RubbingHinge => put("coulomb_friction", hinge(draw, 2), "", draw.even(1e-6, 5e-6)),
            Kind::LoadedHinges => put("load_friction", None, "arm", draw.even(2e-4, 1e-3)),
            Kind::SprungHinge => put("stiffness", hinge(draw, 2), "", draw.even(2e-5, 1e-4)),
            Kind::ViscousHinge => put("joint_damping", hinge(draw, 2), "", draw.even(2e-6, 1e-5)),
            Kind::LongLink => put("link_length", link(draw, LINKS - 1), "", either(draw, 5e-4, 1e-3)),
            Kind::AskewHorn => put("joint_zero", Some("q1".into()), "", either(draw, 0.015, 0.05)),
            Kind::Inertia => put("inertia", link(draw, LINKS), "", either(draw, 0.15, 0.4)),
            Kind::Sagging => put("servo_sag", None, "rate", draw.even(0.03, 0.08)),
            Kind::Refresh => put("servo_refresh", None, "period", draw.even(0.015, 0.03)),
            Kind::Air => put("medium_drag", None, "drag", draw.even(0.005, 0.02)),
            Kind::LagFrictionTurn => {
                put("servo_lag", None, "time", draw.even(0.02, 0.05));
                put("coulomb_friction", None, "torque", draw.even(1e-6, 3e-6));
                put("camera_rotation", None, "angle", either(draw, 0.008, 0.02));
            }
            Kind::Origin | Kind::ShiftingCurrent | Kind::Bubbles => {}
        }
        if matches!(kind, Kind::Origin | Kind::BubbleAndOrigin) {
            let (size, turn) = (draw.even(2.5e-4, 6e-4), draw.even(0.0, std::f64::consts::TAU));
            hidden.0.insert("camera_offset/x".into(), size * turn.cos());
            hidden.0.insert("camera_offset/z".into(), size * turn.sin());
            truth.push(Fault { cause: "camera_offset".into(), element: None, size, by_run: true });
        }
        let mut each_run = |cause: &str, parameters: &[&str], size: f64| {
            for (run, parameter) in
                (0..bench.runs.len()).flat_map(|run| parameters.iter().map(move |p| (run, p)))
            {
                hidden.0.insert(format!("{cause}/{parameter}@{run}"), draw.even(-size, size));
            }
            truth.push(Fault { cause: cause.into(), element: None, size, by_run: true });
        };
        match kind {
            Kind::ShiftingCurrent => each_run("current", &["x", "z"], 0.012),
            Kind::Bubbles => each_run("buoyancy", &["scale"], 0.03),
            _ => {}
        }
        if kind == Kind::Air {
            dry(&mut bench);
        }
        Self { bench, hidden, truth }
    }
}

/// Takes the water away.
fn dry(bench: &mut Bench<LINKS>) {
    let chain = &mut bench.chain;
    (chain.density, chain.viscosity) = (0.0, 0.0);
    for link in &mut chain.links {
        link.held_kg = 0.0;
        link.shape = Ellipsoid::new(link.shape.axes_m, [0.0; 5]);
    }
    for run in bench.runs.iter_mut().filter(|run| !run.is_driven()) {
        run.motion.held = run.motion.held.map(|angle| AIR_DROP_ANGLE_SHARE * angle);
    }
    bench.model = IN_AIR;
}
