//! Each force at random states is MuJoCo's: written by MuJoCo 4.0.0.

use crate::common::{Table, model, relative, text};
use sim::fluid::{Ellipsoid, added_mass};
use sim::math::Vec3;
use sim::model::{FluidCoefficients, KuttaLift};
use sim::{RolloutOptions, Simulator, State};

/// The file has 14 digits; accelerations divide differences of larger numbers.
const FORCE_TOLERANCE: f64 = 1e-9;
/// The wrench's sums cancel at most a few digits of the file's 16.
const WRENCH_TOLERANCE: f64 = 1e-10;

#[test]
fn generalized_forces_and_accelerations_are_those_of_mujoco() {
    let cases: serde_json::Value = serde_json::from_str(&text("dynamics.json")).unwrap();
    for (name, states) in cases.as_object().unwrap() {
        let model = model(name);
        let mut simulator = Simulator::new(&model, &RolloutOptions::default()).unwrap();
        let mut worst: Vec<(&str, f64)> = Vec::new();
        for case in states.as_array().unwrap() {
            let list = |key: &str| -> Vec<f64> {
                case[key].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
            };
            let state = State { qpos: list("qpos"), qvel: list("qvel") };
            let forces = simulator.forces(&state, &list("ctrl"));
            for (key, ours) in [
                ("qfrc_bias", &forces.bias),
                ("qfrc_spring", &forces.spring),
                ("qfrc_damper", &forces.damper),
                ("qfrc_gravcomp", &forces.gravity_compensation),
                ("qfrc_fluid", &forces.fluid),
                ("qfrc_actuator", &forces.actuator),
                ("qfrc_constraint", &forces.restraint),
                ("qacc", &forces.acceleration),
            ] {
                // a force computed as a difference: rounding of the others shows where it is 0
                worst.push((key, relative(ours, &list(key))));
            }
        }
        let (key, largest) = worst.iter().copied().fold(("", 0.0), |a, b| if b.1 > a.1 { b } else { a });
        println!("{name}: worst relative difference {largest:.1e} in {key}");
        assert!(largest < FORCE_TOLERANCE, "{name} {key} {largest:e}");
    }
}

/// One row of a file of wrenches.
struct Case {
    r: [f64; 3],
    /// Torque and force by the row's density, viscosity and velocities.
    ours: [[f64; 3]; 2],
    cells: Vec<String>,
    head: Vec<String>,
}

impl Case {
    fn three(&self, prefix: &str, suffixes: [&str; 3]) -> [f64; 3] {
        suffixes.map(|suffix| self.at(&format!("{prefix}{suffix}")))
    }

    fn at(&self, name: &str) -> f64 {
        self.cells[self.head.iter().position(|column| column == name).unwrap()].parse().unwrap()
    }

    fn all(file: &str, lift: KuttaLift) -> Vec<Self> {
        let text = text(file);
        let cells = |line: &str| line.split(',').map(String::from).collect::<Vec<_>>();
        let mut lines = text.lines().map(cells);
        let head = lines.next().unwrap();
        lines.map(|cells| Self::new(cells, head.clone(), lift)).collect()
    }

    fn new(cells: Vec<String>, head: Vec<String>, lift: KuttaLift) -> Self {
        let mut case = Self { r: [1.0; 3], ours: [[0.0; 3]; 2], cells, head };
        let [a, b, c] = case.three("s", ["0", "1", "2"]);
        case.r = match case.cells[0].as_str() {
            "sphere" => [a; 3],
            "capsule" => [a, a, a + b],
            "cylinder" => [a, a, b],
            _ => [a, b, c],
        };
        let coefficients = FluidCoefficients {
            blunt: case.at("blunt"),
            slender: case.at("slender"),
            angular: case.at("angular"),
            kutta: case.at("kutta"),
            magnus: case.at("magnus"),
        };
        let shape = Ellipsoid::new(case.r, coefficients).with_lift(lift);
        let (w, v) = (Vec3(case.three("w", XYZ)), Vec3(case.three("v", XYZ)));
        let (torque, force) = shape.wrench(case.at("rho"), case.at("mu"), w, v);
        case.ours = [torque.0, force.0];
        case
    }

    /// Largest relative difference of torque and force.
    fn off(&self) -> f64 {
        let [torque, force] = &self.ours;
        relative(torque, &self.three("t", XYZ)).max(relative(force, &self.three("f", XYZ)))
    }
}

const XYZ: [&str; 3] = ["x", "y", "z"];

#[test]
fn ellipsoid_wrenches_and_added_mass_are_those_of_mujoco() {
    let cases = Case::all("fluid_cases.csv", KuttaLift::Whole);
    let mut worst = 0.0_f64;
    for case in &cases {
        let added = added_mass(case.r);
        let mass = relative(&added.mass, &case.three("ma", ["0", "1", "2"]));
        let inertia = relative(&added.inertia, &case.three("ia", ["0", "1", "2"]));
        worst = worst.max(case.off()).max(mass).max(inertia);
    }
    println!("{} wrenches: worst relative difference {worst:.1e}", cases.len());
    assert!(cases.len() == 150 && worst < WRENCH_TOLERANCE, "{} {worst:e}", cases.len());
}

#[test]
fn older_engines_lift_is_theirs_where_it_is_asked_for() {
    const FILE: &str = "fluid_cases_before_3_14.csv";
    let worst = Case::all(FILE, KuttaLift::Clamped).iter().map(Case::off).fold(0.0, f64::max);
    let whole = Case::all(FILE, KuttaLift::Whole).iter().map(Case::off).fold(0.0, f64::max);
    println!("clamped: worst relative difference {worst:.1e}; the formula's lift: {whole:.1e}");
    assert!(worst < WRENCH_TOLERANCE && whole > 0.1, "{worst:e} {whole:e}");
}

#[test]
fn reference_models_name_their_parameters() {
    let names = model("chain_active").parameter_names();
    for name in [
        "g1/blunt",
        "g3/magnus",
        "q2/damping",
        "q2/frictionloss",
        "q1/stiffness3",
        "link2/mass",
        "servo/gain",
    ] {
        assert!(names.iter().any(|known| known == name), "{name} missing from {names:?}");
    }
    assert_eq!(model("arm8").parameter("geom#3/blunt"), Ok(0.65));
    let Table { head, .. } = Table::read("chain_active_euler.csv");
    assert!(head.iter().any(|column| column == &format!("{}_x", model("chain_active").keypoints()[0])));
}

#[test]
fn quadratic_drag_and_lift_scale_with_the_square_of_a_velocity_however_small() {
    let coefficients = FluidCoefficients { blunt: 0.6, slender: 0.2, angular: 1.6, kutta: 0.9, magnus: 0.8 };
    let shape = Ellipsoid::new([0.005, 0.0025, 0.015], coefficients);
    let force = |speed: f64| {
        let v = Vec3([0.3, 0.1, 1.0]) * speed;
        shape.wrench(1000.0, 0.0, Vec3::ZERO, v).1 * (1.0 / (speed * speed))
    };
    let fast = force(1.0);
    for speed in [1e-2, 1e-4, 1e-8, 1e-20] {
        assert!((force(speed) - fast).norm() < 1e-12 * fast.norm(), "at {speed} m/s");
    }
    assert_eq!(shape.wrench(1000.0, 1e-3, Vec3::ZERO, Vec3::ZERO), (Vec3::ZERO, Vec3::ZERO));
}
