//! What physics says must come of each cause.
#![allow(clippy::unwrap_used, reason = "tests")]

mod body;
mod camera;
mod drive;
mod joint;
mod page;
mod space;
mod water;

use super::{Cause, Role};
use crate::math::Vec3;
use crate::model::{Integrator, Model, State};
use crate::options::RolloutOptions;
use crate::rollout::rollout;
use crate::simulator::Simulator;
use crate::{Command, Rollout};

/// Rounding of a few thousand steps.
const ROUNDING: f64 = 1e-10;
/// The error of MuJoCo's quadrature for added mass.
const QUADRATURE: f64 = 1e-5;

fn chain(name: &str) -> Model {
    let text = match name {
        "passive" => include_str!("../../../tests/data/chain_passive.xml"),
        _ => include_str!("../../../tests/data/chain_active.xml"),
    };
    Model::from_mjcf(text).unwrap()
}

fn mjcf(option: &str, world: &str) -> Model {
    Model::from_mjcf(&format!(
        r#"<mujoco><compiler angle="radian"/><option {option}/><worldbody>{world}</worldbody>
        <actuator/></mujoco>"#
    ))
    .unwrap()
}

fn with(model: &Model, values: &[(&str, f64)]) -> Model {
    let mut model = model.clone();
    for (name, value) in values {
        model.add_cause(name.split('/').next().unwrap()).unwrap();
        model.set_parameter(name, *value).unwrap();
    }
    model
}

fn rk4(timestep_s: f64) -> RolloutOptions {
    RolloutOptions { integrator: Some(Integrator::Rk4), timestep_s: Some(timestep_s), ..Default::default() }
}

fn grid(duration_s: f64, every_s: f64) -> Vec<f64> {
    (0..=(duration_s / every_s).round() as u32).map(|k| f64::from(k) * every_s).collect()
}

fn run(model: &Model, qpos: &[f64], times: &[f64], options: &RolloutOptions) -> Rollout<f64> {
    let state = State { qpos: qpos.to_vec(), qvel: vec![0.0; model.nv()] };
    rollout(model, &state, &Command::default(), times, options).unwrap()
}

/// Parameters' names and values.
type Values = &'static [(&'static str, f64)];

/// One link as in the chain, hanging from a hinge.
fn link() -> Model {
    mjcf(
        r#"gravity="0 0 -9.81" density="1000""#,
        r#"<body name="link" gravcomp="0.8"><joint name="q" axis="0 -1 0"/>
           <geom name="g" type="box" size="0.005 0.0025 0.015" pos="0 0 -0.0125" density="1240"
             fluidshape="ellipsoid" fluidcoef="0.6 0.2 1.6 0.9 0.8"/>
           <site name="P1" pos="0 0 -0.0275"/></body>"#,
    )
}

const LINK_KG: f64 = 1240.0 * 8.0 * 0.005 * 0.0025 * 0.015;
const LEVER_M: f64 = 0.0125;
const TIP_M: f64 = 0.0275;
const G: f64 = 9.81;

/// The torque \[N m\] that the causes in `values` exert on the link at the angle `q` and rate `w`.
fn torque(values: &[(&str, f64)], q: f64, w: f64) -> f64 {
    let state = State { qpos: vec![q], qvel: vec![w] };
    let of = |model: &Model| {
        let forces = Simulator::new(model, &RolloutOptions::default()).unwrap().forces(&state, &[]);
        let sum = |parts: [&Vec<f64>; 5]| parts.into_iter().map(|part| part[0]).sum::<f64>();
        sum([&forces.spring, &forces.damper, &forces.gravity_compensation, &forces.fluid, &forces.effect])
            - forces.bias[0]
    };
    of(&with(&link(), values)) - of(&link())
}

fn assert_close(ours: f64, expected: f64, share: f64, what: &str) {
    assert!((ours - expected).abs() <= share * expected.abs(), "{what}: {ours:e}, expected {expected:e}");
}

#[test]
fn causes_have_the_contract_s_names() {
    let names = "added_mass current slosh buoyancy link_mass cob_offset linear_drag drag_exponent wall basset \
         coulomb_friction joint_damping stiffness one_sided_stiffness end_stop backlash servo_delay servo_lag servo_gain servo_refresh load_friction \
         servo_rate_limit tether camera_delay camera_scale camera_rotation camera_tilt rolling_shutter lens \
         keypoint_slip inertia medium_drag link_length joint_zero servo_sag camera_offset back_emf gear_friction drive_offset dead_band servo_loop";
    let mut expected: Vec<&str> = names.split_whitespace().collect();
    let mut ours: Vec<&str> = Cause::ALL.iter().map(|cause| cause.name()).collect();
    expected.sort_unstable();
    ours.sort_unstable();
    assert_eq!(ours, expected);
    for cause in Cause::ALL {
        let info = cause.info();
        assert!(info.aliases.iter().all(|alias| ours.contains(&alias.name)), "{}", info.name);
        for parameter in info.parameters {
            let [low, high] = parameter.bounds;
            assert!((low..=high).contains(&parameter.neutral) && parameter.typical > 0.0, "{}", info.name);
        }
    }
    assert!("slush".parse::<Cause>().unwrap_err().to_string().contains("slosh"));
}

