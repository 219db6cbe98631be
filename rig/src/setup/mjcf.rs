//! A chain as an MJCF model.

use std::fmt::Write as _;

use super::answers::Shape;
use super::chain::Chain;
use super::tidy;
use config::{MotionKind, Mount};

/// Which model of the chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Which {
    /// What a fit starts from.
    Start,
    /// What a mock rig's tank really is.
    Truth,
}

/// MuJoCo's default fluid coefficients: the start of a fit.
const START_COEFFICIENTS: [f64; 5] = [0.5, 0.25, 1.5, 1.0, 1.0];
/// Fluid coefficients of the simulated tank's links, in turn: values like those that were measured on links of this kind.
const TANK_COEFFICIENTS: [[f64; 5]; 3] =
    [[0.6, 0.2, 1.6, 0.9, 0.8], [0.75, 0.15, 1.2, 1.1, 0.6], [0.55, 0.3, 2.0, 0.7, 0.9]];
/// The tank's links are heavier than the balance says, and their joints worse than guessed.
const TANK_MASS_FACTOR: f64 = 1.004;
const TANK_DAMPING_FACTOR: f64 = 2.4;
const TANK_FRICTION_FACTOR: f64 = 1.8;

/// Mass of water \[kg\] and length \[m\] of the shipped three-link chain, and the joint and servo parameters that suit it (guessed): joint damping \[N m s/rad\], friction
/// loss \[N m\], and a stiff position servo's kp \[N m/rad\], kv \[N m s/rad\] and greatest torque \[N m\]. Friction grows with the moment of
/// the weight, the others with that of inertia: so times and angles of rest stay what they are.
const REFERENCE_WATER_MASS_KG: f64 = 3.0 * 0.0015;
const REFERENCE_LENGTH_M: f64 = 0.08;
const REFERENCE_DAMPING_N_M_S_PER_RAD: f64 = 1e-6;
const REFERENCE_FRICTION_N_M: f64 = 1e-6;
const REFERENCE_KP_N_M_PER_RAD: f64 = 0.05;
const REFERENCE_KV_N_M_S_PER_RAD: f64 = 3e-4;
const REFERENCE_TORQUE_N_M: f64 = 0.03;

