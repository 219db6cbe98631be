//! Derivatives of every reference model's run, from rest.

use crate::common::{self, Number, model, stroke_command};
use sim::{Command, Method, Model, RolloutOptions, State, Steps, rollout, rollout_of};

/// Parameters of a case.
const COUNT: usize = 4;

/// A model, how long it is followed \[s\], its steps, parameters, and the error of the differences themselves: their own
/// order's, and where a joint breaks loose a corner's.
struct Case {
    name: &'static str,
    duration_s: f64,
    method: Method,
    parameters: [&'static str; COUNT],
    tolerance: f64,
}

const CASES: [Case; 5] = [
    Case {
        name: "chain_passive",
        duration_s: 1.0,
        method: Method::RungeKutta,
        parameters: ["g2/blunt", "g3/kutta", "q2/damping", "link3/mass"],
        tolerance: 1e-6,
    },
    Case {
        name: "chain_friction",
        duration_s: 0.5,
        method: Method::RungeKutta,
        parameters: ["g2/blunt", "q3/frictionloss", "q2/damping", "link3/mass"],
        tolerance: 1e-3,
    },
    Case {
        name: "chain_active",
        duration_s: 1.0,
        method: Method::Rosenbrock,
        parameters: ["g2/slender", "g3/magnus", "servo/gain", "link3/mass"],
        tolerance: 1e-6,
    },
    Case {
        name: "arm8",
        duration_s: 1.0,
        method: Method::Rosenbrock,
        parameters: ["geom#1/blunt", "q4/damping", "q3/stiffness2", "s5/mass"],
        tolerance: 1e-6,
    },
    Case {
        name: "octopus8",
        duration_s: 0.2,
        method: Method::Rosenbrock,
        parameters: ["hub/blunt", "a1q2/damping", "a3q4/stiffness", "a2s3/mass"],
        tolerance: 1e-6,
    },
];

fn start(model: &Model) -> (State, Command) {
    let mut state = model.rest_state();
    if model.actuators.is_empty() {
        state.qpos[0] = std::f64::consts::FRAC_PI_2;
    }
    (state, stroke_command(model, 0.5, 1.0))
}

#[test]
fn derivatives_from_rest_are_finite_and_exact_on_every_model() {
    for Case { name, duration_s, method, parameters, tolerance } in CASES {
        let plain = model(name);
        let (state, command) = start(&plain);
        let times: Vec<f64> = (0..=10).map(|k| f64::from(k) * duration_s / 10.0).collect();
        let steps = Some(Steps::even(method, 0.005));
        let options = RolloutOptions { steps, ..RolloutOptions::default() };
        let mut lifted = plain.map(Number::constant);
        for (index, parameter) in parameters.into_iter().enumerate() {
            let value = plain.parameter(parameter).unwrap();
            lifted.set_parameter(parameter, Number::variable(value, index)).unwrap();
        }
        let numbers = |x: &[f64]| x.iter().map(|&x| Number::constant(x)).collect();
        let lifted_state = State { qpos: numbers(&state.qpos), qvel: numbers(&state.qvel) };
        let exact = rollout_of(&lifted, &lifted_state, &command, &times, &options).unwrap();
        let at = |parameter: &str, value: f64| -> Vec<f64> {
            let mut model = plain.clone();
            model.set_parameter(parameter, value).unwrap();
            rollout(&model, &state, &command, &times, &options).unwrap().qpos
        };
        for (index, parameter) in parameters.into_iter().enumerate() {
            let value = plain.parameter(parameter).unwrap();
            let step = 1e-3 * value;
            let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(|k| at(parameter, value + k * step));
            // fourth order
            let differences: Vec<f64> =
                (0..a.len()).map(|i| (a[i] - d[i] + 8.0 * (c[i] - b[i])) / (12.0 * step)).collect();
            let ours: Vec<f64> = exact.qpos.iter().map(|x| x.partials[index]).collect();
            assert!(ours.iter().all(|x| x.is_finite()));
            let worst = common::relative(&ours, &differences);
            println!("{name} {parameter}: derivative against differences {worst:.1e}");
            assert!(worst < tolerance, "{name} {parameter} {worst:e}");
        }
        // values are those of plain numbers to the bit
        let values: Vec<f64> = exact.qpos.iter().map(|x| x.value).collect();
        assert_eq!(values, rollout(&plain, &state, &command, &times, &options).unwrap().qpos);
    }
}

#[test]
fn coefficients_at_zero_see_that_they_may_leave_it() {
    for (name, parameters, method) in [
        ("chain_passive", ["g2/slender", "g2/angular", "g3/slender", "g3/angular"], Method::RungeKutta),
        (
            "octopus8",
            ["geom#1/slender", "geom#1/angular", "geom#2/slender", "geom#2/angular"],
            Method::Rosenbrock,
        ),
    ] {
        let mut plain = model(name);
        let (state, command) = start(&plain);
        let times = [0.1, 0.2];
        let options = RolloutOptions { steps: Some(Steps::even(method, 0.005)), ..RolloutOptions::default() };
        for parameter in parameters {
            plain.set_parameter(parameter, 0.0).unwrap();
        }
        let mut lifted = plain.map(Number::constant);
        for (index, parameter) in parameters.into_iter().enumerate() {
            lifted.set_parameter(parameter, Number::variable(0.0, index)).unwrap();
        }
        let numbers = |x: &[f64]| x.iter().map(|&x| Number::constant(x)).collect();
        let lifted_state = State { qpos: numbers(&state.qpos), qvel: numbers(&state.qvel) };
        let exact = rollout_of(&lifted, &lifted_state, &command, &times, &options).unwrap();
        for (index, parameter) in parameters.into_iter().enumerate() {
            let at = |value: f64| {
                let mut model = plain.clone();
                model.set_parameter(parameter, value).unwrap();
                rollout(&model, &state, &command, &times, &options).unwrap().qpos
            };
            // from one side, second order
            let step = 1e-3;
            let [a, b, c] = [0.0, step, 2.0 * step].map(at);
            let differences: Vec<f64> =
                (0..a.len()).map(|i| (4.0 * b[i] - 3.0 * a[i] - c[i]) / (2.0 * step)).collect();
            let ours: Vec<f64> = exact.qpos.iter().map(|x| x.partials[index]).collect();
            let worst = common::relative(&ours, &differences);
            println!("{name} {parameter}: derivative against differences {worst:.1e}");
            assert!(worst < 1e-5, "{name} {parameter} {worst:e}");
        }
    }
}

#[test]
fn derivatives_stay_sound_where_friction_holds_however_long_the_steps() {
    let mut plain = model("chain_friction");
    for joint in ["q1", "q2", "q3"] {
        // more than gravity moves
        plain.set_parameter(&format!("{joint}/frictionloss"), 0.5).unwrap();
    }
    let (state, command) = start(&plain);
    let mut lifted = plain.map(Number::constant);
    for (index, parameter) in ["g2/blunt", "link2/mass", "q2/damping", "link3/mass"].into_iter().enumerate() {
        let value = plain.parameter(parameter).unwrap();
        lifted.set_parameter(parameter, Number::variable(value, index)).unwrap();
    }
    let numbers = |x: &[f64]| x.iter().map(|&x| Number::constant(x)).collect();
    let state = State { qpos: numbers(&state.qpos), qvel: numbers(&state.qvel) };
    let slopes = |method, longest_s| -> Vec<f64> {
        let steps = Some(Steps::even(method, longest_s));
        let options = RolloutOptions { steps, ..RolloutOptions::default() };
        let end = rollout_of(&lifted, &state, &command, &[10.0], &options).unwrap();
        end.qpos.iter().flat_map(|q| q.partials).collect()
    };
    for method in [Method::RungeKutta, Method::Rosenbrock] {
        let worst = common::relative(&slopes(method, 0.1), &slopes(method, 0.001));
        println!("{method:?}: derivatives of the creep in long steps against short ones {worst:.1e}");
        // the third order of the coarser method at 16 ms
        assert!(worst < 0.03, "{method:?} {worst:e}");
    }
}
