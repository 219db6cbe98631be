//! Causes that somebody writes down, in whole rollouts: against those of the program, in lanes, and their derivatives.

use crate::common::model;
use sim::batch::{self, Candidate};
use sim::causes::own::{Acts, OwnCause, OwnParameter, Place};
use sim::sensitivities::{self, Direction};
use sim::{Command, Integrator, Isa, Method, Model, RolloutOptions, State, Steps, plan, rollout};

/// Rounding of a thousand steps of a chain \[m\].
const ROUNDING_M: f64 = 1e-12;

fn cause(name: &str, place: Place, terms: &[(Acts, &str)], parameters: &[OwnParameter]) -> OwnCause {
    OwnCause {
        name: name.into(),
        sentence: None,
        place,
        terms: terms.iter().map(|(acts, text)| (*acts, (*text).to_owned())).collect(),
        parameters: parameters.to_vec(),
    }
}

fn size(unit: &str, most: f64, typical: f64) -> OwnParameter {
    OwnParameter::size("size", unit, [-most, most], typical)
}

/// `model` with `definition` at `value`.
fn with(model: &Model, definition: &OwnCause, value: f64) -> Model {
    let mut model = model.clone();
    model.define_cause(definition).unwrap();
    model.add_cause(&definition.name).unwrap();
    model.set_parameter(&format!("{}/size", definition.name), value).unwrap();
    model
}

fn samples() -> Vec<f64> {
    (0..25).map(|k| 0.017 + 0.0411 * f64::from(k)).collect()
}

fn even(method: Method) -> RolloutOptions {
    RolloutOptions { steps: Some(Steps::even(method, 0.002)), ..Default::default() }
}

fn stroke() -> Command {
    let time_s: Vec<f64> = (0..12).map(|k| 0.0313 + 0.11073 * f64::from(k)).collect();
    let angle_rad = time_s.iter().map(|t| 0.5 * (7.0 * (t - 0.0313)).sin()).collect();
    Command { actuators: vec!["servo".into()], time_s, angle_rad }
}

