//! How a model's file moves here: `moved MODEL < case.json`, what `tests/data/check_models.py` puts beside MuJoCo. The case holds `qpos`, `qvel`
//! and `ctrl` at the start and the number of `steps`; out come the names of joints and actuators, and `qpos` and `qvel` at the end.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "its output is the point")]

use std::error::Error;
use std::process::ExitCode;

use serde_json::{Value, json};
use sim::{CauseValues, Integrator, Model, RolloutOptions, Simulator, State};

fn numbers(case: &Value, name: &str) -> Vec<f64> {
    case[name].as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
}

fn main() -> ExitCode {
    match compare() {
        Ok(end) => {
            println!("{end}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn compare() -> Result<Value, Box<dyn Error>> {
    let path = std::env::args_os().nth(1).ok_or("name a model")?;
    let mut model = Model::read_mjcf(path.as_ref())?;
    // what MuJoCo does not know
    for number in model.causes().iter().flat_map(CauseValues::names).cloned().collect::<Vec<_>>() {
        model.set_parameter(&number, 0.0)?;
    }
    let case: Value = serde_json::from_reader(std::io::stdin())?;
    let mut state = State { qpos: numbers(&case, "qpos"), qvel: numbers(&case, "qvel") };
    let (command, steps) = (numbers(&case, "ctrl"), case["steps"].as_u64().ok_or("steps is no number")?);
    // implicit is read, but not taken
    let integrator = (model.settings.integrator == Integrator::Implicit).then_some(Integrator::ImplicitFast);
    let mut simulator = Simulator::new(&model, &RolloutOptions { integrator, ..RolloutOptions::default() })?;
    for step in 0..steps {
        simulator.step(&mut state, step as f64 * model.settings.timestep_s, &command)?;
    }
    let joints: Vec<&String> = model.joints.iter().map(|joint| &joint.name).collect();
    let actuators: Vec<&String> = model.actuators.iter().map(|actuator| &actuator.name).collect();
    Ok(json!({"joints": joints, "actuators": actuators, "qpos": state.qpos, "qvel": state.qvel}))
}
