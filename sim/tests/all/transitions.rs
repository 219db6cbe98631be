//! Answers to forces by transitions, against derivatives of the whole run.

use sim::batch::Candidate;
use sim::causes::own::{Acts, OwnCause, OwnParameter, Place};
use sim::sensitivities::{Direction, sensitivities};
use sim::transitions::transitions;
use sim::{Command, Isa, Method, Model, RolloutOptions, State, Steps};

/// Two links in water; a third of a second's force on the second hinge swings them.
const CHAIN: &str = r#"<mujoco><option density="1000"/><worldbody><body gravcomp="0.8">
    <joint name="q1" axis="0 -1 0" damping="1e-6"/>
    <geom type="box" size="0.005 0.0025 0.0125" pos="0 0 -0.0125" density="1240" fluidshape="ellipsoid"/>
    <site name="P1" pos="0 0 -0.025"/>
    <body pos="0 0 -0.025" gravcomp="0.8"><joint name="q2" axis="0 -1 0" damping="1e-6"/>
    <geom type="box" size="0.005 0.0025 0.015" pos="0 0 -0.015" density="1240" fluidshape="ellipsoid"/>
    <site name="P2" pos="0 0 -0.03"/></body></body></worldbody></mujoco>"#;

/// The force over time, as an expression and as a function \[units\].
const FORCE: &str = "size * (sin(3 * t) + 0.5 * cos(7 * t))";
fn force(t: f64) -> f64 {
    (3.0 * t).sin() + 0.5 * (7.0 * t).cos()
}

/// Start of the motion \[s\].
const START_S: f64 = 0.2;
/// Length of the pieces \[s\].
const PIECE_S: f64 = 0.02;

#[test]
fn a_force_over_time_moves_marks_as_its_derivative_says() {
    let mut model = Model::from_mjcf(CHAIN).unwrap();
    model
        .define_cause(&OwnCause {
            name: "push".into(),
            sentence: None,
            place: Place::Joint("q2".into()),
            terms: vec![(Acts::Torque, FORCE.into())],
            parameters: vec![OwnParameter::size("size", "N m", [-1.0, 1.0], 1e-6)],
        })
        .unwrap();
    let plain = model.clone();
    model.add_cause("push").unwrap();
    let place = model.find_parameter("push/size").unwrap();
    let times: Vec<f64> = (0..200).map(|k| f64::from(k) * 0.01).collect();
    let options = RolloutOptions {
        start_s: START_S,
        steps: Some(Steps::even(Method::RungeKutta, 2e-3)),
        ..RolloutOptions::default()
    };
    let state = State { qpos: vec![1.2, -0.7], qvel: vec![0.0; 2] };
    let at = |values: Vec<f64>| Candidate { values, state: state.clone(), start_s: START_S };
    let direction = Direction { values: vec![1.0], qpos: vec![0.0; 2], qvel: vec![0.0; 2], start_s: 0.0 };
    let none = Command::default();
    let isa = Isa::best();
    let whole =
        sensitivities(&model, &[place], &at(vec![0.0]), &[direction], &none, &times, &options, isa).unwrap();
    let pieces = transitions(&plain, &[], &at(Vec::new()), PIECE_S, &none, &times, &options, isa).unwrap();
    let values: Vec<f64> = pieces.knots_s.iter().map(|&t| force(t)).collect();
    let answer = pieces.response(1, &values);
    let most = whole.slopes[0].iter().flatten().fold(0.0_f64, |most, x| most.max(x.abs()));
    let off = whole.slopes[0].iter().flatten().zip(answer.iter().flatten());
    let off = off.fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
    // straight lines over 0.02 s leave 49/2 * 0.01^2 of the quicker part, which averages out
    assert!(most > 0.0 && off < 1e-3 * most, "{off} of {most}");
}