/// The model `name`.
pub(super) fn model(name: &str, chain: &Chain, which: Which) -> String {
    let count = chain.links.len();
    let (heavier, longer) = (
        count as f64 * chain.shape_displaces_kg() / REFERENCE_WATER_MASS_KG,
        chain.chain_m() / REFERENCE_LENGTH_M,
    );
    // Guesses deserve no more digits.
    let guess = |value: f64, by: f64| -> f64 { format!("{:.1e}", value * by).parse().unwrap_or(value) };
    let (weight, inertia) = (heavier * longer, heavier * longer * longer);
    let truth = which == Which::Truth;
    let (damping, friction) = if truth { (TANK_DAMPING_FACTOR, TANK_FRICTION_FACTOR) } else { (1.0, 1.0) };
    let passive = format!(
        " damping=\"{}\" frictionloss=\"{}\"",
        tidy(guess(REFERENCE_DAMPING_N_M_S_PER_RAD * damping, inertia)),
        tidy(guess(REFERENCE_FRICTION_N_M * friction, weight))
    );
    // The first pivot is the upper end of what hangs and the lower end of what stands.
    let down = if chain.mount == Mount::Hanging { -1.0 } else { 1.0 };
    let driven = chain.motion == MotionKind::Driven;
    let along = |distance_m: f64| tidy(down * distance_m);
    let half = |side_m: f64| tidy(side_m / 2.0);
    let mut out = String::new();
    let mut line = |depth: usize, text: &str| {
        let _ = writeln!(out, "{:width$}{text}", "", width = 2 * depth);
    };
    line(0, &comment(chain, which));
    line(0, &format!("<mujoco model=\"{}\">", escaped(name)));
    line(1, "<compiler angle=\"radian\" autolimits=\"true\"/>");
    let gravity = if chain.mount == Mount::Horizontal { "0 9.81 0" } else { "0 0 -9.81" };
    line(
        1,
        &format!(
            "<option timestep=\"0.001\" integrator=\"Euler\" gravity=\"{gravity}\" density=\"{}\" viscosity=\"{}\"/>",
            tidy(chain.water_density_kg_per_m3),
            tidy(viscosity_pa_s(chain.water_temperature_c))
        ),
    );
    line(1, "<default>");
    let shape = match chain.shape {
        Shape::Box => "box",
        Shape::Ellipsoid => "ellipsoid",
    };
    line(2, &format!("<geom type=\"{shape}\" contype=\"0\" conaffinity=\"0\" fluidshape=\"ellipsoid\"/>"));
    line(2, "<joint type=\"hinge\" axis=\"0 -1 0\"/>");
    line(2, "<site size=\"0.001\"/>");
    line(1, "</default>");
    line(1, "<worldbody>");
    for (index, link) in chain.links.iter().enumerate() {
        let (depth, number) = (index + 2, index + 1);
        let mass_kg = if truth { link.dry_kg * TANK_MASS_FACTOR } else { link.dry_kg };
        let from_m = if index == 0 { 0.0 } else { chain.pitch_m() };
        let buoyancy = tidy(link.displaced_kg / mass_kg);
        let pos = if index == 0 { "0 0 0".into() } else { format!("0 0 {}", along(from_m)) };
        line(depth, &format!("<body name=\"link{number}\" pos=\"{pos}\" gravcomp=\"{buoyancy}\">"));
        let joint = if driven && index == 0 { "" } else { &passive };
        line(depth + 1, &format!("<joint name=\"q{number}\"{joint}/>"));
        let coefficients =
            if truth { TANK_COEFFICIENTS[index % TANK_COEFFICIENTS.len()] } else { START_COEFFICIENTS };
        line(
            depth + 1,
            &format!(
                "<geom name=\"g{number}\" size=\"{} {} {}\" pos=\"0 0 {}\" mass=\"{}\" fluidcoef=\"{}\"/>",
                half(chain.width_m),
                half(chain.thickness_m),
                half(chain.length_m),
                along(chain.pitch_m() / 2.0),
                tidy(mass_kg),
                coefficients.map(|c| c.to_string()).join(" ")
            ),
        );
        if index == 0 {
            line(depth + 1, "<site name=\"P0\"/>");
        }
        let end_m = if number == count { chain.tip_m() } else { chain.pitch_m() };
        line(depth + 1, &format!("<site name=\"P{number}\" pos=\"0 0 {}\"/>", along(end_m)));
    }
    for depth in (2..count + 2).rev() {
        line(depth, "</body>");
    }
    line(1, "</worldbody>");
    if driven {
        line(1, "<actuator>");
        let torque = tidy(guess(REFERENCE_TORQUE_N_M, inertia));
        line(
            2,
            &format!(
                "<position name=\"servo\" joint=\"q1\" kp=\"{}\" kv=\"{}\" forcerange=\"-{torque} {torque}\"/>",
                tidy(guess(REFERENCE_KP_N_M_PER_RAD, inertia)),
                tidy(guess(REFERENCE_KV_N_M_S_PER_RAD, inertia))
            ),
        );
        line(1, "</actuator>");
    }
    line(1, "<keyframe>");
    line(2, &format!("<key name=\"rest\" qpos=\"{}\"/>", vec!["0"; count].join(" ")));
    line(1, "</keyframe>");
    line(0, "</mujoco>");
    out
}

fn comment(chain: &Chain, which: Which) -> String {
    let mount = match chain.mount {
        Mount::Hanging => "Hangs from its first pivot",
        Mount::Upright => "Stands up from its first pivot by its buoyancy",
        Mount::Horizontal => {
            "Lies in a horizontal plane, filmed from above, the first pivot at the lower edge of the picture; gravity points away from \
             the camera"
        }
    };
    let moved = match chain.motion {
        MotionKind::Driven => "a servo turns the first link",
        MotionKind::Drop => "a hand lets go of it",
    };
    let tip = chain.links.len();
    let weights =
        if chain.weighed { "weights are a balance's" } else { "weights are a density's times the shape" };
    let coefficients = match which {
        Which::Start => {
            "Fluid coefficients are MuJoCo's defaults, friction and servo a guess: the start of a fit, not its answer."
        }
        Which::Truth => {
            "The truth behind the mock rig: coefficients, weight and friction differ from the model that a fit starts from."
        }
    };
    format!(
        "<!--\n  {mount}; {moved}.\n  Rigid links of {} mm that overlap by {} mm: pivots {} mm apart, {} mm end to end. P0 to P{} are the \
         pivots,\n  P{tip} the tip; {weights}.\n  MuJoCo knows no buoyancy: gravcomp = displaced water over own mass.\n  {coefficients}\n-->",
        tidy(chain.length_m * 1e3),
        tidy(chain.overlap_m * 1e3),
        tidy(chain.pitch_m() * 1e3),
        tidy(chain.chain_m() * 1e3),
        tip - 1
    )
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

/// Dynamic viscosity of fresh water \[Pa s\], within 2.5 % from 0 to 40 °C; salt adds up to 8 %.
///
/// # Source
/// Vogel's equation, 2.414e-5 · 10^(247.8 / (T - 140)), T in kelvin.
fn viscosity_pa_s(temperature_c: f64) -> f64 {
    let value = 2.414e-5 * 10_f64.powf(247.8 / (temperature_c + 273.15 - 140.0));
    format!("{value:.2e}").parse().unwrap_or(value)
}