/// Every cause at once, each at its typical size.
fn all_causes(model: &Model) -> Model {
    let mut model = model.clone();
    for cause in Cause::ALL {
        model.add_cause(cause.name()).unwrap();
    }
    for (effect, place) in (0..model.causes.len()).flat_map(|i| (0..40).map(move |k| (i, k))) {
        let effect = &mut model.causes[effect];
        let Some(parameter) = effect.parameters().nth(place) else { continue };
        if matches!(parameter.role, Role::Size | Role::Switch) {
            *effect.value_mut(place) = 0.3 * parameter.typical;
        }
    }
    model
}

#[test]
fn neutral_causes_change_nothing_and_absent_ones_not_a_bit() {
    let times = grid(1.0, 0.05);
    for name in ["passive", "active"] {
        let model = chain(name);
        let plain = run(&model, &[1.2, 0.1, -0.2], &times, &rk4(0.005));
        let mut neutral = model.clone();
        for cause in Cause::ALL {
            neutral.add_cause(cause.name()).unwrap();
        }
        let same = run(&neutral, &[1.2, 0.1, -0.2], &times, &rk4(0.005));
        for (a, b) in plain.position_m.iter().flatten().zip(same.position_m.iter().flatten()) {
            assert!((a - b).abs() < 1e-12, "{name} {a} {b}");
        }
        for cause in Cause::ALL {
            assert!(neutral.remove_cause(*cause));
        }
        assert_eq!(run(&neutral, &[1.2, 0.1, -0.2], &times, &rk4(0.005)), plain);
    }
}

#[test]
fn folded_causes_move_the_same_way_without_any() {
    let times = grid(1.0, 0.05);
    let values = [
        ("current/x", 0.02),
        ("buoyancy/scale", 0.05),
        ("link_mass/link2", 0.1),
        ("joint_damping/damping", 1e-6),
        ("stiffness/q3", 1e-5),
        ("coulomb_friction/torque", 2e-6),
        ("coulomb_friction/soft", 1.0),
        ("keypoint_slip/P2", 0.001),
        ("inertia/link3", 0.2),
        ("link_length/link2", 0.002),
        ("joint_zero/q1", 0.1),
    ];
    let model = with(&chain("active"), &values);
    let command =
        Command { actuators: vec!["servo".into()], time_s: vec![0.0, 1.0], angle_rad: vec![0.0, 0.8] };
    let moved = |model: &Model| {
        rollout(model, &model.rest_state(), &command, &times, &rk4(0.0005)).unwrap().position_m
    };
    // as told, and the other way
    for gain in [0.1, -1.9] {
        let model = with(&model, &[("servo_gain/scale", gain)]);
        let folded = model.folded();
        assert!(folded.lost.is_empty() && folded.altered.is_empty() && folded.model.causes().is_empty());
        for (a, b) in moved(&model).iter().flatten().zip(moved(&folded.model).iter().flatten()) {
            assert!((a - b).abs() < 1e-9, "{a} {b}");
        }
    }
    let creeping = [("coulomb_friction/torque", 1e-6), ("coulomb_friction/soft", 0.0)];
    let lost = with(&with(&model, &[("added_mass/scale", 1.0)]), &creeping).folded();
    assert_eq!(
        (lost.lost, lost.altered),
        (vec!["added_mass".parse().unwrap()], vec!["coulomb_friction".parse().unwrap()])
    );
}

#[test]
fn causes_survive_the_way_through_mjcf() {
    let model = all_causes(&chain("active"));
    let text = model.to_mjcf("test");
    let back = Model::from_mjcf(&text).unwrap();
    // what finds nothing to act on in a model leaves no trace
    let acting: Vec<_> = model.causes().iter().filter(|cause| !cause.names().is_empty()).cloned().collect();
    assert_eq!(back.causes(), acting);
    assert!(text.contains("Except for the causes") && !chain("active").to_mjcf("").contains("custom"));
    let misspelt = text.replace("added_mass/scale", "added_mass/skale");
    assert!(Model::from_mjcf(&misspelt).unwrap_err().to_string().contains("added_mass/scale"));
    let foreign = text.replace("added_mass/scale", "my/number");
    assert!(Model::from_mjcf(&foreign).is_ok());
}