fn drop(model: &Model, options: &RolloutOptions) -> Vec<f64> {
    let state = State { qpos: vec![1.4, 0.1, -0.2], qvel: vec![0.0; 3] };
    let seen = rollout(model, &state, &Command::default(), &samples(), options).unwrap();
    seen.position_m.into_iter().flatten().collect()
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn written_down_causes_move_as_those_of_the_program() {
    let plain = model("chain_passive");
    let at_q2 =
        |text| cause("mine", Place::Joint("q2".into()), &[(Acts::Torque, text)], &[size("N m", 1e-2, 1e-6)]);
    let rubs = "-size * v / sqrt(v ^ 2 + 0.05 ^ 2)";
    let cases = [("-size * v", "joint_damping/q2", 3e-6), (rubs, "coulomb_friction/q2", 2e-6)];
    for (text, known, value) in cases {
        let mut other = plain.clone();
        other.add_cause(known.split('/').next().unwrap()).unwrap();
        other.set_parameter(known, value).unwrap();
        let ours = with(&plain, &at_q2(text), value);
        let moved = apart(&drop(&plain, &even(Method::RungeKutta)), &drop(&other, &even(Method::RungeKutta)));
        assert!(moved > 1e-4, "{known} moves nothing: {moved:e}");
        for method in [Method::RungeKutta, Method::Rosenbrock] {
            let apart = apart(&drop(&ours, &even(method)), &drop(&other, &even(method)));
            println!("{known} {method:?}: {apart:.1e} m");
            // near rest implicit steps know a slope of their own, which their error but not their limit depends on
            let limit = if method == Method::Rosenbrock && text == rubs { 1e-7 } else { ROUNDING_M };
            assert!(apart < limit, "{known} {method:?}: {apart:e}");
        }
    }
}

/// A spring by its torque on a hinge at the tank's frame is one by a force on the link's tip.
#[test]
fn forces_on_a_body_are_torques_on_its_hinge() {
    let text = r#"<mujoco><option density="1000"/><worldbody><body name="link" pos="0.01 0.02 0.3"><joint name="q" axis="0 -1 0"/>
        <geom type="box" size="0.005 0.0025 0.015" pos="0 0 -0.0125" density="1240" fluidshape="ellipsoid"/>
        <site name="P1" pos="0 0 -0.0275"/></body></worldbody></mujoco>"#;
    let plain = Model::from_mjcf(text).unwrap();
    // the tip of a link of length l that hangs at q: (l sin q, -l cos q); counter-clockwise is positive
    let place = Place::Body { body: "link".into(), point_m: [0.0, 0.0, -0.0275] };
    let tip =
        [(Acts::Force(0), "-size * angle * cos(angle)"), (Acts::Force(2), "-size * angle * sin(angle)")];
    let damped =
        [(Acts::Force(0), "-size * vx"), (Acts::Force(2), "-size * (z - 0.3) / 0.0275 * 0 - size * vz")];
    let turned = [
        (Acts::Force(0), "-size * rate * 0.0275 * -(z - 0.3) / 0.0275"),
        (Acts::Force(2), "-size * rate * (x - 0.01)"),
    ];
    let n = [size("N", 10.0, 1e-3)];
    let hinge = |text| cause("hinge", Place::Joint("q".into()), &[(Acts::Torque, text)], &n);
    let seen = |model: &Model| {
        let state = State { qpos: vec![1.4], qvel: vec![0.3] };
        let seen =
            rollout(model, &state, &Command::default(), &samples(), &even(Method::RungeKutta)).unwrap();
        seen.position_m.into_iter().flatten().collect::<Vec<f64>>()
    };
    let pairs = [
        (&tip[..], "-size * 0.0275 * q"),
        (&damped[..], "-size * 0.0275 ^ 2 * v"),
        (&turned[..], "-size * 0.0275 ^ 2 * v"),
    ];
    for (forces, torque) in pairs {
        let [force, torque] = [cause("tip", place.clone(), forces, &n), hinge(torque)]
            .map(|own| seen(&with(&plain, &own, 4e-3)));
        let moved = apart(&seen(&plain), &force);
        let apart = apart(&force, &torque);
        println!("{forces:?}: moves {moved:.1e} m, apart {apart:.1e} m");
        assert!(moved > 1e-4 && apart < ROUNDING_M, "{forces:?}: {moved:e} {apart:e}");
    }
}

/// One cause of each kind, each of which asks for as much as it may.
fn each_kind() -> [(OwnCause, f64); 3] {
    let width = OwnParameter { hidden: vec![0.2], ..OwnParameter::size("width", "rad/s", [0.01, 1.0], 0.1) };
    let joint = cause(
        "servo_magnet",
        Place::Joint("q1".into()),
        &[(Acts::Torque, "size * (sin(8 * (q - command)) - tanh(v / width) * exp(-t) * abs(v) ^ 0.3)")],
        &[size("N m", 1e-2, 1e-5), width],
    );
    let body = cause(
        "pull",
        Place::Body { body: "link2".into(), point_m: [0.001, 0.0, -0.01] },
        &[
            (Acts::Force(0), "size * (cos(3 * angle) - vx * sqrt(vx ^ 2 + vz ^ 2 + 1e-6) * 5) * min(t, 0.5)"),
            (Acts::Force(2), "size * (rate * 0.01 + atan2(x, 0.1 + z ^ 2) - max(vz, 0))"),
        ],
        &[size("N", 1.0, 1e-4)],
    );
    let seen = cause(
        "glare",
        Place::Keypoint("P2".into()),
        &[(Acts::Shift(0), "size * sin(40 * z + t)"), (Acts::Shift(2), "size * x / 0.05")],
        &[size("m", 0.02, 5e-4)],
    );
    [(joint, 1e-5), (body, 2e-4), (seen, 1e-3)]
}

fn with_each_kind() -> (Model, Vec<String>) {
    let mut model = model("chain_active");
    for (definition, value) in each_kind() {
        model = with(&model, &definition, value);
    }
    let names = model.causes().iter().flat_map(|carried| carried.names().to_vec()).collect();
    (model, names)
}

#[test]
fn lanes_are_the_same_to_the_bit_as_alone() {
    let (model, names) = with_each_kind();
    assert_eq!(names, ["servo_magnet/size", "servo_magnet/width", "pull/size", "glare/size"]);
    let parameters: Vec<_> = names.iter().map(|name| model.find_parameter(name).unwrap()).collect();
    let candidates: Vec<Candidate> = (0..9)
        .map(|k| Candidate {
            values: parameters.iter().map(|&p| model.get(p) * (0.2 + 0.3 * f64::from(k))).collect(),
            state: model.rest_state(),
            start_s: 0.001 * f64::from(k),
        })
        .collect();
    for method in [Method::RungeKutta, Method::Rosenbrock] {
        let options = even(method);
        let all = |isa| {
            batch::positions(&model, &parameters, &candidates, &stroke(), &samples(), &options, isa).unwrap()
        };
        let alone = all(Isa::Baseline);
        assert!(alone.iter().all(Result::is_ok) && alone[1] != alone[2]);
        for isa in Isa::available() {
            assert_eq!(all(isa), alone, "{method:?} {isa:?}");
        }
    }
}

/// Central differences of fourth order, over steps of a thousandth of the values.
#[test]
fn derivatives_are_exact_in_every_lane() {
    let (model, names) = with_each_kind();
    let parameters: Vec<_> = names.iter().map(|name| model.find_parameter(name).unwrap()).collect();
    let values: Vec<f64> = parameters.iter().map(|&parameter| model.get(parameter)).collect();
    let candidate = Candidate { values, state: model.rest_state(), start_s: 0.0 };
    let count = parameters.len();
    let directions: Vec<Direction> = (0..count)
        .map(|k| Direction {
            values: (0..count).map(|i| f64::from(u8::from(i == k))).collect(),
            qpos: vec![0.0; 3],
            qvel: vec![0.0; 3],
            start_s: 0.0,
        })
        .collect();
    for (method, isa) in [Method::RungeKutta, Method::Rosenbrock]
        .into_iter()
        .flat_map(|method| Isa::available().into_iter().map(move |isa| (method, isa)))
    {
        let options = even(method);
        let found = sensitivities::sensitivities(
            &model,
            &parameters,
            &candidate,
            &directions,
            &stroke(),
            &samples(),
            &options,
            isa,
        )
        .unwrap();
        for (k, slope) in found.slopes.iter().enumerate() {
            let step = 1e-3 * candidate.values[k];
            let moved = |by: f64| {
                let mut model = model.clone();
                model.set(parameters[k], candidate.values[k] + by * step);
                let seen = rollout(&model, &candidate.state, &stroke(), &samples(), &options).unwrap();
                seen.position_m.into_iter().flatten().collect::<Vec<f64>>()
            };
            let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(moved);
            let exact: Vec<f64> = slope.iter().flatten().copied().collect();
            let largest = exact.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            let worst = (0..exact.len())
                .map(|i| exact[i] - (a[i] - d[i] + 8.0 * (c[i] - b[i])) / (12.0 * step))
                .fold(0.0_f64, |most, x| most.max(x.abs()));
            println!("{method:?} {isa:?} {}: {:.1e}", names[k], worst / largest);
            assert!(largest > 0.0 && worst < 1e-5 * largest, "{}: {:e}", names[k], worst / largest);
        }
    }
}

#[test]
fn a_model_that_knows_a_cause_and_does_not_carry_it_moves_the_same_to_the_bit() {
    let plain = model("chain_active");
    let mut knows = plain.clone();
    for (definition, _) in each_kind() {
        knows.define_cause(&definition).unwrap();
    }
    let seen = |model: &Model, options: &RolloutOptions| {
        rollout(model, &model.rest_state(), &stroke(), &samples(), options).unwrap()
    };
    let own = RolloutOptions {
        integrator: Some(Integrator::ImplicitFast),
        timestep_s: Some(0.002),
        ..Default::default()
    };
    for options in [even(Method::RungeKutta), even(Method::Rosenbrock), own] {
        assert_eq!(seen(&knows, &options), seen(&plain, &options));
        // carried at 0 it moves nothing either
        let mut carries = knows.clone();
        each_kind().iter().for_each(|(definition, _)| drop_in(&mut carries, &definition.name));
        let [carried, absent] = [&carries, &plain].map(|model| seen(model, &options).position_m.concat());
        assert!(apart(&carried, &absent) < ROUNDING_M);
    }
}

fn drop_in(model: &mut Model, name: &str) {
    model.add_cause(name).unwrap();
}

#[test]
fn numbers_come_back_from_a_written_model_once_the_cause_is_defined() {
    let (mut model, names) = with_each_kind();
    let dashes = cause(
        "dashes",
        Place::Joint("q2".into()),
        &[(Acts::Torque, "size ---q")],
        &[size("N m", 1e-2, 1e-5)],
    );
    assert!(model.clone().define_cause(&dashes).unwrap_err().reason.contains("must vanish"));
    let dashes = OwnCause { terms: vec![(Acts::Torque, "size * ---q".into())], ..dashes };
    model = with(&model, &dashes, 1e-6);
    let text = model.to_mjcf("test");
    let head = "<!-- dashes is no cause that every reader knows; its numbers go with [[cause]] torque = size * - - -q at joint `q2` -->";
    assert!(text.contains("Except for the causes") && text.contains(head), "{}", &text[..1200]);
    let mut back = Model::from_mjcf(&text).unwrap();
    assert!(back.causes().is_empty());
    for (definition, _) in each_kind() {
        back.define_cause(&definition).unwrap();
    }
    back.define_cause(&dashes).unwrap();
    assert_eq!(back.causes(), model.causes());
    assert_eq!(back.parameter(&names[1]), model.parameter(&names[1]));
    let lost: Vec<&str> = model.folded().lost.iter().map(|cause| cause.name()).collect();
    assert_eq!(lost, ["servo_magnet", "pull", "glare", "dashes"]);
    // a number that the cause lacks
    let mut odd = Model::from_mjcf(&text.replace("pull/size", "pull/sise")).unwrap();
    let [_, (pull, _), _] = each_kind();
    let error = odd.define_cause(&pull).unwrap_err();
    assert_eq!(error.unknown, Some(("sise".into(), vec!["size".into()])));
}

#[test]
fn steps_are_planned_for_a_torque_that_is_stiff() {
    let magnet = cause(
        "magnet",
        Place::Joint("q2".into()),
        &[(Acts::Torque, "-size * tanh(v / 0.01)")],
        &[size("N m", 1e-2, 1e-5)],
    );
    let model = with(&model("chain_passive"), &magnet, 1e-5);
    let state = State { qpos: vec![1.4, 0.1, -0.2], qvel: vec![0.0; 3] };
    let planned =
        plan(&model, &state, &Command::default(), &samples(), &RolloutOptions::default(), 1e-5).unwrap();
    println!("{} steps of {:?}", planned.steps.ends_s.len(), planned.steps.method);
    assert!(planned.steps.ends_s.len() < 1000, "{}", planned.steps.ends_s.len());
    let fine = RolloutOptions { steps: Some(Steps::even(Method::RungeKutta, 1e-4)), ..Default::default() };
    let ours = RolloutOptions { steps: Some(planned.steps), ..Default::default() };
    let error_m = apart(&drop(&model, &ours), &drop(&model, &fine));
    assert!(error_m < 3e-5, "{error_m:e}");
}
