//! Random trees with every supported feature move as in MuJoCo 4.0.0 (`data/random_models.py` writes the cases).

use crate::common::{relative, text};
use sim::{Model, RolloutOptions, Simulator, State};

/// One step: rounding, and the tolerance of MuJoCo's constraint solver.
const ONE_STEP_TOLERANCE: f64 = 1e-9;
/// A hundred steps: rounding grows.
const HUNDRED_STEPS_TOLERANCE: f64 = 1e-8;
/// A thousand: as much as a difference of this grows in MuJoCo itself.
const THOUSAND_STEPS_TOLERANCE: f64 = 1e-10;

fn list(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn moves_as_in_mujoco(model: &Model, case: &serde_json::Value) -> [f64; 4] {
    let mut simulator = Simulator::new(model, &RolloutOptions::default()).unwrap();
    let mut state = State { qpos: list(&case["qpos"]), qvel: list(&case["qvel"]) };
    let command = list(&case["ctrl"]);
    let forces = simulator.forces(&state, &command);
    let mut worst = [relative(&forces.acceleration, &list(&case["qacc"])), 0.0, 0.0, 0.0];
    for step in 1..=1000 {
        simulator.step(&mut state, f64::from(step) * 1e-3, &command).unwrap();
        let (slot, key) = match step {
            1 => (1, "after_1"),
            100 => (2, "after_100"),
            1000 => (3, "after_1000"),
            _ => continue,
        };
        worst[slot] = relative(&state.qpos, &list(&case[key]["qpos"]))
            .max(relative(&state.qvel, &list(&case[key]["qvel"])));
    }
    worst[3] /= case["growth"].as_f64().unwrap().max(1.0);
    worst
}

#[test]
fn random_trees_move_as_in_mujoco_before_and_after_export() {
    let cases: serde_json::Value = serde_json::from_str(&text("random_models.json")).unwrap();
    let (mut largest, mut bad) = ([0.0_f64; 4], Vec::new());
    for (index, case) in cases.as_array().unwrap().iter().enumerate() {
        let model = Model::from_mjcf(case["xml"].as_str().unwrap()).unwrap();
        let again = Model::from_mjcf(&model.to_mjcf("test")).unwrap();
        for (form, model) in [("", &model), ("exported ", &again)] {
            let worst = moves_as_in_mujoco(model, case);
            if !(worst[0] < ONE_STEP_TOLERANCE
                && worst[1] < ONE_STEP_TOLERANCE
                && worst[2] < HUNDRED_STEPS_TOLERANCE
                && worst[3] < THOUSAND_STEPS_TOLERANCE)
            {
                bad.push(format!(
                    "{form}{index} {:?} {}: {worst:?}",
                    model.settings.integrator, case["features"]
                ));
            }
            for (largest, worst) in largest.iter_mut().zip(worst) {
                *largest = largest.max(worst);
            }
        }
    }
    println!(
        "worst relative difference: acceleration, 1 step, 100 steps, 1000 steps over their growth: {largest:?}"
    );
    assert!(bad.is_empty(), "{}", bad.join("\n"));
}
