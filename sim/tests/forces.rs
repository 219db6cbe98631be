//! Each force at random states is MuJoCo's: written by MuJoCo 4.0.0.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

mod common;

use common::{Table, model, relative, text};
use sim::fluid::{Ellipsoid, added_mass};
use sim::math::Vec3;
use sim::model::FluidCoefficients;
use sim::{RolloutOptions, Simulator, State};

/// The file has 14 digits; accelerations divide differences of larger numbers.
const FORCE: f64 = 1e-9;
/// The wrench's sums cancel at most a few digits of the file's 16.
const WRENCH: f64 = 1e-10;

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
        assert!(largest < FORCE, "{name} {key} {largest:e}");
    }
}

#[test]
fn ellipsoid_wrenches_and_added_mass_are_those_of_mujoco() {
    let text = text("fluid_cases.csv");
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    let (mut worst, mut cases) = (0.0_f64, 0);
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        let at = |name: &str| -> f64 {
            cells[head.iter().position(|column| *column == name).unwrap()].parse().unwrap()
        };
        let three =
            |prefix: &str, suffixes: [&str; 3]| suffixes.map(|suffix| at(&format!("{prefix}{suffix}")));
        let [a, b, c] = three("s", ["0", "1", "2"]);
        let r = match cells[0] {
            "sphere" => [a; 3],
            "capsule" => [a, a, a + b],
            "cylinder" => [a, a, b],
            _ => [a, b, c],
        };
        let coefficients = FluidCoefficients {
            blunt: at("blunt"),
            slender: at("slender"),
            angular: at("angular"),
            kutta: at("kutta"),
            magnus: at("magnus"),
        };
        const XYZ: [&str; 3] = ["x", "y", "z"];
        let (w, v) = (Vec3(three("w", XYZ)), Vec3(three("v", XYZ)));
        let (torque, force) = Ellipsoid::new(r, coefficients).wrench(at("rho"), at("mu"), w, v);
        let added = added_mass(r);
        for (ours, theirs) in [
            (torque.0, three("t", XYZ)),
            (force.0, three("f", XYZ)),
            (added.mass, three("ma", ["0", "1", "2"])),
            (added.inertia, three("ia", ["0", "1", "2"])),
        ] {
            worst = worst.max(relative(&ours, &theirs));
        }
        cases += 1;
    }
    println!("{cases} wrenches: worst relative difference {worst:.1e}");
    assert!(cases == 150 && worst < WRENCH, "{cases} {worst:e}");
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
