//! Every class of parameter is fitted by its name: changed in the truth, forgotten in the model, and found again.

use crate::common::*;
use ident::experiment::{Experiment, FitConfig, Run};
use ident::fit::{Fit, fit};
use ident::weights::{Mechanism, Water};
use sim::Model;

/// Deviations from the truth in stated standard deviations: of some twenty values one beyond 3.5 is a 1 % chance.
const MOST_SIGMA: f64 = 3.5;

/// The chain with springs, and a servo on its first joint.
fn springy() -> Model {
    let mut model = driven_chain();
    for joint in ["q2", "q3"] {
        model.set_parameter(&format!("{joint}/stiffness"), 2e-5).unwrap();
    }
    model
}

fn named(model: Model, runs: Vec<Run>, fit: &str) -> Experiment {
    Experiment {
        noise_m: Some(NOISE_M),
        ..Experiment::new(model, toml::from_str::<FitConfig>(fit).unwrap(), runs)
    }
}

/// Fits `names` of the model without causes to runs of one in which they have `values`.
fn recovered(names: &[&str], values: &[f64], driven: bool) -> Fit {
    let model = if driven { springy() } else { chain() };
    let mut truth = model.clone();
    for (name, &value) in names.iter().zip(values) {
        if let Some((cause, _)) = name.split_once('/') {
            let _ = truth.add_cause(cause);
        }
        truth.set_parameter(name, value).unwrap();
    }
    let runs = match driven {
        true => vec![driven_run("strokes", &truth, strokes(0.8, 0.9, 3.0), 3.0, false, 11)],
        false => vec![drop_run("drop", &truth, [1.5, -1.2, 0.9], 0.2, 3.0, 12)],
    };
    let found = fit(&named(model, runs, &format!("parameters = {names:?}")), &mut ()).unwrap().fit;
    for p in &found.parameters {
        println!("{:32} {:11.4e} +- {:8.1e} {}", p.name, p.value, p.std, p.determined);
    }
    found
}

#[test]
fn every_class_of_parameter_is_found_by_its_name() {
    type Case<'a> = (&'a [&'a str], &'a [f64], bool);
    let cases: &[Case<'_>] = &[
        (&["buoyancy/link2", "buoyancy/link3"], &[0.03, -0.04], false),
        (&["link3/mass"], &[2.0e-3], false),
        (&["q2/damping", "q3/frictionloss"], &[4e-6, 2e-6], false),
        (&["g3/blunt", "g2/angular"], &[0.8, 2.5], false),
        (&["q2/stiffness", "q3/stiffness"], &[6e-5, 1e-5], true),
        (&["q3/stiffness2", "q3/stiffness3"], &[1.5e-5, 3e-5], true),
        (&["one_sided_stiffness/q2"], &[4e-5], true),
        (&["servo/gain"], &[0.02], true),
        (&["servo_gain/scale"], &[0.08], true),
        (&["servo_delay/delay"], &[0.02], true),
        (&["added_mass/scale"], &[0.6], true),
        (&["current/x"], &[0.01], false),
        (&["camera_scale/scale"], &[0.02], true),
    ];
    for &(names, values, driven) in cases {
        let found = recovered(names, values, driven);
        assert_eq!(found.parameters.len(), names.len());
        for (name, value) in names.iter().zip(values) {
            let p = found.parameters.iter().find(|p| p.name == *name).unwrap();
            assert!(p.determined, "{p:?}");
            assert!((p.value - value).abs() < MOST_SIGMA * p.std, "{p:?}, truth {value}");
        }
    }
}

#[test]
fn weights_in_air_and_water_make_mass_and_buoyancy_fitted_with_their_priors() {
    let mut truth = chain();
    truth.add_cause("buoyancy").unwrap();
    truth.set_parameter("buoyancy/link3", 0.02).unwrap();
    let mass_kg = truth.parameter("link3/mass").unwrap();
    let body = truth.bodies.iter().find(|body| body.name == "link3").unwrap();
    let displaced_kg = mass_kg * body.gravity_compensation * 1.02;
    // Weighed to 0.01 g, both with an error of a deviation.
    let std_kg = 1e-5;
    let (dry_kg, wet_kg) = (mass_kg + std_kg, mass_kg - displaced_kg - std_kg);
    let text = format!(
        "std_kg = {std_kg}\ndry_mass_kg = {{ link3 = {dry_kg} }}\nwet_mass_kg = {{ link3 = {wet_kg} }}"
    );
    let weighed: Mechanism = toml::from_str(&text).unwrap();
    let runs = vec![drop_run("drop", &truth, [1.5, -1.2, 0.9], 0.2, 3.0, 13)];
    let mut experiment = named(chain(), runs, "parameters = [\"g3/blunt\"]");
    weighed.put_into(&Water::default(), &mut experiment.model, &mut experiment.fit).unwrap();
    let found = fit(&experiment, &mut ()).unwrap().fit;
    let parameter = |name: &str| found.parameters.iter().find(|p| p.name == name).unwrap();
    let (mass, buoyancy) = (parameter("link3/mass"), parameter("buoyancy/link3"));
    println!("{mass:?}\n{buoyancy:?}");
    assert!(mass.std <= 1.001 * std_kg && (mass.value - mass_kg).abs() < MOST_SIGMA * mass.std, "{mass:?}");
    // The balance says it to 1e-5 / 1.5e-3; the drop, which sees weight in water over inertia, better.
    assert!(buoyancy.std < 0.8 * std_kg / displaced_kg, "{buoyancy:?}");
    let found_kg = mass.value * experiment.model.bodies[3].gravity_compensation * (1.0 + buoyancy.value);
    assert!((found_kg - displaced_kg).abs() < MOST_SIGMA * std_kg, "{found_kg} {displaced_kg}");
}
