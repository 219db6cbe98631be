//! The same things written in other ways than ours move as in MuJoCo 4.0.0 (`data/other_ways.py` writes the cases): what it saves itself,
//! `<general>`, frames and copies, flags, softness, masses that are set, free bodies on their own.

use crate::common::{relative, text};
use sim::{Integrator, Method, Model, RolloutOptions, Simulator, State, Steps};

/// 250 steps of rounding.
const TOLERANCE: f64 = 1e-12;

fn list(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// How far the model is from MuJoCo after the case's steps.
fn apart(model: &Model, case: &serde_json::Value) -> f64 {
    let mut simulator = Simulator::new(model, &RolloutOptions::default()).unwrap();
    let mut state = State { qpos: list(&case["qpos"]), qvel: list(&case["qvel"]) };
    let command = list(&case["ctrl"]);
    for step in 0..case["steps"].as_u64().unwrap() {
        simulator.step(&mut state, step as f64 * model.settings.timestep_s, &command).unwrap();
    }
    let after = &case["after"];
    relative(&state.qpos, &list(&after["qpos"])).max(relative(&state.qvel, &list(&after["qvel"])))
}

#[test]
fn they_move_as_in_mujoco_before_and_after_export() {
    let cases: serde_json::Value = serde_json::from_str(&text("other_ways.json")).unwrap();
    for case in cases.as_array().unwrap() {
        let name = &case["name"];
        let model = Model::from_mjcf(case["xml"].as_str().unwrap()).unwrap_or_else(|e| panic!("{name}: {e}"));
        for (joint, theirs) in model.joints.iter().zip(case["joints"].as_array().unwrap()) {
            assert!(!joint.named || *theirs == joint.name, "{name}: {} and {theirs}", joint.name);
        }
        let again = Model::from_mjcf(&model.to_mjcf("test")).unwrap();
        for (form, model) in [("read", &model), ("exported", &again)] {
            let apart = apart(model, case);
            assert!(apart < TOLERANCE, "{name}, {form}: {apart:e}");
        }
    }
}

#[test]
fn tendons_are_the_same_to_steps_of_our_own() {
    let cases: serde_json::Value = serde_json::from_str(&text("other_ways.json")).unwrap();
    let case = cases.as_array().unwrap().iter().find(|case| case["name"] == "tendons").unwrap();
    let model = Model::from_mjcf(case["xml"].as_str().unwrap()).unwrap();
    let ends: Vec<Vec<f64>> = [Method::RungeKutta, Method::Rosenbrock]
        .into_iter()
        .map(|method| {
            let steps = Some(Steps::even(method, 1e-4));
            let mut simulator =
                Simulator::new(&model, &RolloutOptions { steps, ..RolloutOptions::default() }).unwrap();
            let mut state = State { qpos: list(&case["qpos"]), qvel: list(&case["qvel"]) };
            for step in 0..2000 {
                simulator.step(&mut state, f64::from(step) * 1e-4, &list(&case["ctrl"])).unwrap();
            }
            state.qpos
        })
        .collect();
    assert!(relative(&ends[0], &ends[1]) < 1e-6, "{ends:?}");
    let prescribed = RolloutOptions { prescribed: true, ..RolloutOptions::default() };
    let error = Simulator::new(&model, &prescribed).unwrap_err().to_string();
    assert!(error.contains("several joints by a tendon"), "{error}");
}

#[test]
fn an_integrator_that_is_not_to_be_had_is_told_only_where_it_is_used() {
    let text = r#"<mujoco><option integrator="implicit"/>
      <worldbody><body><joint/><geom size="0.1"/></body></worldbody></mujoco>"#;
    let model = Model::from_mjcf(text).unwrap();
    let error = Simulator::new(&model, &RolloutOptions::default()).unwrap_err().to_string();
    assert!(error.contains("integrator implicit") && error.contains("implicitfast"), "{error}");
    let other = RolloutOptions { integrator: Some(Integrator::Rk4), ..RolloutOptions::default() };
    assert!(Simulator::new(&model, &other).is_ok());
    assert!(model.to_mjcf("").contains("integrator=\"implicit\""));
}
